"""States between steps: within 100 rtol of an independent reference, by every method."""

import pickle
from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from designs import designed
from problems import SUITE
from scipy.integrate import solve_ivp

import ann_dc.backends.recorder
from ann_dc.backends import ode
from ann_dc.backends.integration.drawing import CompiledAgain, SolvedAgain
from ann_dc.backends.integration.systems import Cells
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.settling import Settling, control_settling
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.procedure import design
from ann_dc.network.cell import ONE, Cell, Connection, Function, Limiter, Neuron, Product
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.solver import synthesize


def wire(source: str, target: str, weight: float = 1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


def oscillator() -> Network:
    """x'' = -4 x' - 100 x, from 0.8."""
    wires = wire("v", "x"), wire("x", "v", -100.0), wire("v", "v", -4.0)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=wires)
    return Network(cell=cell, stages=1, start={"x": 0.8})


def chain() -> Network:
    """Masses between springs, tied to a wall by the last one: modes of several frequencies."""
    wires = [wire("v", "x"), wire("x", "v", -2.0), wire("v", "v", -0.3)]
    wires += [Connection(source="x", target="v", weight=1.0, template=k) for k in (-1, 1)]
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=tuple(wires))
    return Network(cell=cell, stages=5, start={"x": [0.0, 1.0, 0.0, -0.5, 0.0]})


def van_der_pol() -> Network:
    """Backwards in time, so that it spirals into zero: x'' = -(1 - x^2) x' - x."""
    wires = wire("y", "x"), wire("x", "y", -1.0), wire("y", "y", -1.0), wire("xxy", "y")
    blocks = Product(name="xx", a="x", b="x"), Product(name="xxy", a="xx", b="y")
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), blocks=blocks, connections=wires)
    return Network(cell=cell, stages=1, start={"x": 1.9})


def with_limits() -> Network:
    """x stops at its upper rail, and leaves it as soon as v turns."""
    wires = wire("v", "x"), wire("x", "v", -9.0), wire("v", "v", -0.8), wire(ONE, "v", 2.0)
    neurons = Neuron(name="x", limiter=Limiter(low=-0.3, high=0.3)), Neuron(name="v")
    return Network(cell=Cell(neurons=neurons, connections=wires), stages=1, start={"x": -0.2})


def car(kind: PreconditionerKind) -> Network:
    return design(synthesize(SUITE["car"].problem), preconditioner=(kind,)).network


NETWORKS: dict[str, Callable[[], Network]] = {
    "oscillator": oscillator,
    "chain": chain,
    "van_der_pol": van_der_pol,
    "railed": with_limits,
    "car_grid": lambda: car(PreconditionerKind.RESISTIVE_GRID),
    "car_pyramid": lambda: car(PreconditionerKind.MULTILEVEL),
    "cstr": lambda: designed("cstr").network,
    "pendulum": lambda: designed("pendulum").network,
    "double_integrator": lambda: designed("double_integrator").network,
    "unicycle": lambda: designed("unicycle").network,
}
network_of = cache(lambda name: NETWORKS[name]())
KINDS = {
    "interpreted": OdeBackend(cells=Cells.INTERPRETED, verify=False),
    "generated": OdeBackend(cells=Cells.GENERATED, verify=False),
    "lanes": OdeBackend(curves=5000),
    **{m.name: OdeBackend(method=m, verify=False) for m in ode.METHODS.values() if not m.rows},
}
QUICK = {"oscillator", "van_der_pol", "railed", "double_integrator"}, {
    "interpreted", "generated", "lanes", "RK45", "DOP853", "Radau", "BDF",
}  # fmt: skip


def cases():
    for name in NETWORKS:
        for kind in KINDS:
            is_quick = name in QUICK[0] and kind in QUICK[1]
            yield pytest.param(name, kind, marks=[] if is_quick else pytest.mark.slow)


def run_of(name: str, kind: str, **changed) -> tuple[Trajectory, float]:
    """A trajectory and the relative tolerance of its steps."""
    backend, network = KINDS[kind], network_of(name)
    if kind != "lanes":
        return backend.run(network).trajectory, backend.method.rtol
    inputs = {input: np.tile(values, (3, 1)) for input, values in network.inputs.items()}
    starts = np.tile(network.start_state, (3, 1))
    return backend.run_batch(network, inputs, starts).trajectory(1), ode.BATCHES.rtol


@cache
def reference_of(name: str):
    """DOP853 at 1e-12 over NumPy's evaluator, with short steps where slopes have kinks."""
    network = network_of(name)
    end = 1.2 * run_of(name, "generated")[0].known[0][-1]
    longest = end / 3000 if name == "railed" else np.inf
    return solve_ivp(
        lambda _, x: evaluator(network).rhs(x), (0.0, end), network.start_state, method="DOP853",
        rtol=1e-12, atol=1e-13, dense_output=True, max_step=longest,
    ).sol  # fmt: skip


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "kind"), [*cases()])
def test_states_at_random_times_are_within_100_rtol_of_a_reference(name, kind):
    trajectory, rtol = run_of(name, kind)
    rng, reference = np.random.default_rng(5), reference_of(name)
    end = min(trajectory.known[0][-1], reference.t_max)
    times = end * np.concatenate([rng.random(500), 10 ** rng.uniform(-4.0, 0.0, 500)])
    expected = reference(times).T
    found = trajectory.at(times)
    assert np.abs(found - expected).max() < 100 * rtol * np.abs(expected).max()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", ["interpreted", "generated", "DOP853", "RK45", "Radau", "BDF"])
def test_rows_between_steps_are_as_good_as_those_at_steps(kind):
    """x = 0.8 e^(-2 t) (cos w t + 2 / w sin w t): a cubic through the steps is 1e-3 off."""
    trajectory, rtol = run_of("oscillator", kind)
    time, w = trajectory.time, np.sqrt(96.0)
    exact = 0.8 * np.exp(-2 * time) * (np.cos(w * time) + 2 / w * np.sin(w * time))
    steps = np.isin(time, trajectory.residual_time)
    assert (~steps).sum() == steps.sum() - 1
    np.testing.assert_allclose(trajectory["x"][:, 0], exact, atol=100 * rtol)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", ["interpreted", "generated", "RK45", "Radau", "LSODA"])
def test_states_between_steps_stay_within_the_rails(kind):
    trajectory, _ = run_of("railed", kind)
    x = trajectory.at(np.linspace(0.0, trajectory.known[0][-1], 4001))[:, 0]
    assert x.max() == 0.3 == trajectory["x"].max()
    assert x.min() >= -0.3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind", "most"),
    [("oscillator", "generated", 100), ("railed", "RK45", 10), ("railed", "DOP853", 10)],
)
def test_thinned_run_is_known_between_its_rows(monkeypatch, name, kind, most):
    """Gaps of many steps begin every step within the rails: by RK45, 1.7 rtol off, not 39."""
    monkeypatch.setattr(ann_dc.backends.recorder, "SAMPLES", 20)
    trajectory, rtol = run_of(name, kind)
    assert len(trajectory.time) <= 21
    times = np.random.default_rng(1).uniform(0.0, trajectory.time[-1], 200)
    expected = reference_of(name)(times).T
    assert np.abs(trajectory.at(times) - expected).max() < most * rtol * np.abs(expected).max()


@pytest.mark.parametrize("solved", [False, True])
def test_states_behind_a_step_that_fails_are_nan(solved):
    """x' = -1 from 0.5 leaves the domain of a root (of weight 1e-12) at 0.5."""
    blocks, wires = (Function(name="root", function="sqrt", x="x"),), (wire(ONE, "x", -1.0),)
    cell = Cell(
        neurons=(Neuron(name="x"),), blocks=blocks, connections=(*wires, wire("root", "x", 1e-12))
    )
    network = Network(cell=cell, stages=1, start={"x": 0.5})
    again = CompiledAgain(network=network, method=ode.COMPILED)
    if solved:
        rhs = lambda x: -1.0 + 1e-12 * np.sqrt(x)  # noqa: E731
        again = SolvedAgain(method=ode.DOP853, rhs=rhs, compiled=fast_evaluator(network))
    known = np.array([0.0, 1.0]), np.array([[0.5], [-0.5]])
    found = again(known, np.array([0.1, 0.4, 0.6, 0.9]))[:, 0]
    np.testing.assert_allclose(found, [0.4, 0.1, np.nan, np.nan], rtol=1e-6)
    trajectory = Trajectory(
        network=network, time=known[0], states=known[1],
        residual_time=known[0], residuals=np.zeros((2, 2)),
    ).with_between(lambda _, times: np.full((len(times), 1), np.nan))  # fmt: skip
    np.testing.assert_array_equal(trajectory.states, known[1])
    np.testing.assert_array_equal(trajectory.at([0.0, 1.0]), known[1])


@pytest.mark.parametrize("method", [ode.RK45, ode.DOP853])
def test_first_step_that_fails_ends_the_run_with_a_message(method):
    """A slope that is nan everywhere but at the start, whose residual is just below tolerance."""
    network = network_of("oscillator")
    start = network.start_state
    worst = max(evaluator(network).residuals(start))
    backend = OdeBackend(method=method, settling=Settling(tolerance=worst / 0.8), verify=False)
    slope = evaluator(network).rhs(start)
    run = backend.follow(network, lambda x: np.where(np.array_equal(x, start), slope, np.nan))
    assert run.status.outcome is Outcome.DIVERGED
    assert run.steps == 0
    np.testing.assert_array_equal(run.trajectory.states, [start])
    again = SolvedAgain(method=ode.RK45, rhs=lambda x: x * np.nan, compiled=fast_evaluator(network))
    assert np.isnan(again((np.array([0.0, 1.0]), np.array([start, start])), np.array([0.5]))).all()


def test_thinned_lanes_are_known_between_their_rows():
    network = network_of("double_integrator")
    batch = OdeBackend(curves=8).run_batch(network, {}, network.start_state)
    trajectory, reference = batch.trajectory(0), reference_of("double_integrator")
    assert len(trajectory.time) <= 9
    times = np.random.default_rng(2).uniform(0.0, trajectory.time[-1], 200)
    expected = reference(times).T
    error = np.abs(trajectory.at(times) - expected).max()
    assert error < 100 * ode.BATCHES.rtol * np.abs(expected).max()


def test_another_right_hand_side_is_known_between_steps():
    network = network_of("oscillator")
    run = KINDS["generated"].follow(network, lambda x: 2.0 * evaluator(network).rhs(x))
    times = np.linspace(0.0, run.trajectory.time[-1], 50)
    expected = reference_of("oscillator")(np.minimum(2.0 * times, 1e9)).T
    np.testing.assert_allclose(run.trajectory.at(times), expected, atol=1e-4)


def test_states_between_steps_cost_nothing_until_they_are_read(monkeypatch):
    monkeypatch.setattr(CompiledAgain, "__call__", lambda *_: pytest.fail("states were computed"))
    run = KINDS["generated"].run(network_of("oscillator"))
    assert len(run.trajectory.measured_in({"x": "m"}).final) == 2
    assert run.trajectory.kkt[-1] < 1e-6
    with pytest.raises(pytest.fail.Exception):
        _ = run.trajectory.states


# ---- what is located between steps ---------------------------------------------------------------


SINGLE = [
    ("railed", "interpreted"), ("railed", "Radau"), ("railed", "RK45"), ("cstr", "generated"),
    ("double_integrator", "generated"), ("double_integrator", "DOP853"),
]  # fmt: skip
LANES = [(name, "lanes") for name in ("railed", "cstr", "double_integrator")]


def last_above(name: str, deviation: Callable[[np.ndarray], np.ndarray], found: float) -> float:
    """Last of many times around the one found at which a state of the reference deviates."""
    reference = reference_of(name)
    grid = np.linspace(0.8 * found, min(1.5 * found, reference.t_max), 20_001)
    return grid[np.flatnonzero(deviation(reference(grid).T))[-1]]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "kind"), [*SINGLE, *LANES])
@pytest.mark.parametrize("share", [1e-2, 1e-3])
def test_band_of_controls_is_located_inside_its_step(name, kind, share):
    """On the stirred tank, straight lines between rows are 7.5 % early."""
    trajectory, network = run_of(name, kind)[0], network_of(name)
    final = control_values(network, reference_of(name)(trajectory.known[0][-1]))
    found, band = control_settling(trajectory, share), share * np.abs(final).max()

    def beyond(states: np.ndarray) -> np.ndarray:
        return np.abs(control_values(network, states) - final).max(axis=1) >= band

    rel = 1e-3 if kind == "lanes" else 2e-4
    assert found == pytest.approx(last_above(name, beyond, found), rel=rel)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "kind"), [*SINGLE, *LANES])
def test_exit_of_the_residual_is_located_inside_its_step(name, kind):
    backend, network = replace(KINDS[kind], settling=Settling(tolerance=1e-3)), network_of(name)
    if kind == "lanes":
        found = float(backend.run_batch(network, {}, network.start_state).settling_times[0])
    else:
        found = backend.run(network).settling_time

    def above(states: np.ndarray) -> np.ndarray:
        return np.array([max(evaluator(network).residuals(x)) >= 1e-3 for x in states])

    grid = np.linspace(0.9 * found, 1.1 * found, 2_001)
    expected = grid[np.flatnonzero(above(reference_of(name)(grid).T))[-1]]
    assert found == pytest.approx(expected, rel=5e-4)


def test_trajectory_of_a_copy_has_its_rows_only():
    trajectory, _ = run_of("oscillator", "generated")
    again = pickle.loads(pickle.dumps(trajectory))
    np.testing.assert_array_equal(again.states, trajectory.states)
    with pytest.raises(NetworkError, match="has samples only"):
        again.at([0.0])
    with pytest.raises(NetworkError, match="expected times"):
        trajectory.at([-1.0])
