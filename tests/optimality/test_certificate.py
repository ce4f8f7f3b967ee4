"""The certificate: IPOPT's optimum has one, its neighbours do not, and neither has a saddle."""

import numpy as np
import pytest
import scipy.linalg
import sympy as sp
from costates import costates
from problems import SUITE
from reference import ipopt

from ann_dc.optimality import certificate, certify, newton_step
from ann_dc.problem import OptimalControlProblem, plants

NAMES = ["car", "unicycle", "bicycle", "van_der_pol", "lq_unst", "pendulum_state_cost", "cstr"]


def certified(problem, q, u, mu, beta):
    return certify(problem, q[:, :-1], u, q[:, 1:], mu, beta)


@pytest.mark.parametrize("name", NAMES)
def test_an_independent_optimum_is_certified(name):
    problem = SUITE[name].problem
    found = ipopt(problem)
    given = certified(problem, found.q, found.u, *costates(problem, found.q, found.u))
    assert given.kkt_residual < 1e-6
    assert given.constraint_residual < 1e-8
    assert given.second_order
    assert given.rollout_error < 1e-4
    np.testing.assert_allclose(given.objective, found.objective, rtol=1e-9)
    np.testing.assert_allclose(given.rollout, found.q, atol=1e-4)


@pytest.mark.parametrize("moved", ["q", "u", "mu", "beta"])
def test_a_neighbour_is_not(moved):
    problem = SUITE["car"].problem
    found = ipopt(problem)
    mu, beta = costates(problem, found.q, found.u)
    point = {"q": found.q.copy(), "u": found.u.copy(), "mu": mu.copy(), "beta": beta.copy()}
    point[moved][:, 3] += 1e-2 * np.abs(point[moved]).max()
    assert certified(problem, **point).kkt_residual > 1e-3
    assert certified(problem, found.q, found.u, mu, beta).kkt_residual < 1e-6


def test_beta_of_the_start_does_not_count():
    problem = SUITE["car"].problem
    found = ipopt(problem)
    mu, beta = costates(problem, found.q, found.u)
    beta[:, 0] = 1e9
    assert certified(problem, found.q, found.u, mu, beta).kkt_residual < 1e-6


# ---- closed forms ------------------------------------------------------------------------------


def test_least_effort_in_closed_form():
    """q_N = A^N q_0 + R a, so a = R' (R R')^-1 (q_d - A^N q_0)."""
    problem = plants.double_integrator()
    A, B = np.array([[1, 0.1], [0, 1]]), np.array([[0], [0.1]])
    R = np.hstack([np.linalg.matrix_power(A, 19 - k) @ B for k in range(20)])
    u = R.T @ np.linalg.solve(R @ R.T, [[1.0], [0.0]])
    q = problem.functions.rollout(problem.q_0, u.T)
    mu, beta = costates(problem, q, u.T)
    given = certified(problem, q, u.T, mu, beta)
    assert given.kkt_residual < 1e-12
    np.testing.assert_allclose(given.objective, (u**2).sum() / 2, rtol=1e-12)
    # mu_{N-1} = -(R R')^-1 d, and the reduced Hessian is the identity
    np.testing.assert_allclose(mu[:, -1], -np.linalg.solve(R @ R.T, [1.0, 0.0]), rtol=1e-9)
    np.testing.assert_allclose(given.curvature, 1.0, rtol=1e-9)


def quadratic(c: float, fixed: bool) -> OptimalControlProblem:
    """x' = x + a with cost (a^2 - c x^2) / 2 and x_N = 1 or the terminal cost (x - 1)^2."""
    x, a = sp.symbols("x a")
    return OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), cost=(a**2 - c * x**2) / 2,
        terminal_cost=0 if fixed else (x - 1) ** 2,
        horizon=4, q_0=(0.5,), q_d=(1,) if fixed else None,
    )  # fmt: skip


def stationary_point(c: float, fixed: bool):
    """x_k = 0.5 + sum a_i: a quadratic in a alone; returns a, its Hessian on the tangent."""
    L = np.tril(np.ones((4, 4)), -1)  # x_0 .. x_3
    H = np.eye(4) - c * L.T @ L
    gradient = -c * L.T @ np.full(4, 0.5)
    end = np.ones((1, 4))
    if not fixed:
        H, gradient = H + 2 * end.T @ end, gradient + 2 * (0.5 - 1) * end[0]
        return np.linalg.solve(H, -gradient), H
    K = np.block([[H, end.T], [end, np.zeros((1, 1))]])
    Z = scipy.linalg.null_space(end)
    return np.linalg.solve(K, [*-gradient, 0.5])[:4], Z.T @ H @ Z


@pytest.mark.parametrize("fixed", [True, False])
@pytest.mark.parametrize("c", [0.1, 1.5, 5.0])
def test_saddles_fail_the_second_order(c, fixed):
    problem = quadratic(c, fixed)
    a, H = stationary_point(c, fixed)
    q = problem.functions.rollout(problem.q_0, a[None])
    given = certified(problem, q, a[None], *costates(problem, q, a[None]))
    values = np.linalg.eigvalsh(H)
    assert given.kkt_residual < 1e-12
    np.testing.assert_allclose(given.curvature, values[0] / abs(values[-1]), rtol=1e-9)
    assert given.second_order == (values[0] > 0)
    assert given.second_order == (c < 1)
    assert ("NOT a minimum" in str(given)) == (c > 1)


def test_the_end_of_a_rollout():
    problem = plants.double_integrator(N=2, dt=1.0, q_d=(1, None))
    u = np.array([[0.5, 0.25]])
    # x = 0, 0, 0.5 and v = 0, 0.5, 0.75: the free speed does not count
    q = np.zeros((2, 3))
    given = certified(problem, q, u, np.zeros((2, 2)), np.zeros((2, 2)))
    np.testing.assert_allclose(given.rollout, [[0, 0, 0.5], [0, 0.5, 0.75]])
    np.testing.assert_allclose(given.rollout_error, 0.5)


def test_no_freedom_is_a_minimum():
    problem = plants.double_integrator(N=2, dt=1.0)
    u = np.array([[1.0, -1.0]])
    q = problem.functions.rollout(problem.q_0, u)
    given = certified(problem, q, u, *costates(problem, q, u))
    assert given.second_order
    assert given.rollout_error == 0.0


def test_long_rows_leave_the_second_order_out(monkeypatch):
    monkeypatch.setattr(certificate, "LARGEST_REDUCED", 3)
    problem = quadratic(0.1, True)
    a, _ = stationary_point(0.1, True)
    q = problem.functions.rollout(problem.q_0, a[None])
    given = certified(problem, q, a[None], *costates(problem, q, a[None]))
    assert np.isnan(given.curvature)
    assert not given.second_order
    assert "second order           not checked" in str(given)


def test_a_point_that_is_no_number_is_not_certified():
    problem = plants.car(N=3)
    nan = np.full((4, 3), np.nan)
    given = certify(problem, nan, np.zeros((2, 3)), nan, nan, nan)
    assert not given.second_order
    assert not given.kkt_residual < 1e-6


# ---- what must not pass ------------------------------------------------------------------------


@pytest.mark.parametrize("ends", [{"q_0": (1, 0, 0, 0)}, {"q_d": (4, 5, 0, 0)}])
def test_the_optimum_of_other_ends_is_not_certified(ends):
    problem = SUITE["car"].problem
    other = problem.with_inputs(**ends)
    found = ipopt(other)
    point = found.q, found.u, *costates(other, found.q, found.u)
    assert certified(other, *point).certified
    given = certified(problem, *point)
    assert not given.certified
    np.testing.assert_allclose(given.constraint_residual, 1 / np.abs(found.q).max(), rtol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_a_newton_step_leads_to_the_optimum(name):
    """The step is the distance to the optimum, up to its square."""
    problem = SUITE[name].problem
    found = ipopt(problem)
    mu, _ = costates(problem, found.q, found.u)
    assert newton_step(problem, found.q, found.u, mu) < 1e-5
    u = found.u.copy()
    u[0, 3] += 1e-3 * np.abs(u[0]).max()
    np.testing.assert_allclose(newton_step(problem, found.q, u, mu), 1e-3, rtol=0.05)


def test_a_cheap_control_cannot_hide_behind_a_dear_one():
    """KKT residual and roll-out look right, but w is percents off: only its own range tells."""
    x, y, u, w = sp.symbols("x y u w")
    problem = OptimalControlProblem(
        states=(x, y), controls=(u, w), dynamics=(1000 * u, w), dt=0.1, horizon=10,
        cost=u**2 + 1e-10 * (w**2 + (y - 1) ** 2), q_0=(0, 0), q_d=(1000, None),
    )  # fmt: skip
    found = ipopt(problem)
    q, controls = found.q.copy(), found.u.copy()
    mu, beta = costates(problem, q, controls)
    controls[1] *= 1.05
    q[1] = problem.functions.rollout(problem.q_0, controls)[1]
    given = certified(problem, q, controls, mu, beta)
    assert given.kkt_residual < 1e-8
    assert given.second_order
    assert given.newton_step > 0.01
    assert not given.certified


def test_a_point_that_is_not_isolated_is_not_certified():
    x, a, b = sp.symbols("x a b")
    problem = OptimalControlProblem(
        states=(x,), controls=(a, b), map=(x + a + b,), cost=(a + b) ** 2, horizon=4, q_0=(0,),
        q_d=(1,),
    )  # fmt: skip
    q = np.linspace(0, 1, 5)[None]
    given = certified(
        problem, q, np.full((2, 4), 0.125), np.full((1, 4), -0.5), np.full((1, 4), 0.5)
    )
    assert given.kkt_residual < 1e-12
    assert not given.certified
