"""Defects against closed forms on networks of one or two neurons, and on the paper's car."""

import functools
import re
from dataclasses import replace

import numpy as np
import pytest
from designs import coordinated, designed, near_start, small
from hypothesis import given, settings, strategies as st
from problems import SUITE
from scipy.integrate import solve_ivp

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.linearisation import Linearisation
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.settling import Settling
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.status import Outcome
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.procedure import Design, design
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.nonidealities.numbers import (
    detuned,
    gain_error,
    leak,
    mismatch,
    offset,
    quantised,
)
from ann_dc.hardware.nonidealities.parts import extra_pole, noise, saturation, slew
from ann_dc.hardware.parts.e_series import E12, E24, E96
from ann_dc.hardware.parts.levels import macro
from ann_dc.network.cell import (
    ONE,
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Sum,
    Template,
)
from ann_dc.network.ends import FixedNeuron, Omitted
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.selection import EVERYWHERE, Selection
from ann_dc.solver import synthesize
from ann_dc.weights.network_file import load, save

NONE = {
    "leak": lambda n, where: leak(n, np.inf, where),
    "extra_pole": lambda n, where: extra_pole(n, np.inf, where),
    "offset": lambda n, where: offset(n, 0.0, where),
    "offset drawn": lambda n, where: offset(n, 0.0, where, seed=1),
    "mismatch": lambda n, where: mismatch(n, 0.0, where, seed=1),
    "detuned": lambda n, where: detuned(n, 0.0, where, seed=1),
    "quantised": lambda n, where: quantised(n, where),
    "gain_error": lambda n, where: gain_error(n, 0.0, where),
    "gain_error drawn": lambda n, where: gain_error(n, 0.0, where, seed=1),
    "rails": lambda n, where: saturation(n, np.inf, where),
    "rails by name": lambda n, where: saturation(n, {"q.x": np.inf}, where),
    "slew": lambda n, where: slew(n, np.inf, where),
    "noise": lambda n, where: noise(n, 0.0, where),
}
"""No defect."""

SMALL = {
    "leak": lambda n, where: leak(n, 1e4, where),
    "extra_pole": lambda n, where: extra_pole(n, 15.0, where),
    "offset": lambda n, where: offset(n, 1e-4, where),
    "offset drawn": lambda n, where: offset(n, 1e-4, where, seed=1),
    "mismatch": lambda n, where: mismatch(n, 1e-3, where, seed=1),
    "detuned": lambda n, where: detuned(n, 1e-3, where, seed=1),
    "bits": lambda n, where: quantised(n, where, bits=8),
    "series": lambda n, where: quantised(n, where, series=E96),
    "gain_error": lambda n, where: gain_error(n, 1e-3, where),
    "gain_error drawn": lambda n, where: gain_error(n, 1e-3, where, seed=1),
    "slew": lambda n, where: slew(n, 5.0, where),
    "noise": lambda n, where: noise(n, 0.1, where),
}
"""Defects that leave the solution nearby."""


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


def row(*connections: Connection, blocks=(), names=("x",), stages=1, **fields) -> Network:
    cell = Cell(
        neurons=tuple(Neuron(name=name) for name in names),
        blocks=tuple(blocks),
        connections=connections,
        inputs=tuple(fields.get("inputs", ())),
    )
    return Network(cell=cell, stages=stages, **fields)


def weights(network: Network) -> dict[str, np.ndarray]:
    return {c.name: np.broadcast_to(c.weight, network.stages) for c in network.cell.connections}


LAG = row(wire("x", "x", -1.0), wire(ONE, "x", 2.0))
"""x' = 2 - x."""


@functools.cache
def car_design() -> Design:
    """The paper's car without coordinators."""
    return design(synthesize(SUITE["car"].problem), preconditioner=(PreconditionerKind.DIAGONAL,))


@functools.cache
def car() -> Network:
    """The same, started where it rests."""
    network = car_design().network
    return network.with_start(equilibrium(network, car_design().state))


def moved_controls(network: Network) -> float:
    """Largest change of the car's controls at rest, of the largest of them."""
    u = car().start_state[car().of_population("u")]
    now = equilibrium(network, network.start_state)[network.of_population("u")]
    return np.abs(now - u).max() / np.abs(u).max()


def changed(before: Network, after: Network) -> dict[str, list[int]]:
    """Stages at which weights differ, by connection; what is new differs from zero."""
    none = np.zeros(before.stages)
    old, new = weights(before), weights(after)
    stages = {n: np.flatnonzero(old.get(n, none) != new.get(n, none)) for n in old | new}
    return {name: found.tolist() for name, found in stages.items() if found.size}


# ---- no defect -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "where",
    [EVERYWHERE, Selection(populations=("mu",)), Selection(populations=()), Selection(names=())],
)
@pytest.mark.parametrize("defect", NONE)
def test_no_defect_is_the_identity(defect, where):
    network = small("car")
    if defect.startswith("gain") and where.populations:
        where = Selection(populations=("product",))
    assert NONE[defect](network, where) is network


@pytest.mark.parametrize(
    "where", [Selection(populations=()), Selection(stages=()), Selection(names=())]
)
@pytest.mark.parametrize("defect", SMALL)
def test_chosen_nowhere(defect, where):
    network = small("car")
    assert SMALL[defect](network, where) is network


# ---- where ---------------------------------------------------------------------------------------

UNKNOWN = {
    "population": (
        Selection(populations=("nu",)),
        "where: population 'nu' does not exist; choose one",
    ),
    "name": (Selection(names=("mu.z",)), "where: name 'mu.z' does not exist; choose one of: .*"),
    "stage": (
        Selection(stages=(4,)),
        re.escape("where: stage '4' does not exist; choose one of: 0, 1, 2, 3"),
    ),
    "last stage from behind": (Selection(stages=(-1,)), "stage '-1'"),
}


@pytest.mark.parametrize("nonidealities", [NONE, SMALL], ids=["none", "small"])
@pytest.mark.parametrize("defect", sorted(NONE.keys() & SMALL.keys()))
@pytest.mark.parametrize("case", UNKNOWN)
def test_what_does_not_exist_is_told(case, defect, nonidealities):
    where, message = UNKNOWN[case]
    with pytest.raises(UnknownNameError, match=message):
        nonidealities[defect](small("car"), where)


def test_the_error_lists_what_there_is():
    with pytest.raises(UnknownNameError, match=r"one of: beta, mu, q, t, u$"):
        leak(small("car"), 1e3, Selection(populations=("product",)))
    with pytest.raises(UnknownNameError, match=r"one of: function, product$"):
        gain_error(small("car"), 0.1, Selection(populations=("u",)))


@pytest.mark.parametrize("field", ["populations", "stages", "names"])
def test_a_choice_is_a_tuple(field):
    with pytest.raises(NetworkError, match=f"where, {field}: expected a tuple, got 'mu'"):
        Selection(**{field: "mu"})


OUT_OF_RANGE = {
    "gain of zero": (lambda n: leak(n, 0.0), "gain: expected a positive number.*got 0.0"),
    "gain that is no number": (lambda n: leak(n, np.nan), "gain: expected"),
    "negative bandwidth": (lambda n: extra_pole(n, -1.0), "bandwidth: expected a positive"),
    "infinite offset": (lambda n: offset(n, np.inf), "size: expected a finite number, got inf"),
    "infinite mismatch": (lambda n: mismatch(n, np.inf, seed=0), "relative: expected a finite"),
    "no bits": (lambda n: quantised(n, bits=0), "bits: expected 1 or more.*got 0"),
    "gain error": (lambda n: gain_error(n, np.nan), "relative: expected a finite"),
    "rails at zero": (lambda n: saturation(n, 0.0), "limit of x: expected a positive"),
    "rails of one at zero": (lambda n: saturation(n, {"x": -1.0}), "limit of x: expected"),
    "rails at one stage": (lambda n: saturation(n, 1.0, Selection(stages=())), "omit stages"),
    "rate of zero": (lambda n: slew(n, 0.0), "rate: expected a positive number"),
    "infinite noise": (lambda n: noise(n, np.inf), "density: expected a finite number"),
}


@pytest.mark.parametrize("case", OUT_OF_RANGE)
def test_strengths_out_of_range(case):
    defect, message = OUT_OF_RANGE[case]
    with pytest.raises(NetworkError, match=message):
        defect(LAG)


def test_rails_of_an_unknown_neuron():
    with pytest.raises(UnknownNameError, match=r"limit: neuron 'y' does not exist; .*: x"):
        saturation(LAG, {"y": 1.0})


CHOICES = {
    "population": (Selection(populations=("u",)), lambda name, k: name.startswith("u.")),
    "stages": (Selection(stages=(0, 3)), lambda name, k: k in (0, 3)),
    "name": (Selection(names=("mu.phi",)), lambda name, k: name.startswith("mu.phi<-")),
    "all of them": (
        Selection(populations=("mu", "u"), stages=(2,), names=("mu.phi", "q.x")),
        lambda name, k: name.startswith("mu.phi<-") and k == 2,
    ),
}


@pytest.mark.parametrize("defect", ["leak", "offset drawn", "mismatch", "noise"])
@pytest.mark.parametrize("case", CHOICES)
def test_only_what_is_chosen_changes(case, defect):
    where, chosen = CHOICES[case]
    everywhere = changed(small("car"), SMALL[defect](small("car"), EVERYWHERE))
    expected = {n: [k for k in found if chosen(n, k)] for n, found in everywhere.items()}
    expected = {name: stages for name, stages in expected.items() if stages}
    assert changed(small("car"), SMALL[defect](small("car"), where)) == expected


@pytest.mark.parametrize("defect", [offset, mismatch, gain_error])
def test_draws_do_not_depend_on_what_else_is_chosen(defect):
    network = small("car")
    drawn = weights(defect(network, 0.1, seed=3))
    again = weights(defect(network, 0.1, Selection(stages=(1, 2)), seed=3))
    other = weights(defect(network, 0.1, seed=4))
    for name in weights(network):
        np.testing.assert_array_equal(again[name][1:3], drawn[name][1:3])
    assert any((other[name] != drawn[name]).any() for name in drawn)


def test_one_connection_and_all_of_a_target():
    network = small("car")
    one = mismatch(network, 0.1, Selection(names=("u.nu<-u.nu",)), seed=0)
    assert changed(network, one) == {"u.nu<-u.nu": [0, 1, 2, 3]}
    both = mismatch(network, 0.1, Selection(names=("t.x",)), seed=0)
    assert changed(network, both).keys() == {"t.x<-m.x", "t.x<-b.x@next"}


# ---- leak ----------------------------------------------------------------------------------------


@given(gain=st.floats(1.0, 1e8))
def test_a_leak_leaves_a_direct_current_error(gain):
    """x' = 2 - x - 3 x / A0: both resistors load the integrator."""
    np.testing.assert_allclose(equilibrium(leak(LAG, gain), np.zeros(1)), 2 / (1 + 3 / gain))


def test_a_leak_settles_to_it():
    run = OdeBackend(verify=False).run(leak(LAG, 100.0))
    np.testing.assert_allclose(run.trajectory.final, 2 / 1.03, rtol=1e-6)


def test_full_scales_weigh_wires():
    network = row(wire("x", "x", -1.0), wire("y", "x", -3.0), names=("x", "y"))
    scaled = leak(network, 10.0, Selection(names=("x",)), unit={"x": 2.0, "y": 4.0})
    np.testing.assert_allclose(weights(scaled)["x<-x"], -1 - (1 + 3 * 2) / 10)


def test_a_pi_dual_is_one_op_amp():
    leaky = weights(leak(small("car"), 100.0, Selection(names=("mu.phi",))))
    into_c = {n: np.abs(w) for n, w in weights(small("car")).items() if n.startswith("c.phi<-")}
    assert len(into_c) == 3
    np.testing.assert_allclose(leaky["mu.phi<-mu.phi"], -sum(into_c.values()) / 100)


def test_a_leak_comes_before_the_slew_rate():
    clipped = slew(LAG, 0.5)
    for network in (leak(clipped, 10.0), slew(leak(LAG, 10.0), 0.5)):
        np.testing.assert_allclose(evaluator(network).rhs([1.6]), 2 - 1.6 * 1.3)
        np.testing.assert_allclose(evaluator(network).rhs([9.0]), -0.5)
    assert changed(clipped, leak(clipped, 10.0)) == {"drive.x<-x": [0]}


@pytest.mark.parametrize("gain", [1e4, 1e5, 1e6])
def test_the_cars_controls_err_as_the_circuits_do(gain):
    """27 / A0 with the full scales of the circuit, 126 / A0 where all are 1 in network units."""
    circuit, _ = SpiceBackend().prepare(car_design().network)
    emulation = emulate(circuit, macro(a0=gain))
    x = equilibrium(emulation.network, emulated_state(emulation, car().start_state))
    u = car().start_state[car().of_population("u")]
    exact = np.abs(emulation.controls(x) - u).max() / np.abs(u).max()
    np.testing.assert_allclose(gain * exact, 27.6, rtol=0.03)
    predicted = moved_controls(leak(car(), gain, unit=circuit.scaling.unit))
    np.testing.assert_allclose(predicted, exact, rtol=0.02)  # the rest is its inverters
    np.testing.assert_allclose(gain * moved_controls(leak(car(), gain)), 125.8, rtol=0.03)


def test_leaks_add_up():
    """To first order the errors of populations are those of all of them together."""
    groups = [("q",), ("t",), ("u",), ("mu",), ("beta",)]
    x = car().start_state
    moves = [equilibrium(leak(car(), 1e6, Selection(populations=g)), x) - x for g in groups]
    together = equilibrium(leak(car(), 1e6), x) - x
    np.testing.assert_allclose(sum(moves), together, atol=1e-3 * np.abs(together).max())


# ---- another pole --------------------------------------------------------------------------------


def test_two_poles_ring():
    """x' = 1 - y, y' = b (x - y): y'' + b y' + b y = b, underdamped for b < 4."""
    b, time = 2.0, np.linspace(0, 8, 41)
    network = extra_pole(row(wire("x", "x", -1.0), wire(ONE, "x")), b)
    assert [n.name for n in network.cell.neurons] == ["x", "slow.x"]
    w = np.sqrt(b - b * b / 4)
    expected = 1 - np.exp(-b * time / 2) * (np.cos(w * time) + b / (2 * w) * np.sin(w * time))
    found = solve_ivp(
        lambda _, x: evaluator(network).rhs(x),
        (0, 8),
        [0.0, 0.0],
        t_eval=time,
        rtol=1e-10,
        atol=1e-12,
    )
    np.testing.assert_allclose(found.y[1], expected, atol=1e-8)


ENDS = row(
    wire("x", "x", -1.0),
    wire("x", "y", 0.5, Template.PREVIOUS),
    wire("x", "y", 0.25, Template.NEXT),
    wire("p", "y", 0.125, Template.PREVIOUS),
    wire("f", "s"),
    wire("s", "y"),
    wire("y", "y", -1.0),
    blocks=(
        Product(name="p", a="x", b="x"),
        Function(name="f", function="tanh", x="p"),
        Sum(name="s"),
    ),
    names=("x", "y"),
    stages=3,
    inputs={"drive": [1.5, 2.5, 3.5], "end": 7.0},
    left_boundary={"x": "end", "p": "drive"},
    fixed=(FixedNeuron(neuron="x", stage=1, input="drive"),),
    omitted=(Omitted(neuron="x", stage=2),),
    start={"x": 0.75, "y": 0.5},
)
"""Everything that an end of a row may have."""


@pytest.mark.parametrize("stages", [None, (0,), (1,), (2,), (0, 1)])
@pytest.mark.parametrize("node", ["x", "p", "f", "s", "y"])
def test_slow_nodes_keep_their_ends(node, stages):
    """At rest, which is where they start, slow nodes say what the nodes said."""
    slow = extra_pole(ENDS, 9.0, Selection(names=(node,), stages=stages))
    x = slow.start_state
    old, new = evaluator(ENDS).drives(ENDS.start_state), evaluator(slow).drives(x)
    np.testing.assert_allclose(new[:2], old)
    assert not new[2:].any()
    row_of, live = slow.neuron_index[f"slow.{node}"], np.isin(range(3), stages or range(3))
    if node == "x":
        live &= [True, False, False]
        if stages is None or 1 in stages:
            assert slow.unpack(x)[row_of, 1] == 2.5
    np.testing.assert_array_equal(slow.live[row_of], live)


def test_a_pin_arrives_whatever_the_input():
    slow = extra_pole(ENDS, 9.0, Selection(names=("x",))).with_inputs({"drive": -4.0, "end": 1.0})
    moved = ENDS.with_inputs({"drive": -4.0, "end": 1.0})
    expected = evaluator(moved).drives(moved.start_state)[1]
    np.testing.assert_allclose(evaluator(slow).drives(slow.start_state)[1], expected)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_poles_do_not_move_the_rest(data):
    network = car()
    nodes = [n.name for n in (*network.cell.neurons, *network.cell.blocks)]
    names = data.draw(st.lists(st.sampled_from(nodes), min_size=1, max_size=5, unique=True))
    stages = data.draw(st.none() | st.lists(st.integers(0, 8), min_size=1, unique=True).map(tuple))
    slow = extra_pole(network, 30.0, Selection(names=tuple(names), stages=stages))
    assert np.abs(evaluator(slow).rhs(slow.start_state)).max() < 1e-9
    assert moved_controls(slow) < 1e-9


def test_slow_residuals_keep_their_penalty():
    """rho is still found, and taking it away gives the Jacobian of the plain Lagrangian."""
    slow = extra_pole(coordinated("car"), 40.0)
    dual = next(d for d in slow.cell.duals if d.neuron == "mu.x")
    assert (dual.residual, dual.multiplier) == ("slow.c.x", "m.x")
    before = weights(coordinated("car"))["m.x<-c.x"]
    np.testing.assert_array_equal(weights(slow)[dual.path], before)
    assert all(d.path in evaluator(slow).edges for d in slow.cell.duals)
    assert slow.cell.chains == coordinated("car").cell.chains
    assert slow.preconditioner is coordinated("car").preconditioner


@pytest.mark.slow
def test_bookkeeping_of_every_defect():
    network = coordinated("car")
    for defect in SMALL.values():
        after = defect(network, Selection(stages=(1, 2)))
        assert all(d.path in evaluator(after).edges for d in after.cell.duals)
        assert after.cell.chains == network.cell.chains
        assert after.preconditioner is network.preconditioner
        assert [n.role for n in after.cell.neurons][:18] == [n.role for n in network.cell.neurons]
        assert np.isfinite(Linearisation(after).at(after.start_state).cost_curvature()).all()


# ---- numbers -------------------------------------------------------------------------------------


def test_offset_shifts_rest():
    x = equilibrium(offset(LAG, 0.25), np.zeros(1))
    np.testing.assert_allclose(x, 2.25)
    assert changed(LAG, offset(LAG, 0.25)) == {"x<-one": [0]}


def test_drawn_offsets_have_their_size():
    network = row(wire("x", "x", -1.0), stages=4000)
    drawn = weights(offset(network, 0.2, seed=7))["x<-one"]
    np.testing.assert_allclose([drawn.mean(), drawn.std()], [0.0, 0.2], atol=0.01)


def test_offset_of_a_residual_is_an_error_of_the_constraint():
    at = Selection(names=("c.phi",))
    x = equilibrium(offset(car(), 1e-3, at), car().start_state)
    np.testing.assert_allclose(evaluator(car()).node(x, "c.phi"), -1e-3, atol=1e-9)
    np.testing.assert_allclose(evaluator(car()).node(x, "c.x"), 0.0, atol=1e-9)


def test_mismatch_has_its_size():
    network = row(wire("x", "x", -2.0), wire(ONE, "x", 0.0), stages=4000)
    drawn = weights(mismatch(network, 0.05, seed=7))
    np.testing.assert_allclose(drawn["x<-x"].mean(), -2.0, atol=5e-3)
    np.testing.assert_allclose(drawn["x<-x"].std(), 0.1, rtol=0.05)
    assert not drawn["x<-one"].any()


PREFERRED = [
    (E24, 0.99, 1.0),
    (E24, -0.99, -1.0),
    (E24, 2.06, 1 / 0.47),
    (E24, 2.5, 1 / 0.39),
    (E24, 0.0457, 1 / 22),
    (E24, 9.7e3, 1e4),
    (E24, 0.0, 0.0),
    (E12, 2.06, 1 / 0.47),
    (E12, 5.2e-7, 1 / 1.8e6),
    (E96, 0.99, 1 / 1.02),
    (E96, 2.5, 1 / 0.402),
]


@pytest.mark.parametrize(("series", "weight", "expected"), PREFERRED)
def test_preferred_values(series, weight, expected):
    after = quantised(row(wire("x", "x", weight)), series=series)
    np.testing.assert_allclose(weights(after)["x<-x"], expected, rtol=1e-12)


def test_series_of_the_standard():
    assert [len(series.mantissas) for series in (E12, E24, E96)] == [12, 24, 96]
    assert E12.mantissas[:4] == (1.0, 1.2, 1.5, 1.8)
    assert E96.mantissas[:4] == (1.0, 1.02, 1.05, 1.07)
    assert E96.mantissas[-2:] == (9.53, 9.76)


@given(
    weight=st.floats(1e-6, 1e6).flatmap(lambda w: st.sampled_from([w, -w])),
    series=st.sampled_from([E12, E24, E96]),
)
def test_no_other_preferred_value_is_nearer(weight, series):
    network = row(wire("x", "x", weight))
    once = quantised(network, series=series)
    there = 1 / np.array([v * 10.0**d for v in series.mantissas for d in range(-8, 9)])
    nearest = np.abs(np.log(there / abs(weight))).min()
    found = weights(once)["x<-x"][0]
    assert np.sign(found) == np.sign(weight)
    assert abs(np.log(found / weight)) <= nearest + 1e-9
    assert quantised(once, series=series) is once


@given(weight=st.floats(-1e6, 1e6), bits=st.integers(1, 60))
def test_significant_bits(weight, bits):
    network = row(wire("x", "x", weight))
    found = weights(quantised(network, bits=bits))["x<-x"][0]
    assert abs(found - weight) <= 2.0**-bits * abs(weight)
    mantissa, _ = np.frexp(found)
    assert bits >= 53 or (mantissa * 2**bits).is_integer()


def test_equal_weights_stay_equal():
    network = row(wire("x", "x", [0.3, 0.7, 0.3]), wire(ONE, "x", 0.7), stages=3)
    after = weights(quantised(network, bits=2))
    assert after["x<-x"].tolist() == [0.25, 0.75, 0.25]
    assert after["x<-one"].tolist() == [0.75] * 3


# ---- products and functions ----------------------------------------------------------------------

BLOCKS = row(
    wire("p", "x"),
    wire("f", "x", 2.0),
    wire("p", "y", 3.0, Template.PREVIOUS),
    wire("pf", "y"),
    blocks=(
        Product(name="p", a="x", b="y"),
        Function(name="f", function="tanh", x="p"),
        Product(name="pf", a="p", b="f"),
    ),
    names=("x", "y"),
    stages=2,
    inputs={"end": 5.0},
    left_boundary={"p": "end"},
)
"""A product that a sum, a function, a product and the next cell read; the first reads an input."""


def blocks_drive(x, y, p_gain, f_gain):
    p, f = p_gain * x * y, f_gain * np.tanh(p_gain * x * y)
    before = np.array([5.0, p[0]])
    return np.array([p + 2 * f, 3 * before + p * f])


@pytest.mark.parametrize("stages", [None, (0,), (1,)])
def test_gain_errors_of_products_and_functions(stages):
    x, y = np.array([[0.3, 0.9], [0.7, -0.4]])
    there = np.isin([0, 1], stages or (0, 1))
    state = BLOCKS.pack(np.array([x, y]))
    for names in [("p",), ("f",), ("p", "f")]:
        off = gain_error(BLOCKS, 0.1, Selection(names=names, stages=stages))
        gains = [1 + 0.1 * there * (name in names) for name in ("p", "f")]
        np.testing.assert_allclose(evaluator(off).drives(state), blocks_drive(x, y, *gains))
    both = gain_error(gain_error(BLOCKS, 0.1), -0.2)
    gain = np.full(2, 1.1 * 0.8)
    expected = blocks_drive(x, y, gain, gain)
    expected[1] += (gain - 1) * (expected[1] - 3 * np.array([5.0, gain[0] * x[0] * y[0]]))
    np.testing.assert_allclose(evaluator(both).drives(state), expected)


def test_only_what_blocks_read_costs_a_sum():
    off = gain_error(BLOCKS, 0.1)
    assert [b.name for b in off.cell.blocks] == ["p", "gain.p", "f", "gain.f", "pf"]
    assert {c.name for c in BLOCKS.cell.connections} <= weights(off).keys()


# ---- limits --------------------------------------------------------------------------------------


def test_rails_stop():
    run = OdeBackend(verify=False).run(saturation(LAG, 0.5))
    np.testing.assert_allclose(run.trajectory.final, 0.5, atol=1e-3)
    assert (run.trajectory.states <= 0.5 + 1e-3).all()


def test_tighter_rails_stay():
    limited = Neuron(name="x", limiter=Limiter(low=-0.1, high=3.0))
    network = Network(cell=Cell(neurons=(limited, Neuron(name="y"))), stages=1)
    after = saturation(network, {"x": 1.0, "y": np.inf})
    found = [(n.limiter.low, n.limiter.high) for n in after.cell.neurons]
    assert found == [(-0.1, 1.0), (-np.inf, np.inf)]


def test_rails_that_leave_no_room():
    limited = Neuron(name="x", limiter=Limiter(low=2.0))
    with pytest.raises(NetworkError, match=r"x: limits 2.0 .. 1.0: expected low < high"):
        saturation(Network(cell=Cell(neurons=(limited,)), stages=1), 1.0)


def test_rails_of_a_population_move_its_start():
    network = car().with_start(np.full(car().size, 5.0))
    after = saturation(network, 2.0, Selection(populations=("u",)))
    u = after.of_population("u")
    assert (after.start_state[u] == 2.0).all()
    assert (after.start_state[~u] == 5.0).all()
    stopped = [n.name for n in after.cell.neurons if n.limiter.high == 2.0]
    assert stopped == ["u.nu", "u.eta"]


def test_a_slew_rate_is_a_ramp():
    """x' = clip(10 - x) at rate 2: 2 s up to x = 8, then 10 - 2 exp(-(s - 4))."""
    network = slew(row(wire("x", "x", -1.0), wire(ONE, "x", 10.0)), 2.0)
    time = np.linspace(0, 10, 21)
    found = solve_ivp(
        lambda _, x: evaluator(network).rhs(x), (0, 10), [0.0], t_eval=time, rtol=1e-9, max_step=0.1
    )
    expected = np.where(time < 4, 2 * time, 10 - 2 * np.exp(-np.maximum(time - 4, 0)))
    np.testing.assert_allclose(found.y[0], expected, atol=1e-4)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(
    rate=st.floats(1e-3, 1e3),
    seed=st.integers(0, 99),
    stages=st.none() | st.just((0, 2)),
)
def test_speeds_are_clipped(rate, seed, stages):
    network = replace(coordinated("car"), preconditioner=Diagonal())
    x = near_start(network, seed)
    before, after = (
        evaluator(network).rhs(x),
        evaluator(slew(network, rate, Selection(stages=stages))).rhs(x),
    )
    clipped = np.clip(before, -rate, rate)
    there = np.isin(network.places[:, 1], stages or range(4))
    scale = max(rate, np.abs(before).max())
    np.testing.assert_allclose(after, np.where(there, clipped, before), atol=1e-12 * scale)


def test_twice_the_slew_rate_is_the_lower_one():
    for rates in [(0.5, 0.2), (0.2, 0.5)]:
        both = slew(slew(LAG, rates[0]), rates[1])
        np.testing.assert_allclose(evaluator(both).rhs([0.0]), 0.2)
        np.testing.assert_allclose(evaluator(both).rhs([1.9]), 0.1)


# ---- noise ---------------------------------------------------------------------------------------


def test_noise_is_silent_until_it_is_fed():
    network = small("car")
    noisy = noise(network, 0.3, Selection(populations=("u",)))
    x = near_start(network, 0)
    np.testing.assert_array_equal(evaluator(noisy).rhs(x), evaluator(network).rhs(x))
    samples = np.array([1.0, -2.0, 0.5, 0.0])
    fed = noisy.with_inputs({"noise.u.nu": samples})
    moved = network.unpack(evaluator(fed).rhs(x) - evaluator(network).rhs(x))
    expected = np.zeros_like(moved)
    expected[network.neuron_index["u.nu"]] = 0.3 * samples
    alive = network.live
    np.testing.assert_allclose(moved[alive], expected[alive], atol=1e-12)


def test_two_sources_of_noise():
    both = noise(noise(LAG, 0.3), 0.4).with_inputs({"noise.x": 1.0, "noise.x.2": 2.0})
    np.testing.assert_allclose(evaluator(both).rhs([0.0]), 2.0 + 0.3 + 0.8)


# ---- together ------------------------------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    nonidealities=st.lists(st.sampled_from(sorted(SMALL)), min_size=1, max_size=4),
    stages=st.none() | st.just((0, 2)),
    seed=st.integers(0, 99),
)
def test_any_of_them_compose(nonidealities, stages, seed):
    """Whatever the order, twice the same too; and the exact Jacobian is that of the drives."""
    network = small("van_der_pol")
    for defect in nonidealities:
        network = SMALL[defect](network, Selection(stages=stages))
    x = near_start(network, seed)
    direction = np.random.default_rng(seed).standard_normal(network.size)
    along = np.imag(evaluator(network).rhs(x + 1e-30j * direction)) / 1e-30
    scale = max(np.abs(along).max(), 1.0)
    np.testing.assert_allclose(evaluator(network).jacobian(x) @ direction, along, atol=1e-9 * scale)


ALL = ("series", "mismatch", "gain_error drawn", "offset drawn", "leak", "extra_pole", "slew")


@functools.cache
def spoiled(name: str, *nonidealities: str) -> Network:
    network = designed(name).network
    for defect in nonidealities:
        network = SMALL[defect](network, EVERYWHERE)
    return network


@pytest.mark.sampled(2)
@pytest.mark.parametrize("nonidealities", [*([d] for d in SMALL), ALL], ids="-".join)
def test_continuous_and_discrete_time_agree(nonidealities):
    network = spoiled("double_integrator", *nonidealities)
    tight = Settling(tolerance=1e-8, confirm=0.1)
    runs = [
        backend(settling=tight).run(network)
        for backend in (functools.partial(OdeBackend, verify=False), RecurrentBackend)
    ]
    assert {run.status.outcome for run in runs} == {Outcome.SETTLED}
    ode, recurrent = (run.trajectory.final for run in runs)
    np.testing.assert_allclose(recurrent, ode, atol=1e-6 * np.abs(ode).max())


def test_the_car_agrees_too():
    """With its coordinators, errors everywhere, and slow controls."""
    network = leak(mismatch(designed("car").network, 1e-3, seed=2), 1e4)
    network = extra_pole(network, 8.0, Selection(populations=("u",)))
    runs = [OdeBackend(verify=False).run(network), RecurrentBackend().run(network)]
    assert all(run.status.settled for run in runs)
    newton = equilibrium(network, runs[0].trajectory.final)
    for run in runs:
        np.testing.assert_allclose(run.trajectory.final, newton, atol=1e-6 * np.abs(newton).max())


@pytest.mark.parametrize("nonidealities", [*([d] for d in SMALL), ALL], ids="-".join)
def test_a_file_keeps_the_dynamics(nonidealities, tmp_path):
    network = saturation(spoiled("double_integrator", *nonidealities), 50.0)
    save(network, tmp_path / "network.npz")
    again = load(tmp_path / "network.npz")
    x = near_start(network, 0)
    np.testing.assert_array_equal(evaluator(again).rhs(x), evaluator(network).rhs(x))
    np.testing.assert_array_equal(again.start_state, network.start_state)
