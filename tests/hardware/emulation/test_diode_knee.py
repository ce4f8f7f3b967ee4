"""Knees of diodes: closed forms, first order against Newton, and ngspice against both."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from constrained import CONSTRAINED, integrator, v
from hypothesis import given, strategies as st
from minimax import small as cart
from scipy.optimize import brentq
from simulator import needs_ngspice

from ann_dc import (
    PreconditionerKind,
    SpiceBackend,
    design,
    equilibrium,
    evaluator,
    levels,
    synthesize,
)
from ann_dc.backends.spice.netlist.timing import Simulation
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.hardware.emulation.diode_knee import knee_shift, with_diode_knee
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Sum
from ann_dc.network.duals import InequalityDual
from ann_dc.network.network import Network
from ann_dc.solution.solution import certificate_of

DUAL = InequalityDual(neuron="z", residual="g", sum="y", multiplier="m")


def held(pull: float, w: float = 1.0) -> Network:
    """x' = pull - x - m under x <= 0: z = m = pull where that is positive, else g = x = pull."""
    ends = (
        ("one", "x", pull), ("x", "x", -1.0), ("m", "x", -1.0), ("x", "g", 1.0),
        ("z", "y", 1.0), ("g", "y", w), ("m", "z", 1.0 / w), ("z", "z", -1.0 / w),
    )  # fmt: skip
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="z")),
        blocks=(Sum(name="g"), Sum(name="y"), Function(name="m", function="rectify", x="y")),
        connections=tuple(Connection(source=a, target=b, weight=c) for a, b, c in ends),
        inequality_duals=(DUAL,),
    )
    return Network(cell=cell, stages=1)


def rest(pull: float) -> np.ndarray:
    return np.array([min(pull, 0.0), max(pull, 0.0)])


SIZES = st.floats(0.01, 0.3)
PULLS = st.floats(-1.0, 1.0)
STEEP = st.floats(0.2, 5.0)


@given(pull=PULLS, w=STEEP, s=SIZES)
def test_a_row_rests_where_the_closed_form_says(pull, w, s):
    """With z = pull - x: x = (s/w) ln(1 - exp(-z/s)), which has one root."""
    bent = with_diode_knee(held(pull, w), s)
    x, z = equilibrium(bent, rest(pull) + knee_shift(held(pull, w), rest(pull), s))
    z_expected = brentq(
        lambda z: pull - z - s / w * np.log(-np.expm1(-z / s)), 1e-300, 40 * s + 2, xtol=1e-15
    )
    assert z == pytest.approx(z_expected, abs=1e-9)
    assert x == pytest.approx(pull - z_expected, abs=1e-9)


@given(pull=PULLS, w=STEEP, s=SIZES)
def test_the_shift_is_that_of_the_bent_kkt_system(pull, w, s):
    """L = G = 1: dx + dz = 0 and p w dx - (1 - p) dz = -b."""
    y = pull if pull > 0 else w * pull
    p, b = 1 / (1 + np.exp(-y / s)), s * np.log1p(np.exp(-abs(y) / s))
    dx = -b / (p * w + 1 - p)
    found = knee_shift(held(pull, w), rest(pull), s)
    np.testing.assert_allclose(found, [dx, -dx], rtol=1e-6, atol=1e-12)


@given(y=st.floats(-50, 50), s=SIZES)
def test_the_knee_is_a_diodes(y, s):
    bent = with_diode_knee(held(1.0), s)
    m = evaluator(bent).node(np.array([0.0, y]), "m")[0]
    assert m == pytest.approx(s * np.logaddexp(0.0, y / s), abs=1e-12 * s, rel=1e-12)


def test_no_width_is_no_knee():
    network = held(1.0)
    assert with_diode_knee(network, 0.0) is network
    assert with_diode_knee(network, {}) is network
    assert not knee_shift(network, rest(1.0), 0.0).any()


def test_widths_are_checked():
    with pytest.raises(NetworkError, match="width of z: expected 0 or a positive number, got -1"):
        with_diode_knee(held(1.0), -1.0)
    with pytest.raises(NetworkError, match="width of z"):
        with_diode_knee(held(1.0), float("inf"))
    with pytest.raises(UnknownNameError, match="'w'"):
        knee_shift(held(1.0), rest(1.0), {"w": 0.1})


def test_an_exponential_has_no_knee():
    network = synthesize(cart(temperature=0.3))
    assert with_diode_knee(network, 0.1) is network
    with pytest.raises(UnknownNameError, match=r"z_J\.effort"):
        with_diode_knee(network, {"z_J.effort": 0.1})


def test_shares_of_objectives_have_knees():
    """They still add up to one, and an objective without a share gets some."""
    found = design(cart(weights={"effort": 0.99, "error": 0.01}))
    network, x = found.network, equilibrium(found.network, found.state)
    width = {"z_J.error": 0.05, "z_J.effort": 0.05}
    soft = with_diode_knee(network, width)
    bent = equilibrium(soft, x + knee_shift(network, x, width))
    before, after = (kkt_point(n, at)[-1] for n, at in ((network, x), (soft, bent)))
    assert after.sum() == pytest.approx(1.0, abs=1e-9)
    assert 0 < after[1] < 1e-3
    assert before[1] == pytest.approx(0.0, abs=1e-9)


# ---- in ngspice ----------------------------------------------------------------------------------


PROBLEMS = {"limited speed": lambda: integrator(N=8, dt=0.25, bounds={v: (None, 0.65)})}
PROBLEMS |= {name: CONSTRAINED[name].build for name in ("car_steer", "car_disc1", "lander")}


@cache
def settled(name):
    """A network, its settled point, and what a volt at every diode neuron stands for."""
    network = design(PROBLEMS[name](), preconditioner=PreconditionerKind.DIAGONAL).network
    circuit, probe = SpiceBackend().prepare(network)
    volt = {
        d.neuron: float(circuit.scaling.value(d.multiplier, 1.0))
        for d in network.cell.inequality_duals
    }
    return network, equilibrium(network, probe.final), volt


def shifts(name, volts, level) -> np.ndarray:
    """How far controls move, over the largest one: (first order, Newton, ngspice)."""
    network, x, volt = settled(name)
    width = {neuron: volts * value for neuron, value in volt.items()}
    bent, first = with_diode_knee(network, width), knee_shift(network, x, width)
    run = SpiceBackend(level=level, simulation=Simulation(patience=900.0)).run(bent)
    assert run.settled()
    u = network.of_population("u")
    moved = (first, equilibrium(bent, run.probe.final) - x, run.trajectory.final - x)
    return np.array(moved)[:, u] / np.abs(x[u]).max()


LEVELS = {"behavioural": (levels.BEHAVIOURAL, 5e-6), "macro": (levels.macro(), 5e-4)}
"""Each with what its finite gains and its steps cost, of the largest control."""


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("level", ["macro", pytest.param("behavioural", marks=pytest.mark.slow)])
def test_ngspice_moves_as_foreseen(level):
    """10 mV are nothing here, 50 mV half a percent of the largest control."""
    built, error = LEVELS[level]
    for volts, size in ((0.01, 2e-6), (0.05, 5.5e-3)):
        first, newton, measured = shifts("limited speed", volts, built)
        np.testing.assert_allclose(np.abs(first).max(), size, rtol=0.2)
        np.testing.assert_allclose(measured, newton, atol=error)
        np.testing.assert_allclose(measured, first, atol=0.02 * size + error)


SUITE = ("car_steer", "car_disc1", "lander")


def slow(*names):
    return [pytest.param(name, marks=pytest.mark.slow) for name in names]


def check_rows(network, x, width) -> None:
    """Every row rests at g = (s/w) ln(1 - exp(-m/s)), which is m = -s ln(1 - exp(w g/s))."""
    known, wires = evaluator(network), network.cell.connections
    for dual in network.cell.inequality_duals:
        live = network.live[network.neuron_index[dual.neuron]]
        g, m = (known.node(x, node)[live] for node in (dual.residual, dual.multiplier))
        (w,) = (c.weight for c in wires if (c.source, c.target) == (dual.residual, dual.sum))
        w, s = np.broadcast_to(w, live.shape)[live], width[dual.neuron]
        on = m > s
        short = s / w[on] * np.log(-np.expm1(-m[on] / s))
        np.testing.assert_allclose(g[on], short, rtol=1e-6, atol=1e-9)
        little = -s * np.log1p(-np.exp(w[~on] * g[~on] / s))
        np.testing.assert_allclose(m[~on], little, rtol=1e-6, atol=1e-9 * s)


@pytest.mark.parametrize("volts", [0.01, 0.05])
@pytest.mark.parametrize("name", ["limited speed", *slow(*SUITE)])
def test_problems_rest_where_the_closed_form_says(name, volts):
    """The Lagrangian is stationary by the problem's own derivatives, rows are short as foreseen."""
    network, x, volt = settled(name)
    width = {neuron: volts * value for neuron, value in volt.items()}
    bent = with_diode_knee(network, width)
    at_rest = equilibrium(bent, x + knee_shift(network, x, width))
    certificate = certificate_of(PROBLEMS[name](), bent, at_rest)
    assert max(certificate.stationarity_residual, certificate.constraint_residual) < 1e-8
    check_rows(bent, at_rest, width)


@pytest.mark.slow
@needs_ngspice
@pytest.mark.parametrize("volts", [0.01, 0.05])
@pytest.mark.parametrize("name", SUITE)
def test_problems_of_the_suite_move_as_foreseen(name, volts):
    """To first order for small knees: 50 mV are more than a multiplier of the lander."""
    first, newton, measured = shifts(name, volts, levels.BEHAVIOURAL)
    np.testing.assert_allclose(measured, newton, atol=5e-6)
    if volts < 0.05:
        np.testing.assert_allclose(measured, first, atol=0.01 * np.abs(first).max() + 5e-6)


@needs_ngspice
@pytest.mark.parametrize("volts", [0.01, 0.05])
def test_in_the_loop_of_an_op_amp_a_knee_costs_nothing(volts):
    """The diodes of the cells, with 26 mV a factor of e, are given others."""
    network, _, _ = settled("limited speed")
    backend = SpiceBackend(level=levels.macro())
    circuit, probe = backend.prepare(network)
    deck = backend.deck(circuit, probe, {})
    model = ".model pi_diode_on d(is=1e-14"
    other = tuple(m.replace(model, f"{model} n={volts / 0.02587:.4g}") for m in deck.models)
    assert other != deck.models
    ends = [
        backend.measure(circuit, replace(deck, models=models), probe).trajectory.control_values[-1]
        for models in (deck.models, other)
    ]
    np.testing.assert_allclose(*ends, atol=1e-5 * np.abs(ends).max())
