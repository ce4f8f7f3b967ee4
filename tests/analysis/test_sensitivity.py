"""How equilibria move with weights: closed forms, finite differences, single parts in ngspice."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from constrained import integrator, v
from designs import small
from minimax import small as cart
from problems import SUITE
from simulator import needs_ngspice

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.sensitivity import input_sensitivity, weight_sensitivity
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.spice.backend import SpiceBackend, simulate
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.gain_rule import DIAGONAL_RULE
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.parts.datasheet import Datasheet, Kind
from ann_dc.hardware.parts.levels import Level, macro
from ann_dc.network import preconditioners
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product, Sum, Template
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.problem.soft import Soft
from ann_dc.solver import synthesize

PREVIOUS, NEXT = Template.PREVIOUS, Template.NEXT


def wire(source, target, weight=1.0, template=Template.SELF):
    return Connection(source=source, target=target, weight=weight, template=template)


# ---- by hand -------------------------------------------------------------------------------------


def test_a_chain_of_leaky_neurons_in_closed_form():
    """-a x_k + x_{k-1} = 0 from x_{-1} = d: x_k = d / a^(k+1), so dx_k/da_j = -x_k / a, j <= k."""
    a, d = 1.7, 2.0
    chain = Network(
        cell=Cell(
            neurons=(Neuron(name="x", tau=0.3),),
            inputs=("d",),
            connections=(wire("x", "x", -a), wire("x", "x", 1.0, PREVIOUS)),
        ),
        stages=4,
        inputs={"d": d},
        left_boundary={"x": "d"},
    )
    x = equilibrium(chain, np.zeros(4))
    np.testing.assert_allclose(x, d / a ** np.arange(1, 5), rtol=1e-12)
    found = weight_sensitivity(chain, x, np.arange(4))
    wanted = np.tril(np.ones((4, 4))) * x[:, None]
    np.testing.assert_allclose(found["x<-x"], wanted / a, rtol=1e-12)  # the weight is -a
    np.testing.assert_allclose(found["x<-x@previous"], wanted, rtol=1e-12)


def test_a_neuron_behind_a_function_and_a_product_in_closed_form():
    """x = w exp(v y) y with y = u: dx/dv = x y, dx/du = x (1 / y + v)."""
    u, v, w = 0.6, 0.8, 1.3
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(
            Sum(name="s"),
            Function(name="e", function="exp", x="s"),
            Product(name="p", a="e", b="y"),
        ),
        connections=(
            wire("y", "y", -1.0),
            wire("one", "y", u),
            wire("y", "s", v),
            wire("x", "x", -1.0),
            wire("p", "x", w),
        ),
    )
    network = Network(cell=cell, stages=1)
    x = equilibrium(network, np.zeros(2))
    value = w * np.exp(v * u) * u
    np.testing.assert_allclose(x, [value, u], rtol=1e-12)
    found = weight_sensitivity(network, x, np.array([0]))
    wanted = {
        "x<-p": value / w,
        "s<-y": value * u,
        "y<-one": value * (1 / u + v),
        "y<-y": value * (1 / u + v) * u,  # y = u / a with a = 1
        "x<-x": value,
    }
    for name, slope in wanted.items():
        assert found[name].item() == pytest.approx(slope, rel=1e-12), name


# ---- against finite differences ------------------------------------------------------------------


def by_differences(network: Network, x: np.ndarray, connection: Connection, stage: int):
    """d x / d weight (n,) by central differences of the equilibrium."""
    moved = []
    step = 1e-4
    for sign in (1, -1):
        weight = np.array(np.broadcast_to(connection.weight, network.stages), float)
        weight[stage] += sign * step
        others = tuple(
            replace(c, weight=weight) if c is connection else c for c in network.cell.connections
        )
        cell = replace(network.cell, connections=others)
        moved.append(equilibrium(replace(network, cell=cell), x))
    return (moved[0] - moved[1]) / (2 * step)


def check(network: Network, x: np.ndarray, chosen) -> None:
    """Every chosen connection at every stage, all outputs."""
    found = weight_sensitivity(network, x, np.arange(network.size))
    assert set(found) == {c.name for c in network.cell.connections}
    scale = max(np.abs(s).max() for s in found.values())
    for connection in chosen:
        for stage in range(network.stages):
            wanted = by_differences(network, x, connection, stage)
            got = found[connection.name][:, stage]
            np.testing.assert_allclose(got, wanted, atol=1e-6 * scale, err_msg=connection.name)


def woven(function: str) -> Network:
    """Three cells of two neurons with a product, a function and neighbours on both sides."""
    cell = Cell(
        neurons=(Neuron(name="x", tau=0.5), Neuron(name="y"), Neuron(name="z")),
        inputs=("d",),
        blocks=(
            Sum(name="s"),
            Function(name="f", function=function, x="s"),
            Product(name="p", a="f", b="z"),
            Product(name="q", a="p", b="p"),
            Sum(name="r"),
        ),
        connections=(
            wire("one", "s", 0.5),
            wire("x", "s", 0.1),
            wire("y", "s", 0.15, PREVIOUS),
            wire("p", "r", 0.3),
            wire("f", "r", np.array([0.2, -0.1, 0.3])),
            wire("q", "r", 0.05),
            wire("x", "x", -1.5),
            wire("r", "x", 0.4),
            wire("d", "x", 0.3),
            wire("r", "y", -0.2, NEXT),
            wire("x", "y", 0.3, PREVIOUS),
            wire("y", "y", -2.0),
            wire("p", "z", 0.2),
            wire("z", "z", -1.0),
            wire("one", "z", 0.7),
        ),
    )
    return Network(
        cell=cell,
        stages=3,
        inputs={"d": np.array([0.5, -0.2, 0.4])},
        fixed=(FixedNeuron(neuron="x", stage=0, input="d"),),
        omitted=(Omitted(neuron="y", stage=2),),
        left_boundary={"x": "d", "y": "d"},
    )


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "function",
    [
        *("sin", "reciprocal", "rectify"),
        *(
            pytest.param(name, marks=pytest.mark.slow)
            for name in ("exp", "log", "sqrt", "tan", "atan", "acos")
        ),
    ],
)
def test_functions_products_and_neighbours(function):
    network = woven(function)
    x = equilibrium(network, np.full(network.size, 0.2))
    assert np.abs(evaluator(network).rhs(x)).max() < 1e-10
    check(network, x, network.cell.connections)


@cache
def optimum(name: str):
    """(network, its settled point) of a problem of the suite over four stages."""
    found = design(small(name), gain_rule=DIAGONAL_RULE)
    return found.network, equilibrium(found.network, found.state)


@pytest.mark.slow
def test_every_weight_of_a_linear_optimiser():
    network, x = optimum("double_integrator")
    check(network, x, network.cell.connections)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["car", "van_der_pol", "cstr"])
def test_weights_of_nonlinear_optimisers(name):
    network, x = optimum(name)
    check(network, x, network.cell.connections[::7])


@pytest.mark.slow
def test_weights_of_soft_rows():
    """Idle, pressed, and at the price, which decides where those rows are."""
    problem = integrator(N=8, dt=0.25, bounds={v: (None, 0.5)}, soft=Soft(weight=2, compliance=0.1))
    found = design(synthesize(problem), gain_rule=DIAGONAL_RULE)
    network, x = found.network, equilibrium(found.network, found.state)
    (diode,) = network.cell.inequality_duals
    node = lambda name: evaluator(network).node(x, name)  # noqa: E731
    at_price, active = node(diode.excess) > 0, node(diode.sum) > 0
    assert at_price.any()
    assert (active & ~at_price).any()
    assert (~active).any()
    own = (diode.rail, diode.leak)
    check(network, x, [c for c in network.cell.connections if c.name in own])
    check(network, x, network.cell.connections[::7])


@pytest.mark.slow
def test_weights_of_neurons_that_all_cells_share():
    found = design(synthesize(cart()))
    network, x = found.network, equilibrium(found.network, found.state)
    shared = {name for row in network.cell.objectives for name in (*row.neurons, *row.nodes)}
    wires = [
        c
        for c in network.cell.connections
        if {c.source, c.target} & shared and not np.ndim(c.weight)
    ]
    check(network, x, wires)


# ---- what is refused -----------------------------------------------------------------------------


def pair(wires, **settings) -> Network:
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Product(name="p", a="x", b="x"),),
        connections=wires,
    )
    return Network(cell=cell, stages=1, title="a pair", **settings)


def test_an_equilibrium_that_is_not_isolated_is_refused():
    """x' = y - x, y' = x - y: every x = y."""
    wires = (wire("x", "x", -1.0), wire("y", "x"), wire("x", "y"), wire("y", "y", -1.0))
    line = pair(wires)
    with pytest.raises(NetworkError, match="not isolated"):
        weight_sensitivity(line, np.ones(2), np.array([0]))


# ---- inputs --------------------------------------------------------------------------------------


def test_a_chain_answers_the_input_at_its_left_end():
    """x_k = d_0 / a^(k+1): inputs of other cells are read by nobody."""
    a = 1.7
    chain = Network(
        cell=Cell(
            neurons=(Neuron(name="x"),),
            inputs=("d",),
            connections=(wire("x", "x", -a), wire("x", "x", 1.0, PREVIOUS)),
        ),
        stages=4,
        inputs={"d": 2.0},
        left_boundary={"x": "d"},
    )
    found = input_sensitivity(chain, equilibrium(chain, np.zeros(4)), np.arange(4))["d"]
    assert found[:, 0] == pytest.approx(1 / a ** np.arange(1, 5))
    assert not found[:, 1:].any()


@pytest.mark.parametrize("name", ["pendulum", "car"])
def test_inputs_move_equilibria_as_differences_say(name):
    network = small(name)
    x = equilibrium(network, OdeBackend().run(network).trajectory.final)
    found = input_sensitivity(network, x, np.arange(network.size))
    step = 1e-5
    for name, slope in found.items():
        for stage in (0, network.stages - 1):
            ends = []
            for sign in (1, -1):
                moved = np.array(network.inputs[name])
                moved[stage] += sign * step * network.input_scale(name).factor
                ends.append(equilibrium(network.with_inputs({name: moved}), x))
            wanted = (ends[0] - ends[1]) / (2 * step)
            np.testing.assert_allclose(slope[:, stage], wanted, atol=1e-6 * np.abs(slope).max())


def test_what_stands_at_a_rail_moves_no_more():
    """y = x, x' = p - x clipped at 1: beyond it, p moves nothing."""
    for p, derivatives in ((0.5, 1.0), (2.0, 0.0)):
        cell = Cell(
            neurons=(Neuron(name="x", limiter=Limiter(low=-1.0, high=1.0)), Neuron(name="y")),
            inputs=("p",),
            connections=(
                wire("x", "x", -1.0),
                wire("p", "x"),
                wire("y", "y", -1.0),
                wire("x", "y"),
            ),
        )
        row = Network(stages=1, cell=cell, inputs={"p": p})
        x = np.full(2, min(p, 1.0))
        found = input_sensitivity(row, x, np.arange(2))["p"]
        assert found[:, 0].tolist() == [derivatives, derivatives]


# ---- single parts --------------------------------------------------------------------------------

LEVEL = macro(a0=1e5)
SIZES = {Kind.OFFSET: 1e-3, Kind.RESISTOR: 0.01, Kind.GAIN: 0.01}


def effects_of(circuit, level: Level, near: np.ndarray) -> dict[str, np.ndarray]:
    """What one unit of every parameter does to the controls, (controls, N) by name."""
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, near))
    outputs = np.flatnonzero(emulation.network.of_population("u"))
    slopes = weight_sensitivity(emulation.network, x, outputs)
    return {
        name: sum(slopes[connection] * slope for connection, slope in wires)
        for name, wires in emulation.slopes.items()
    }


@pytest.mark.parametrize(
    ("name", "every"),
    [
        ("double_integrator", 6),
        *(
            pytest.param(*each, marks=pytest.mark.slow)
            for each in (("double_integrator", 1), ("car", 4))
        ),
    ],
)
def test_parts_move_the_emulation_as_their_slopes_say(name, every):
    """One parameter after the other, off at all stages at random; without slopes nothing moves."""
    network, x = optimum(name)
    circuit, _ = SpiceBackend().prepare(network)
    # a gain so large that the conductance of a summing node does not move the error of finite gain
    level = Level(name="op amps", models="ideal", datasheet=Datasheet(a0=1e9))
    effects = effects_of(circuit, level, x)
    scale = max(np.abs(effect).max() for effect in effects.values())
    step, draws = 1e-5, np.random.default_rng(0)
    for parameter in circuit.parameters[::every]:
        off = np.where(parameter.present, draws.standard_normal(network.stages), 0.0)
        moved = []
        for sign in (1, -1):
            emulation = emulate(circuit, level, {parameter.name: sign * step * off})
            start = emulated_state(emulation, x)
            moved.append(emulation.controls(equilibrium(emulation.network, start)))
        wanted = (moved[0] - moved[1]) / (2 * step)
        none = np.zeros((len(wanted), network.stages))
        got = effects.get(parameter.name, none) @ off
        np.testing.assert_allclose(got, wanted, atol=1e-6 * scale, err_msg=parameter.name)


@cache
def prepared(name: str):
    network = design(
        synthesize(SUITE[name].problem),
        preconditioner=[preconditioners.PreconditionerKind.DIAGONAL],
    ).network
    return SpiceBackend(level=LEVEL).prepare(network)


def controls(name: str, deviations) -> np.ndarray:
    """Settled controls of a run in ngspice."""
    backend = SpiceBackend(level=LEVEL, require_stable=False)
    run = simulate(backend, *prepared(name), deviations)
    return run.trajectory.final[run.trajectory.network.of_population("u")]


@cache
def nominal(name: str) -> np.ndarray:
    return controls(name, {})


@cache
def effects(name: str) -> dict[str, np.ndarray]:
    circuit, probe = prepared(name)
    return effects_of(circuit, LEVEL, probe.final)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("car", Kind.RESISTOR),
        pytest.param("car", Kind.GAIN, marks=pytest.mark.slow),
        pytest.param("car", Kind.OFFSET, marks=pytest.mark.slow),
        pytest.param("unicycle", Kind.OFFSET, marks=pytest.mark.slow),
        pytest.param("unicycle", Kind.RESISTOR, marks=pytest.mark.slow),
        pytest.param("van_der_pol", Kind.RESISTOR, marks=pytest.mark.slow),
        pytest.param("van_der_pol", Kind.GAIN, marks=pytest.mark.slow),
    ],
)
def test_the_part_that_matters_most_moves_ngspice_as_predicted(name, kind):
    found = {
        p.name: np.where(p.present, effects(name)[p.name], 0.0)
        for p in prepared(name)[0].parameters
        if p.kind is kind and p.name in effects(name)
    }
    worst = max(found, key=lambda each: np.abs(found[each]).max())
    stage = int(np.abs(found[worst]).max(axis=0).argmax())
    off = np.zeros(found[worst].shape[1])
    off[stage] = SIZES[kind]
    measured = controls(name, {worst: off}) - nominal(name)
    predicted = found[worst][:, stage] * SIZES[kind]
    size = np.abs(measured).max()
    assert size > 1e-4 * np.abs(nominal(name)).max()  # far above the simulator's error
    assert np.abs(predicted - measured).max() < 0.03 * size
