"""One contract, four evaluators: NumPy, loops, generated code, torch; over every kind of network.

The Jacobian is compared with the complex step, everything else with NumPy, or with what can be
said in closed form.
"""

from dataclasses import replace

import numpy as np
import pytest
from constrained import CONSTRAINED
from designs import coordinated, near_start, small, wired_with
from hypothesis import given, settings, strategies as st
from minimax import CASES, car, small as cart
from problems import SUITE
from torch_evaluator import TorchEvaluator

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.decomposition.form import PRINTED, SWITCHES
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import GeneratedEvaluator
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import ReferenceEvaluator, evaluator
from ann_dc.evaluation.rules import FLOOR, SMALLEST_POSITION
from ann_dc.gain_design.gain_rule import GainRule, closed_form
from ann_dc.gain_design.gains import apply_gains
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product, Sum, Template
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.problem.soft import Soft
from ann_dc.solver import synthesize

TINY = 1e-30
"""A complex step: so small that it leaves the real part alone."""

EVALUATORS = (ReferenceEvaluator, InterpretedEvaluator, GeneratedEvaluator, TorchEvaluator)
every_preconditioner = pytest.mark.parametrize(
    "preconditioner", PreconditionerKind, ids=lambda kind: kind.name.lower()
)
every_evaluator = pytest.mark.parametrize("kind", EVALUATORS, ids=lambda kind: kind.__name__)


def complex_step(function, x: np.ndarray) -> np.ndarray:
    """Jacobian (m, n) of a function of batches (..., n) -> (..., m), exact to rounding."""
    return np.imag(function(x + 1j * TINY * np.eye(len(x)))).T / TINY


def assert_close(actual, expected, relative=1e-12) -> None:
    scale = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(actual, expected, rtol=relative, atol=relative * scale)


def grown(flow: np.ndarray, iterations: int = 20) -> float:
    """By how much the last power iteration has made a vector longer."""
    v, rate = np.random.default_rng(0).standard_normal(len(flow)), 1.0
    for _ in range(iterations):
        v = flow @ (v / np.linalg.norm(v))
        if not 0 < np.linalg.norm(v) < np.inf:
            break
        rate = np.linalg.norm(v)
    return float(rate)


def assert_conforms(kind: type[Evaluator], network: Network, x: np.ndarray) -> None:
    """Everything that the contract names, at a state (n,)."""
    ours, reference = kind(network), evaluator(network)
    assert ours.node_index == network.node_index
    assert_close(ours.values(x), reference.values(x))
    assert_close(ours.drives(x), reference.drives(x))
    assert_close(ours.rhs(x), reference.rhs(x))
    assert_close(ours.residuals(x), reference.residuals(x))
    push = network.pack(np.random.default_rng(2).standard_normal(network.live.shape))
    for drive in (push, network.pack(reference.drives(x))):
        assert_close(ours.derivative(drive), reference.preconditioner @ drive)
    assert_close(ours.fastest_rate(x), grown(reference.jacobian(x)), relative=1e-9)
    packed = lambda states: network.pack(reference.drives(states))  # noqa: E731
    assert_close(ours.drive_jacobian(x).toarray(), complex_step(packed, x))
    guard, expected = ours.domain_guard(x), reference.domain_guard(x)
    np.testing.assert_array_equal(guard.domains, expected.domains)
    np.testing.assert_array_equal(guard.signs, expected.signs)
    for state in (x, -x, 3 * x):
        assert ours.outside(state, guard) == reference.outside(state, expected)


@every_evaluator
@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("name", SUITE)
@pytest.mark.sampled
def test_every_problem(name, wired, kind):
    network = wired(name)
    assert_conforms(kind, network, near_start(network, 1))


@every_evaluator
@pytest.mark.parametrize(
    "preconditioner",
    [
        PreconditionerKind.COUPLED_MULTILEVEL,
        PreconditionerKind.RESISTIVE_GRID,
        PreconditionerKind.CYCLIC_REDUCTION,
    ],
)
@pytest.mark.parametrize("name", SUITE)
@pytest.mark.sampled
def test_every_kind_of_preconditioner(name, preconditioner, kind):
    network = wired_with(name, preconditioner)
    assert_conforms(kind, network, near_start(network, 1))


@every_evaluator
@pytest.mark.parametrize(
    "preconditioner",
    [
        PreconditionerKind.DIAGONAL,
        PreconditionerKind.MULTILEVEL,
        PreconditionerKind.COUPLED_MULTILEVEL,
    ],
)
@pytest.mark.parametrize("name", ["car_steer", "lander", "moving", "end_disc"])
@pytest.mark.sampled(2)
def test_diodes_that_conduct_and_others(name, preconditioner, kind):
    """Some controls beyond their rails, some multipliers of inequalities pressed."""
    plain = synthesize(CONSTRAINED[name].problem)
    linear = Linearisation(plain).at(plain.start_state)
    network = apply_gains(plain, closed_form(linear, GainRule(kind=preconditioner)))
    x = network.start_state + 0.5 * np.random.default_rng(3).standard_normal(network.size)
    pressed = [
        evaluator(network).node(x, diode.multiplier) for diode in network.cell.inequality_duals
    ]
    assert (np.concatenate(pressed) > 0).any()
    assert_conforms(kind, network, x)


@every_evaluator
@pytest.mark.parametrize(
    "preconditioner", [PreconditionerKind.DIAGONAL, PreconditionerKind.MULTILEVEL]
)
@pytest.mark.parametrize("name", ["car_steer", "lander", "end_disc"])
@pytest.mark.parametrize("compliance", [0.0, 0.02])
@pytest.mark.sampled(2)
def test_soft_rows_idle_pressed_and_at_their_price(compliance, name, preconditioner, kind):
    price = {"car_steer": 300.0, "lander": 1.0, "end_disc": 30.0}[name]
    soft = Soft(weight=price, compliance=compliance / price)
    plain = synthesize(replace(CONSTRAINED[name].problem, soft=soft))
    linear = Linearisation(plain).at(plain.start_state)
    network = apply_gains(plain, closed_form(linear, GainRule(kind=preconditioner)))
    x = network.start_state + 0.5 * np.random.default_rng(3).standard_normal(network.size)
    node = lambda name: evaluator(network).node(x, name)  # noqa: E731
    for states in zip(*(
        (node(d.sum) <= 0, (node(d.sum) > 0) & (node(d.excess) < 0), node(d.excess) > 0)
        for d in network.cell.inequality_duals
    )):  # fmt: skip
        assert name == "end_disc" or np.concatenate(states).any()
    for diode in network.cell.inequality_duals:
        drawn = node(diode.sum)
        ceiling = drawn - node(diode.excess)
        np.testing.assert_allclose(
            node(diode.multiplier), np.clip(drawn, 0, ceiling), rtol=1e-12, atol=1e-14
        )
    assert_conforms(kind, network, x)


@every_evaluator
@pytest.mark.parametrize(
    "preconditioner",
    [
        PreconditionerKind.DIAGONAL,
        PreconditionerKind.MULTILEVEL,
        PreconditionerKind.COUPLED_MULTILEVEL,
    ],
)
@pytest.mark.parametrize(
    "problem",
    [
        lambda: cart(1),
        lambda: cart(9),
        lambda: cart(9, temperature=0.3),
        lambda: car(CASES["three by range"][0]),
    ],
)
@pytest.mark.sampled(3)
def test_objectives_on_a_bus(problem, preconditioner, kind):
    """Some of them pressed, some not."""
    plain = synthesize(problem())
    linear = Linearisation(plain).at(plain.start_state)
    network = apply_gains(plain, closed_form(linear, GainRule(kind=preconditioner)))
    x = network.start_state + 0.5 * np.random.default_rng(3).standard_normal(network.size)
    assert_conforms(kind, network, x)


@every_evaluator
@pytest.mark.parametrize("form", [*SWITCHES.values(), PRINTED], ids=str)
@pytest.mark.sampled
def test_every_form_of_the_car(form, kind):
    network = small("car", form)
    assert_conforms(kind, network, near_start(network, 7))


@every_evaluator
@every_preconditioner
def test_numbers_of_their_own_in_every_stage(preconditioner, kind):
    network, rng = wired_with("car", preconditioner), np.random.default_rng(5)
    connections = tuple(
        replace(c, weight=np.asarray(c.weight) * rng.uniform(0.5, 2.0, network.stages))
        for c in network.cell.connections
    )
    neurons = tuple(
        replace(n, tau=np.asarray(n.tau) * rng.uniform(0.5, 2.0, network.stages))
        for n in network.cell.neurons
    )
    cell = replace(network.cell, connections=connections, neurons=neurons)
    network = replace(network, cell=cell)
    assert_conforms(kind, network, near_start(network, 5))


# ---- pins, ends, neighbours ----------------------------------------------------------------------


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


def row_with_ends() -> Network:
    """Three cells with a pin, an absent neuron, an end on the left and wires either way."""
    cell = Cell(
        neurons=(Neuron(name="x", tau=2.0), Neuron(name="y")),
        inputs=("edge", "held"),
        blocks=(Sum(name="s"), Product(name="p", a="s", b="y")),
        connections=(
            wire("x", "s", 3.0, Template.PREVIOUS),
            wire("p", "y"),
            wire("y", "x", [1.0, 10.0, 100.0], Template.NEXT),
            wire("one", "x", 0.5),
        ),
    )
    inputs = {"edge": 7.0, "held": np.array([-1.0, -2.0, -3.0])}
    return Network(cell=cell, stages=3, inputs=inputs, left_boundary={"x": "edge"})


@every_evaluator
def test_sources_in_neighbours_and_ends(kind):
    network = row_with_ends()
    x, y = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0])
    state = network.pack(np.stack([x, y]))
    assert_conforms(kind, network, state)
    derivatives = network.unpack(kind(network).rhs(state))
    np.testing.assert_allclose(derivatives[0], (np.array([1, 10, 100]) * [5, 6, 0] + 0.5) / 2)
    np.testing.assert_allclose(derivatives[1], 3 * np.array([7, 1, 2]) * y)


@pytest.mark.sampled(19)
@every_evaluator
@pytest.mark.parametrize("offset", [-7, -4, -3, -2, -1, 1, 2, 3, 4, 7])
def test_wires_beyond_neighbours(kind, offset):
    """Values and derivatives come from so many stages away; the end of the row is one cell wide."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        inputs=("edge",),
        blocks=(Sum(name="s"), Product(name="p", a="s", b="y")),
        connections=(wire("x", "s", 3.0, offset), wire("p", "y"), wire("p", "x", 2.0, -offset)),
    )
    network = Network(cell=cell, stages=4, inputs={"edge": 7.0}, left_boundary={"x": "edge"})
    x, y = np.array([1.0, 2.0, 3.0, 4.0]), np.array([4.0, 5.0, 6.0, 8.0])
    state = network.pack(np.stack([x, y]))
    assert_conforms(kind, network, state)
    read = dict(zip(range(4), x)) | {-1: 7.0}
    s = np.array([3 * read.get(k + offset, 0.0) for k in range(4)])
    np.testing.assert_allclose(network.unpack(kind(network).rhs(state))[1], s * y)


@every_evaluator
def test_pinned_and_absent_neurons(kind):
    network = replace(
        row_with_ends(),
        fixed=(FixedNeuron(neuron="x", stage=1, input="held"),),
        omitted=(Omitted(neuron="y", stage=2),),
    )
    state = np.array([1.0, 4.0, 5.0, 3.0])  # x_0, y_0, y_1, x_2
    assert_conforms(kind, network, state)
    values = kind(network).values(state)[:2, 1:-1]
    np.testing.assert_array_equal(values, [[1.0, -2.0, 3.0], [4.0, 5.0, 0.0]])
    drives = kind(network).drives(state)
    np.testing.assert_allclose(drives, [[5.5, 0.0, 0.5], [84.0, 15.0, 0.0]])


@every_evaluator
@pytest.mark.parametrize("template", Template)
def test_a_bias_is_one_wherever_it_comes_from(kind, template):
    cell = Cell(neurons=(Neuron(name="x"),), connections=(wire("one", "x", 2.0, template),))
    rhs = kind(Network(cell=cell, stages=3)).rhs(np.zeros(3))
    np.testing.assert_array_equal(rhs, [2.0, 2.0, 2.0])


@every_evaluator
@pytest.mark.parametrize(("offset", "weight"), [(-2, 2.0), (3, 1.0)])
def test_a_bias_from_beyond_the_ends_does_not_exist(kind, offset, weight):
    cell = Cell(neurons=(Neuron(name="x"),), connections=(wire("one", "x", weight, offset),))
    rhs = kind(Network(cell=cell, stages=4)).rhs(np.zeros(4))
    expected = [-1 <= k + offset <= 4 for k in range(4)]
    np.testing.assert_array_equal(rhs, weight * np.array(expected))


@every_evaluator
@pytest.mark.parametrize("stages", [1, 2, 5])
def test_a_sum_may_pass_on_what_a_neighbour_hears(stages, kind):
    """s_k = x_{k+1} and x_k' = s_{k+1}: two cells away, as S9 wires it; the row ends in zeros."""
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Sum(name="s"),),
        connections=(wire("x", "s", 1.0, Template.NEXT), wire("s", "x", 1.0, Template.NEXT)),
    )
    ours, x = kind(Network(cell=cell, stages=stages)), np.arange(1.0, stages + 1)
    np.testing.assert_array_equal(ours.drive_jacobian(x).toarray(), np.eye(stages, k=2))
    np.testing.assert_array_equal(ours.rhs(x), np.eye(stages, k=2) @ x)


@every_evaluator
@pytest.mark.parametrize("name", SUITE)
@pytest.mark.sampled
def test_a_cell_talks_to_its_neighbours_only(name, kind):
    network = small(name)
    jacobian = kind(network).drive_jacobian(near_start(network, 4)).toarray()
    stage = network.places[:, 1]
    assert not jacobian[np.abs(stage[:, None] - stage) > 1].any()
    assert jacobian[np.abs(stage[:, None] - stage) == 1].any()


# ---- neurons that all cells share ----------------------------------------------------------------


def row_with_a_bus(**shared) -> Network:
    """x_k' = y - x_k and y' = sum of k^2 x_k - y, of which there is one."""
    home = np.array([0.0, 0.0, 0.0, 0.0, 1.0])
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y", tau=0.5, shared=True, **shared)),
        blocks=(Product(name="p", a="x", b="x"),),
        connections=(
            wire("x", "x", -1.0),
            wire("y", "x"),
            wire("p", "y", np.arange(5.0) ** 2),
            wire("y", "y", -home),
        ),
    )
    return Network(cell=cell, stages=5)


@every_evaluator
def test_all_cells_read_a_shared_neuron_and_send_to_it(kind):
    network, x, y = row_with_a_bus(), np.arange(1.0, 6.0), 7.0
    state = np.append(x, y)
    assert network.size == 6
    assert [network.label(i) for i in (4, 5)] == ["x[4]", "y[4]"]
    assert_conforms(kind, network, state)
    np.testing.assert_array_equal(network.unpack(state)[1], np.full(5, y))
    expected = [*(y - x), ((np.arange(5) * x) ** 2).sum() - y]
    np.testing.assert_allclose(network.pack(kind(network).drives(state)), expected)
    np.testing.assert_allclose(kind(network).rhs(state), [*expected[:-1], 2 * expected[-1]])


@every_evaluator
@pytest.mark.parametrize("high", [7.0, 8.0])
def test_a_shared_neuron_has_rails_like_any_other(kind, high):
    network, state = row_with_a_bus(limiter=Limiter(high=high)), np.arange(1.0, 7.0)
    state[-1] = 7.0
    assert (kind(network).rhs(state)[-1] == 0.0) == (high == 7.0)
    reference = evaluator(network)
    assert_close(kind(network).rhs(state), reference.rhs(state))
    assert_close(kind(network).jacobian_entries(state), reference.jacobian_entries(state))


def shared_row(*connections, blocks=(), **more) -> Network:
    neurons = (Neuron(name="x"), Neuron(name="y", shared=True))
    cell = Cell(neurons=neurons, blocks=blocks, connections=connections, **more)
    return Network(cell=cell, stages=3)


@pytest.mark.parametrize(
    "connections",
    [[wire("x", "y", 1.0, Template.NEXT)], [wire("y", "x", 1.0, Template.PREVIOUS)]],
)
def test_a_bus_is_no_wire_to_a_neighbour(connections):
    with pytest.raises(NetworkError, match="the neuron is shared by all cells"):
        shared_row(*connections)


def test_shared_neurons_read_each_other_in_their_own_cell():
    square = (Product(name="s", a="y", b="x"),)
    with pytest.raises(NetworkError, match="y: the inputs from all cells"):
        evaluator(shared_row(wire("s", "y"), blocks=square))
    evaluator(shared_row(wire("s", "y", [0.0, 0.0, 1.0]), blocks=square))


def test_a_shared_neuron_is_at_no_end_and_in_no_chain():
    network = shared_row(wire("x", "y"))
    with pytest.raises(NetworkError, match="the neuron is shared by all cells"):
        replace(network, omitted=(Omitted(neuron="y", stage=0),))
    with pytest.raises(NetworkError, match="chains: y is shared"):
        shared_row(wire("x", "y"), chains=(("x", "y"),))


# ---- rails ---------------------------------------------------------------------------------------


def one_block(function: str, **neuron) -> Network:
    """One neuron that follows g of itself."""
    cell = Cell(
        neurons=(Neuron(name="x", **neuron),),
        blocks=(Function(name="g", function=function, x="x"),),
        connections=(wire("g", "x"),),
    )
    return Network(cell=cell, stages=1)


@every_evaluator
@pytest.mark.parametrize("drive", [-1.0, 1.0])
def test_a_rail_stops_what_pushes_outward(drive, kind):
    cell = Cell(
        neurons=(Neuron(name="x", limiter=Limiter(low=-2.0, high=3.0)),),
        inputs=("drive",),
        connections=(wire("drive", "x"),),
    )
    network = Network(cell=cell, stages=5, inputs={"drive": drive})
    x = np.array([-2.5, -2.0, 0.0, 3.0, 3.5])
    expected = np.where((x <= -2) & (drive < 0) | (x >= 3) & (drive > 0), 0.0, drive)
    np.testing.assert_array_equal(kind(network).drives(x), [expected])
    np.testing.assert_array_equal(kind(network).rhs(x), expected)


@every_evaluator
@pytest.mark.parametrize("wired", [small, coordinated])
@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
@pytest.mark.sampled
def test_rails_hold_coordinators_too(name, wired, kind):
    assert_stops_at_rails(kind, wired(name))


@every_evaluator
@every_preconditioner
@pytest.mark.parametrize("name", ["car", "double_integrator", "van_der_pol"])
@pytest.mark.sampled
def test_rails_hold_every_preconditioner(name, preconditioner, kind):
    assert_stops_at_rails(kind, wired_with(name, preconditioner))


def assert_stops_at_rails(kind: type[Evaluator], network: Network, size: float = 0.5) -> None:
    rails = Limiter(low=-size, high=size)
    neurons = tuple(replace(n, limiter=rails) for n in network.cell.neurons)
    network = replace(network, cell=replace(network.cell, neurons=neurons))
    x = np.random.default_rng(7).uniform(-2 * size, 2 * size, network.size).clip(-size, size)
    ours, reference = kind(network), evaluator(network)
    assert 0 < (np.abs(x) == size).sum() < x.size
    assert_close(ours.drives(x), reference.drives(x))
    assert_close(ours.residuals(x), reference.residuals(x))
    assert not ours.rhs(x)[(x == size) & (ours.rhs(x) > 0)].any()
    assert not ours.rhs(x)[(x == -size) & (ours.rhs(x) < 0)].any()
    saturated = reference.saturated(x, reference.drives(x))
    packed = lambda states: network.pack(reference.drives(states))  # noqa: E731
    jacobian = ours.drive_jacobian(x).toarray()
    assert saturated.any()
    assert not jacobian[saturated].any()
    assert_close(jacobian[~saturated], complex_step(packed, x)[~saturated])
    assert_close(ours.rhs(x), reference.rhs(x))


@every_evaluator
def test_a_neuron_at_its_rail_has_no_row(kind):
    network = one_block("exp", limiter=Limiter(high=1.0))
    assert kind(network).drive_jacobian(np.array([1.0])).toarray().tolist() == [[0.0]]
    free = kind(network).drive_jacobian(np.array([0.5])).toarray()
    np.testing.assert_allclose(free, [[np.exp(0.5)]])


# ---- residuals -----------------------------------------------------------------------------------


@every_evaluator
@pytest.mark.parametrize("size", [0.0, 1e-6, 1e-2])
def test_residuals_have_a_floor(size, kind):
    """At zero they are no longer relative to what is there, but to a floor."""
    network = small("double_integrator").with_inputs({"q_d.x": size})
    x = size * near_start(network, 17)
    assert_close(kind(network).residuals(x), evaluator(network).residuals(x))
    if size == 0.0:
        x = np.zeros(network.size)
        x[network.state_index[network.neuron_index["u.a"], 0]] = FLOOR / 10
        drives = network.unpack(np.zeros(network.size)) * 0 + kind(network).drives(x)
        duals = [network.neuron_index[dual.neuron] for dual in network.cell.duals]
        expected = np.abs(drives[duals]).max() / SMALLEST_POSITION
        assert kind(network).residuals(x)[0] == pytest.approx(expected)


@every_evaluator
def test_a_network_that_is_no_optimiser_has_a_residual_too(kind):
    cell = Cell(neurons=(Neuron(name="x"),), connections=(wire("x", "x", -3.0),))
    ours = kind(Network(cell=cell, stages=2))
    assert ours.residuals(np.array([0.1, -0.2])) == (0.0, pytest.approx(0.6))  # |x| < 1
    assert ours.residuals(np.array([4.0, 2.0])) == (0.0, pytest.approx(3.0))


@every_evaluator
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_a_drive_that_is_no_number_makes_both_residuals_infinite(wrong, kind):
    network = small("car")
    x = near_start(network, 3)
    x[network.state_index[network.neuron_index["u.nu"], 1]] = wrong
    with np.errstate(invalid="ignore"):
        assert kind(network).residuals(x) == (np.inf, np.inf)


# ---- function blocks and their domains -----------------------------------------------------------


@every_evaluator
@pytest.mark.parametrize("block", FUNCTIONS, ids=lambda block: block.name)
@settings(max_examples=25, deadline=None)
@given(share=st.floats(0.05, 0.95))
@pytest.mark.sampled(4)
def test_function_blocks(block, kind, share):
    low, high = np.clip(block.domain, -2.0, 2.0)
    network, x = one_block(block.name), np.array([low + share * (high - low)])
    if abs(x[0]) < 1e-3:  # the pole of 1/x, the corner of the rectifier
        return
    ours = kind(network)
    assert_close(ours.rhs(x), block.value(x), 1e-14)
    slope = block.slope(x, block.value(x))
    assert_close(ours.drive_jacobian(x).toarray(), [slope], 1e-14)
    assert_close([slope], complex_step(evaluator(network).rhs, x))


@every_evaluator
def test_function_blocks_are_the_textbook_functions(kind):
    known = {block.name: getattr(np, block.name, None) for block in FUNCTIONS}
    known |= {"reciprocal": lambda x: 1 / x, "rectify": lambda x: np.maximum(x, 0)}
    known |= {"sigmoid": lambda x: 1 / (1 + np.exp(-x))}
    known |= {"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan}
    for name, function in known.items():
        x = np.array([0.3])
        np.testing.assert_allclose(kind(one_block(name)).rhs(x), function(x), rtol=1e-14)


@every_evaluator
@pytest.mark.parametrize("wrong", [-2.0, 0.0])
def test_a_rectifier_cuts_off(wrong, kind):
    ours = kind(one_block("rectify"))
    assert ours.rhs(np.array([wrong])) == 0.0
    assert np.isnan(ours.rhs(np.array([np.nan])))  # what is no number is not hidden


@every_evaluator
@pytest.mark.parametrize("block", FUNCTIONS, ids=lambda block: block.name)
def test_domains_are_open(block, kind):
    ours = kind(one_block(block.name))
    low, high = block.domain
    inside = 0.5 * (max(low, -1.0) + min(high, 1.0)) or 0.5
    guard = ours.domain_guard(np.array([inside]))
    assert ours.outside(np.array([inside]), guard) == (-1, -1)
    for end in {low, high} - {-np.inf, np.inf}:
        for beyond in (end, end + (0.1 if end == high else -0.1)):
            with np.errstate(all="ignore"):
                assert ours.outside(np.array([beyond]), guard) == (0, 0)
        just_inside = end - 1e-9 if end == high else end + 1e-9
        assert ours.outside(np.array([just_inside]), guard) == (-1, -1)


@every_evaluator
@pytest.mark.parametrize("start", [-0.5, 0.5])
def test_a_reciprocal_keeps_its_side_of_the_pole(start, kind):
    ours = kind(one_block("reciprocal"))
    guard = ours.domain_guard(np.array([start]))
    assert ours.outside(np.array([3 * start]), guard) == (-1, -1)
    with np.errstate(divide="ignore"):
        assert ours.outside(np.array([0.0]), guard) == (0, 0)
        assert ours.outside(np.array([-start]), guard) == (0, 0)
        assert ours.outside(np.zeros(1), ours.domain_guard(np.zeros(1))) == (0, 0)


@every_evaluator
def test_the_first_block_and_stage_outside_are_named(kind):
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(
            Function(name="f", function="exp", x="x"),
            Function(name="g", function="sqrt", x="x"),
            Function(name="h", function="log", x="y"),
        ),
        connections=(wire("f", "x"), wire("g", "x"), wire("h", "y")),
    )
    network = Network(cell=cell, stages=3)
    ours, state = kind(network), lambda x, y: network.pack(np.array([x, y]))
    guard = ours.domain_guard(state(np.ones(3), np.ones(3)))
    with np.errstate(invalid="ignore"):
        assert ours.outside(state([1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]), guard) == (1, 2)
        assert ours.outside(state(np.ones(3), [1.0, -1.0, -1.0]), guard) == (2, 1)
