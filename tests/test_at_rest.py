"""Controllers that have arrived: multipliers and controls vanish, and the run settles as before."""

import re
import subprocess
from functools import cache

import numpy as np
import pytest
import sympy as sp
from other_units import Units, written_in
from simulator import needs_ngspice

from ann_dc import (
    OdeBackend,
    OptimalControlProblem,
    PreconditionerKind,
    RecurrentBackend,
    SpiceBackend,
    design,
    levels,
)
from ann_dc.backends import ode
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.netlists.pack import pack_files
from ann_dc.export.reference.contents import stated
from ann_dc.export.reference.vector import reference_vector
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.error_budget import budget, sensitivity
from ann_dc.fidelity.noise_run import control_noise
from ann_dc.fidelity.prediction import predict, prediction_of
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

A, B = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
STAGES, PRICE = 10, 0.1
Q_0 = np.array([5.0, -2.0])
UNITS = Units(
    state=np.array([1e-3, 20.0]), control=np.array([3e4]), cost=1e5, shift=np.array([7.0, 0.0])
)
SHARES = (1.0, 1e-3, 1e-5, 1e-6, 1e-8, 0.0)


@cache
def problem(other: bool = False) -> OptimalControlProblem:
    x, v, a = sp.symbols("x v a")
    weight = x**2 / 2 + v**2 / 2
    plain = OptimalControlProblem(
        states=(x, v),
        controls=(a,),
        map=(x + v + a / 2, v + a),
        horizon=STAGES,
        q_0=Q_0,
        q_d=(None, None),
        cost=weight + PRICE * a**2 / 2,
        terminal_cost=weight,
        bounds={a: (-1, 1)},
    )
    return written_in(plain, UNITS) if other else plain


@cache
def network(other: bool = False) -> Network:
    return design(problem(other), preconditioner=PreconditionerKind.DIAGONAL).network


def started(share: float, other: bool = False) -> Network:
    """The controller at a share of its first distance from the target."""
    given = share * Q_0
    if other:
        given = (given - UNITS.shift) / UNITS.state
    return network(other).with_inputs({"q_0.x": given[0], "q_0.v": given[1]})


def exact(share: float) -> np.ndarray:
    """Controls (N,) by Riccati's recursion; those of the whole distance reach their bounds."""
    P, gains, q, u = np.eye(2), [], share * Q_0, []
    for _ in range(STAGES):
        K = np.linalg.solve(PRICE + B.T @ P @ B, B.T @ P @ A)
        gains.append(K)
        P = np.eye(2) + A.T @ P @ (A - B @ K)
    for K in reversed(gains):
        u.append(-(K @ q)[0])
        q = A @ q + B[:, 0] * u[-1]
    return np.array(u)


def check(found: np.ndarray, share: float) -> None:
    right = exact(share)
    np.testing.assert_allclose(found, right, rtol=0, atol=1e-11 + 1e-6 * np.abs(right).max())


@pytest.mark.sampled(8)
@pytest.mark.parametrize("other", [False, True], ids=["plain", "other units"])
@pytest.mark.parametrize("share", SHARES)
def test_run_near_the_target_takes_the_steps_of_one_far_away(share, other):
    run = OdeBackend(verify=False).run(started(share, other))
    assert run.status.settled
    assert run.steps < 100
    if share < 1:
        found = run.trajectory.controls[-1] * (UNITS.control[0] if other else 1.0)
        check(found, share)


@pytest.mark.parametrize("share", [1e-3, 1e-8, 0.0])
def test_recurrent_run_near_the_target_settles(share):
    run = RecurrentBackend().run(started(share))
    assert run.status.settled
    check(run.trajectory.controls[-1], share)


def test_batch_near_the_target_settles():
    starts = np.outer(SHARES[1:], Q_0)
    batch = OdeBackend().run_batch(network(), {"q_0.x": starts[:, 0], "q_0.v": starts[:, 1]})
    assert batch.settled.all()


@pytest.mark.parametrize("method", [ode.RK45, ode.RADAU], ids=lambda m: m.name)
def test_scipys_methods_settle_at_the_target(method):
    assert OdeBackend(method=method, verify=False).run(started(0.0)).status.settled


def test_control_that_is_off_by_a_millionth_of_its_scale_has_not_settled():
    there = started(0.0)
    x = OdeBackend(verify=False).run(there).trajectory.final
    assert max(evaluator(there).residuals(x)) < 1e-8
    off = np.where(there.of_population("u"), 1e-6, 0.0)
    assert max(evaluator(there).residuals(x + off)) > 1e-3


# ---- circuits ------------------------------------------------------------------------------------

LEVEL = levels.macro(a0=1e6)


def oscillator(start: float = 0.8, rest: float = 0.0) -> Network:
    """x'' = -4 x' - 100 (x - rest), wired by hand: it swings to |v| = 6 and settles at ``rest``."""
    weights = [("v", "x", 1.0), ("x", "v", -100.0), ("v", "v", -4.0), ("one", "v", 100.0 * rest)]
    wires = [Connection(source=s, target=t, weight=w) for s, t, w in weights if w]
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="v")), connections=tuple(wires))
    return Network(cell=cell, stages=1, start={"x": start}, title="oscillator")


@cache
def instance(start: float = 0.8) -> CircuitInstance:
    circuit, probe = SpiceBackend(level=LEVEL).prepare(oscillator(start))
    return CircuitInstance(circuit=circuit, level=LEVEL, probe=probe)


@pytest.mark.parametrize("start", [0.8, -8.0])
def test_circuit_that_rests_at_zero_is_predicted_to_be_right(start):
    found = prediction_of(instance(start))
    assert found.other_equilibrium == ""
    assert found.control_error < 1e-3
    assert 1e-6 < found.settling_time < 1e-3


def test_prediction_at_rest_does_not_depend_on_the_size_of_the_swing():
    small, large = prediction_of(instance(0.8)), prediction_of(instance(8.0))
    assert small.control_error == pytest.approx(large.control_error, abs=1e-6)
    assert small.settling_time == pytest.approx(large.settling_time, rel=0.02)


@pytest.mark.parametrize(("volts", "right"), [(1e-6, True), (1e-3, False)])
def test_offset_at_rest_is_told_over_full_scale(volts, right):
    """1 mV at the input of an integrator moves a circuit of 1 V by 1e-3: 10 % of 1 % of it."""
    built = instance()
    offset = next(p.name for p in built.circuit.parameters if p.name.startswith("vos"))
    found = predict(built.circuit, LEVEL, built.probe, {offset: np.array([volts])})
    assert (found.control_error < 0.01) == right


def test_figures_of_a_circuit_at_rest_are_finite():
    built = instance()
    items = budget(sensitivity(built.emulation, built.settled))
    assert 0 < max(item.error for item in items) < 10
    assert 0 < control_noise(built) < 1


def test_rest_away_from_zero_is_related_to_itself():
    """At 0.8 of a swing of 6 the largest value counts, as it always did."""
    _, probe = SpiceBackend(level=LEVEL).prepare(oscillator(start=0.0, rest=0.8))
    assert probe.control_size == pytest.approx(0.8, rel=1e-6)


@needs_ngspice
def test_ngspice_finds_a_circuit_at_rest_right():
    run = SpiceBackend(level=LEVEL).run(oscillator())
    assert run.settled()
    assert run.control_error < 1e-3
    assert "1% of the largest magnitude of the controls" in str(run)


@needs_ngspice
def test_pack_of_a_network_at_rest_confirms_its_prediction_in_ngspice(tmp_path):
    """The deck relates the error to what the prediction does, and the claim names it."""
    network = oscillator()
    files = pack_files(network, reference_vector(network), level="macro")
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    command = ["ngspice", "-n", "-b", "deck.cir"]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    size = "of 1% of the largest magnitude of the controls on their way (they settle near zero)"
    (reported,) = re.findall(r"controls settled: off by (\S+) (of 1% .*)", ran.stdout)
    assert ran.returncode == 0
    assert reported[1] == size
    assert float(reported[0]) < 1e-3
    assert size in stated(files)


@needs_ngspice
def test_circuit_of_a_controller_that_has_arrived_runs():
    run = SpiceBackend(level=LEVEL).run(started(0.0))
    assert run.settled()
    assert run.control_error < 5e-3
