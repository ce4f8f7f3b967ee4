"""The certificate: IPOPT's optimum has one, its neighbours do not, and neither has a saddle."""

import time
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import sympy as sp
from costates import costates
from hypothesis import given, settings, strategies as st
from problems import SUITE
from reference import ipopt

from ann_dc import equilibrium, synthesize
from ann_dc.evaluation.populations import kkt_point
from ann_dc.optimality.by_stages import Minimum
from ann_dc.optimality.certificate import certify
from ann_dc.optimality.minimum import smallest_curvature
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales, scales_of

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
    np.testing.assert_allclose(smallest_curvature(problem, q, u.T, mu), 1.0, rtol=1e-9)


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
    mu, beta = costates(problem, q, a[None])
    given = certified(problem, q, a[None], mu, beta)
    values = np.linalg.eigvalsh(H)
    assert given.kkt_residual < 1e-12
    reported = smallest_curvature(problem, q, a[None], mu)
    np.testing.assert_allclose(reported, values[0] / abs(values[-1]), rtol=1e-9)
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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("N", [10, 1000, 3000])
def test_least_effort_over_any_horizon(N):
    """The double integrator's optimum is a straight line in time, whatever N is."""
    problem = plants.double_integrator(N=N, dt=2.0 / N)
    dt, k = 2.0 / N, np.arange(N)
    lever = np.stack([dt**2 * (N - 1 - k), np.full(N, dt)])  # x_N and v_N of every u_k
    u = (lever.T @ np.linalg.solve(lever @ lever.T, [1.0, 0.0]))[None]
    q = problem.functions.rollout(problem.q_0, u)
    last = -u[0, -1] / dt  # u_k + dt mu_v,k = 0, and mu_v falls by dt mu_x a stage
    slope = (u[0, 0] - u[0, -1]) / ((N - 1) * dt**2)
    mu = np.stack([np.full(N, -slope), last - slope * dt * (N - 1 - k)])
    beta = np.column_stack([np.zeros(2), -mu[:, :-1]])
    natural_scales(problem)  # known long before a point is certified
    began = time.thread_time()
    given = certified(problem, q, u, mu, beta)
    assert time.thread_time() - began < 1.0  # 8 ms at N = 3000
    assert given.certified, given.reason
    moved = certified(problem, q, u * (1 + 1e-3 * (k == N // 2)), mu, beta)
    assert not moved.certified


def test_a_point_that_is_no_number_is_not_certified():
    problem = plants.car(N=3)
    nan = np.full((4, 3), np.nan)
    given = certify(problem, nan, np.zeros((2, 3)), nan, nan, nan)
    assert given.minimum is Minimum.NOT_CHECKED
    assert "second order           not checked" in str(given)
    assert not given.second_order
    assert not given.kkt_residual < 1e-6


@pytest.mark.parametrize("place", [0, 2, 3, 4])
def test_one_number_that_is_none_is_enough(place):
    problem = SUITE["double_integrator"].problem
    found = ipopt(problem)
    mu, beta = costates(problem, found.q, found.u)
    point = [found.q[:, :-1].copy(), found.u.copy(), found.q[:, 1:].copy(), mu, beta]
    point[place][0, 2] = np.nan
    given = certify(problem, *point)
    assert not given.certified
    assert np.isnan(given.kkt_residual)


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
    size = scales_of(problem).state_factors
    largest = np.abs(np.column_stack([found.q, problem.q_d]) / size[:, None]).max()
    np.testing.assert_allclose(given.constraint_residual, 1 / size[0] / largest, rtol=1e-6)


def test_a_cheap_control_cannot_hide_behind_a_dear_one():
    """Residual and roll-out look right, but w is percents off: only its own range tells how far."""
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
    assert given.constraint_residual < 1e-8
    assert given.kkt_residual < 1e-6
    assert given.second_order
    assert given.newton_step > 0.01
    assert not given.certified


# ---- what rests ----------------------------------------------------------------------------------


def two_masses(off: float):
    """Least effort over 1 m; a second mass, which is there, is pushed by ``off``."""
    x, v, y, w, a, b = sp.symbols("x v y w a b")
    problem = OptimalControlProblem(
        states=(x, v, y, w), controls=(a, b), dynamics=(v, a, w, b), dt=0.1, horizon=20,
        cost=(a**2 + b**2) / 2, q_0=(0, 0, 0, 0), q_d=(1, 0, 0, 0),
    )  # fmt: skip
    A, B = np.array([[1, 0.1], [0, 1]]), np.array([[0], [0.1]])
    R = np.hstack([np.linalg.matrix_power(A, 19 - k) @ B for k in range(20)])
    u = np.zeros((2, 20))
    u[0] = R.T @ np.linalg.solve(R @ R.T, [1.0, 0.0])
    u[1] = off * np.linalg.svd(R)[2][-1]  # leaves the end of the second mass where it is
    q = problem.functions.rollout(problem.q_0, u)
    return certified(problem, q, u, *costates(problem, q, u))


@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-11, 1e-10])
def test_control_that_rests_at_zero_to_rounding_is_certified(off):
    assert two_masses(off).certified


@pytest.mark.parametrize("off", [1e-6, 1e-4, 1e-2])
def test_control_that_should_rest_and_moves_is_refused(off):
    assert not two_masses(off).certified


@pytest.mark.parametrize("wrong", [0.0, 1e-12, 1e-5, 1e-3])
def test_optimum_at_a_bound_throughout_is_certified_and_its_neighbours_are_not(wrong):
    """q' = -u q with q_N paid for: u = 0, its lower bound, at every stage; q rests at q_0."""
    x, u = sp.symbols("x u")
    problem = OptimalControlProblem(
        states=(x,), controls=(u,), dynamics=(-u * x,), dt=0.1, horizon=20, cost=u**2 / 10,
        terminal_cost=-x, q_0=(0.5,), q_d=None, bounds={u: (0, 1)},
    )  # fmt: skip
    control = np.full((1, 20), wrong)
    q = problem.functions.rollout(problem.q_0, control) + 1e-9 * np.linspace(0, 1, 21)
    assert certified(problem, q, control, *costates(problem, q, control)).certified == (
        wrong < 1e-10
    )


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


# ---- a start that is free ----------------------------------------------------------------------


def released(seed: int) -> OptimalControlProblem:
    """A random linear map with quadratic costs of which some components of q_0 are free."""
    rng = np.random.default_rng(seed)
    problem = plants.lq(seed=seed, N=4)
    free = rng.permutation(4)[: rng.integers(1, 5)]
    q_0 = [None if i in free else value for i, value in enumerate(problem.q_0)]
    q_d = [value if rng.random() < 0.5 else None for value in problem.q_d]
    return replace(problem, q_0=q_0, q_d=q_d)


def in_closed_form(problem):
    """q (n, N+1) and u (m, N) from one dense KKT system: free components of q_0, then controls."""
    functions, n, N = problem.functions, problem.n, problem.horizon
    free = [i for i, value in enumerate(problem.q_0) if value is None]
    first = np.array([value or 0.0 for value in problem.q_0])
    F, B = (M[..., 0] for M in functions.map_jacobian(np.zeros((n, 1)), np.zeros((problem.m, 1))))
    reach = [np.hstack([np.eye(n)[:, free], np.zeros((n, problem.m * N))])]
    rest = [first]
    for k in range(N):
        push = np.zeros((problem.m, problem.m * N))
        push[:, k * problem.m : (k + 1) * problem.m] = np.eye(problem.m)
        into = np.hstack([np.zeros((n, len(free))), B @ push])
        reach.append(F @ reach[-1] + into)
        rest.append(F @ rest[-1])
    size = reach[0].shape[1]
    H = sum(R.T @ R for R in reach[:-1])
    H[len(free) :, len(free) :] += np.eye(size - len(free))
    slope = sum(R.T @ r for R, r in zip(reach[:-1], rest))
    held = [i for i, value in enumerate(problem.q_d) if value is not None]
    A = reach[-1][held]
    gap = np.array([problem.q_d[i] for i in held]) - rest[-1][held]
    K = np.block([[H, A.T], [A, np.zeros((len(held), len(held)))]])
    z = np.linalg.solve(K, np.concatenate([-slope, gap]))[:size]
    q = np.array([R @ z + r for R, r in zip(reach, rest)]).T
    return q, z[len(free) :].reshape(N, problem.m).T


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**16))
def test_a_free_start_in_closed_form(seed):
    """The network's equilibrium is the optimum, and the certificate agrees."""
    problem = released(seed)
    q, u = in_closed_form(problem)
    network = synthesize(problem)
    found = kkt_point(network, equilibrium(network, network.start_state))
    np.testing.assert_allclose(found[0], q[:, :-1], atol=1e-8)
    np.testing.assert_allclose(found[1], u, atol=1e-8)
    certificate = certify(problem, *found)
    assert certificate.certified
    assert certificate.rollout_error < 1e-9


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**16))
def test_another_start_is_no_optimum(seed):
    """Optimal for a q_0 that is given is not optimal for one that is free."""
    problem = released(seed)
    q, _ = in_closed_form(problem)
    moved = [a if a is not None else b + 0.1 for a, b in zip(problem.q_0, q[:, 0])]
    given = replace(problem, q_0=moved)
    network = synthesize(given)
    found = kkt_point(network, equilibrium(network, network.start_state))
    assert certify(given, *found).certified
    certificate = certify(problem, *found)
    assert not certificate.certified
    assert certificate.stationarity_residual > 1e-5  # where multipliers are large, 1e-4 of them
    assert certificate.newton_step > 1e-3


def test_a_start_that_costs_nothing_is_not_certified():
    """x' = a where a alone has a price: any q_0 does, so none is isolated."""
    x, a = sp.symbols("x a")
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), cost=a**2, horizon=3, q_0=(None,)
    )
    still = np.zeros((1, 3))
    certificate = certify(problem, still, still, still, still, still)
    assert certificate.kkt_residual == 0
    assert not certificate.second_order
    assert not certificate.certified


def test_second_order_is_not_stated_where_the_first_order_fails():
    """Convex: the Hessian is positive definite everywhere, at points that are no minima, too."""
    problem = plants.double_integrator(N=4)
    rest, push = np.zeros((2, 4)), np.ones((1, 4))
    certificate = certify(problem, rest, push, rest, rest, rest)
    assert certificate.second_order
    assert not certificate.first_order
    assert not certificate.certified
    for reported in (str(certificate), certificate.verdict, certificate.reason):
        assert "strict local minimum" not in reported
        assert "the KKT residual" in reported


def test_second_order_is_not_stated_of_a_point_that_violates_a_row():
    """x' = a, from 1: a = 0 is stationary, but x <= 1/2 does not hold there."""
    x, a = sp.symbols("x a")
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + a,), cost=a**2, horizon=2, q_0=(1,),
        terminal_constraints=[x <= 0.5],
    )  # fmt: skip
    still = np.zeros((1, 2))
    certificate = certify(problem, still + 1, still, still + 1, still, still)
    assert certificate.kkt_residual == 0
    assert certificate.second_order
    assert "an inequality is violated" in certificate.verdict
    assert "strict local minimum" not in str(certificate)
