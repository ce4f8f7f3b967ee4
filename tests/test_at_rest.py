"""Controllers that have arrived: multipliers and controls vanish, and the run settles as before."""

from functools import cache

import numpy as np
import pytest
import sympy as sp
from other_units import Units, written_in

from ann_dc import Kind, OdeBackend, OptimalControlProblem, RecurrentBackend, design
from ann_dc.backends import ode
from ann_dc.evaluation import evaluator
from ann_dc.network import Network

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
    return design(problem(other), kinds=[Kind.TIME_CONSTANTS]).network


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
