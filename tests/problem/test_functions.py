"""The problem's functions against CasADi's automatic differentiation of the same declaration."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, strategies as st
from problems import SUITE
from reference import casadi_functions

import ann_dc
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.functions import LARGE, _compiled

x, v, a, w = sp.symbols("x v a w")
WITH_EVERYTHING = OptimalControlProblem(
    name="everything",
    states=(x, v),
    controls=(a,),
    map=(x + sp.tanh(v) * w, sp.sqrt(1 + x**2) + a / (2 + sp.cos(v))),
    cost=sp.exp(-x) * a**2 + w * v,
    terminal_cost=w * x**2 * sp.sin(v),
    horizon=4,
    q_0=(0.1, 0.2),
    inputs={w: (0.3, 0.4, 0.5, 0.6)},
)


def fed_batch(horizon=4):
    """Bioreactor by the rule of Runge and Kutta: 3,600 operations, written out."""
    biomass, substrate, product, volume, feed = state = sp.symbols("X S P V F")

    def rate(q):
        given = dict(zip(state, q))
        growth = (0.4 * substrate / (1.2 + substrate)).subs(given, simultaneous=True)
        X, S, P, V = q
        diluted = feed / V
        return sp.Matrix([
            growth * X - diluted * X, -2 * growth * X + diluted * (20 - S),
            0.3 * growth * X + 0.05 * X - diluted * P, feed,
        ])  # fmt: skip

    q, step = sp.Matrix(state[:4]), sp.Rational(1, 3)
    k1 = rate(q)
    k2 = rate(q + step / 2 * k1)
    k3 = rate(q + step / 2 * k2)
    k4 = rate(q + step * k3)
    return OptimalControlProblem(
        states=(biomass, substrate, product, volume), controls=(feed,), dt=1 / 3, horizon=horizon,
        map=tuple(q + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)), cost=feed**2 / 6,
        q_0=(1, 5, 0, 2), q_d=(None, None, 0.5, None), bounds={feed: (0, 1)},
    )  # fmt: skip


PROBLEMS = {name: entry.problem for name, entry in SUITE.items()}
PROBLEMS |= {"all": WITH_EVERYTHING, "fed batch": fed_batch()}


def point(problem):
    """A random trajectory near q_0, where every function of the suite is defined."""
    rng = np.random.default_rng(0)
    n, m, N = problem.n, problem.m, problem.horizon
    q = np.array(problem.q_0)[:, None] + 0.2 * rng.uniform(-1, 1, (n, N))
    return q, 0.3 * rng.uniform(-1, 1, (m, N)), rng.normal(size=(n, N))


def of_stage(problem, k):
    return [values[k] for values in problem.inputs.values()]


@pytest.fixture
def shares(monkeypatch):
    """Derivatives of all problems by shared subexpressions."""
    _compiled.cache_clear()
    monkeypatch.setattr("ann_dc.problem.functions.LARGE", -1)
    yield
    _compiled.cache_clear()


@pytest.mark.parametrize("name", ["all", "two_link_arm", "cstr"])
def test_derivatives_by_shared_subexpressions(name, shares):
    test_stage_functions_and_derivatives(name)


def test_a_long_map_is_differentiated_by_shared_subexpressions():
    problem = fed_batch()
    assert sum(sp.count_ops(f) for f in problem.functions._compiled.f) > LARGE
    test_stage_functions_and_derivatives("fed batch")


def test_a_problem_with_a_long_map_settles_at_a_certified_optimum():
    solution = ann_dc.solve(fed_batch(horizon=12))
    assert solution.status.settled
    assert solution.certified
    assert solution["P"][-1] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.sampled(14)
@pytest.mark.parametrize("name", PROBLEMS)
def test_stage_functions_and_derivatives(name):
    problem = replace(PROBLEMS[name])
    q, u, mu = point(problem)
    functions, k = problem.functions, problem.horizon - 1
    step, cost, _ = casadi_functions(problem)
    z, p = ca.SX.sym("z", problem.n + problem.m), of_stage(problem, k)
    f, l = step(z[: problem.n], z[problem.n :], p), cost(z[: problem.n], z[problem.n :], p)  # noqa: E741
    hessian, gradient = ca.hessian(l + ca.dot(ca.DM(mu[:, k]), f), z)
    oracle = ca.Function("o", [z], [f, ca.jacobian(f, z), l, ca.gradient(l, z), hessian, gradient])
    want = [value.full() for value in oracle(ca.DM(np.r_[q[:, k], u[:, k]]))]

    F, B = functions.map_jacobian(q, u)
    got = [
        functions.map(q, u)[:, [k]],
        np.hstack([F[..., k], B[..., k]]),
        functions.cost(q, u)[k],
        np.concatenate(functions.cost_gradient(q, u))[:, [k]],
        functions.hessian(q, u, mu)[..., k],
    ]
    for ours, theirs in zip(got, want):
        np.testing.assert_allclose(ours, np.reshape(theirs, np.shape(ours)), rtol=1e-9, atol=1e-11)


def test_terminal_cost_and_derivatives():
    problem = WITH_EVERYTHING
    q_N = np.array([0.7, -0.4])
    value, gradient, hessian = problem.functions.terminal(q_N)
    terminal = casadi_functions(problem)[2]
    q = ca.SX.sym("q", 2)
    l_N = terminal(q, of_stage(problem, -1))
    oracle = ca.Function("o", [q], [l_N, *ca.hessian(l_N, q)[::-1]])
    for ours, theirs in zip((value, gradient, hessian), oracle(q_N)):
        np.testing.assert_allclose(ours, np.reshape(theirs.full(), np.shape(ours)), rtol=1e-12)


def test_rollout_obeys_the_map_and_objective_sums_the_cost():
    problem = WITH_EVERYTHING
    u = np.array([[0.1, -0.2, 0.3, 0.4]])
    q = problem.functions.rollout(problem.q_0, u)
    np.testing.assert_array_equal(q[:, 0], problem.q_0)
    np.testing.assert_allclose(q[:, 1:], problem.functions.map(q[:, :-1], u), rtol=1e-14)
    total = sum(problem.functions.cost(q[:, :-1], u)) + problem.functions.terminal(q[:, -1])[0]
    assert problem.functions.objective(q, u) == pytest.approx(total, rel=1e-14)


def test_where_numbers_have_errors_a_rollout_is_what_arrays_say():
    """A root of a negative number, a power of one, what overflows, what is divided by zero."""
    for f, first in (
        (sp.sqrt(x - 1), 0.5),
        (x ** sp.Rational(3, 2) - 2, 1.0),
        (sp.exp(x), 800.0),
        (1 / (x - 1), 1.0),
        (x**9, 1e99),
    ):
        problem = OptimalControlProblem(
            states=(x,), controls=(a,), map=(f + a,), cost=a**2, horizon=3, q_0=(first,)
        )
        q, u = np.full((1, 3), first), np.zeros((1, 3))
        reported = problem.functions.rollout(problem.q_0, u)
        assert not np.isfinite(reported).all()
        np.testing.assert_array_equal(reported[:, 1], problem.functions.map(q, u)[:, 0])


def test_derivatives_that_do_not_vary_are_there_at_every_stage():
    problem = SUITE["double_integrator"].problem
    functions, N = problem.functions, problem.horizon
    reported = functions.derivatives(np.zeros((2, N)), np.zeros((1, N)), np.ones((2, N)))
    for k in range(N):
        np.testing.assert_allclose(
            reported.jacobian[..., k], [[1, 0.1, 0], [0, 1, 0.1]], rtol=1e-15
        )
        np.testing.assert_array_equal(reported.hessian[..., k], np.diag([0, 0, 1]))


def test_equal_formulas_are_compiled_once_and_other_ones_anew():
    one, two = (plants.car(q_0=(start, 0, 0, 0)) for start in (0, 1))
    other = plants.car(D=2.0)
    q, u, _ = point(one)
    one.functions.map_jacobian(q, u)
    assert one.functions._compiled is two.functions._compiled
    assert one.functions._compiled is not other.functions._compiled
    assert not np.allclose(one.functions.map(q, u), other.functions.map(q, u))


def test_problems_of_equal_formulas_keep_their_own_inputs():
    first = WITH_EVERYTHING
    second = replace(first, inputs={w: 7.0})
    q, u, _ = point(first)
    assert first.functions._compiled is second.functions._compiled
    assert np.abs(first.functions.cost(q, u) - second.functions.cost(q, u)).min() > 0.0


CONSTRAINED = replace(
    WITH_EVERYTHING,
    constraints={"disc": x**2 + sp.exp(v) * a >= w, "pace": sp.tanh(v) ** 2 < 0.5, "sum": x <= a},
    terminal_constraints={"near": sp.sin(x) * v**2 <= w, "flat": 2 * x <= 1},
    bounds={x: (-1, 2), v: (None, 3), a: (-1, 1)},
)
"""Rows that vary, that are quadratic, that are linear, and bounds; all ends are free."""


def slopes_of(function, z, step=1e-100):
    """Complex-step derivatives of an array by z (n, ...), as a new axis before the last."""
    reported = []
    for i in range(len(z)):
        moved = z.astype(complex)
        moved[i] += 1j * step
        reported.append(function(moved).imag / step)
    return np.stack(reported, axis=1)


def rows_by_hand(z, inputs):
    """What `CONSTRAINED` declares, in NumPy."""
    x, v, a = z
    return np.array([
        inputs - x**2 - np.exp(v) * a, np.tanh(v) ** 2 - 0.5, x - a, -1 - x, x - 2, v - 3
    ])  # fmt: skip


def end_rows_by_hand(q, last):
    x, v = q
    return np.array([np.sin(x) * v**2 - last, 2 * x - 1, -1 - x, x - 2, v - 3])


@given(st.integers(0, 10**6))
def test_rows_and_their_derivatives(seed):
    rng, problem = np.random.default_rng(seed), CONSTRAINED
    z, zeta = rng.uniform(-1, 1, (3, 4)), rng.uniform(0, 2, (6, 4))
    q, u, inputs = z[:2], z[2:], problem.inputs[w]
    rows = problem.functions.rows(q, u)
    np.testing.assert_allclose(rows.value, rows_by_hand(z, inputs), rtol=1e-13, atol=1e-14)
    slopes = slopes_of(lambda moved: rows_by_hand(moved, inputs), z)
    np.testing.assert_allclose(rows.jacobian, slopes, rtol=1e-12, atol=1e-14)

    def weighted(moved):
        slopes = problem.functions.rows(moved[:2], moved[2:]).jacobian
        return np.einsum("rk,rik->ik", zeta, slopes)

    hessian = problem.functions.rows_hessian(q, u, zeta)
    differences = central_differences(weighted, z)
    np.testing.assert_allclose(hessian, differences, rtol=1e-6, atol=1e-8)
    np.testing.assert_array_equal(hessian, hessian.transpose(1, 0, 2))


@given(st.integers(0, 10**6))
def test_rows_of_the_end_and_their_derivatives(seed):
    rng, problem = np.random.default_rng(seed), CONSTRAINED
    q, zeta, last = rng.uniform(-1, 1, 2), rng.uniform(0, 2, 5), problem.inputs[w][-1]
    rows = problem.functions.end_rows(q)
    np.testing.assert_allclose(rows.value, end_rows_by_hand(q, last), rtol=1e-13, atol=1e-14)
    slopes = slopes_of(lambda moved: end_rows_by_hand(moved, last), q)
    np.testing.assert_allclose(rows.jacobian, slopes, rtol=1e-12, atol=1e-14)
    weighted = lambda moved: zeta @ problem.functions.end_rows(moved).jacobian  # noqa: E731
    hessian = problem.functions.end_rows_hessian(q, zeta)
    np.testing.assert_allclose(hessian, central_differences(weighted, q), rtol=1e-6, atol=1e-8)


def central_differences(function, z, step=1e-6):
    """Slopes of an array (n, ...) by z (n, ...), as a second axis."""
    reported = []
    for i in range(len(z)):
        ahead, behind = z.copy(), z.copy()
        ahead[i] += step
        behind[i] -= step
        reported.append((function(ahead) - function(behind)) / (2 * step))
    return np.stack(reported, axis=1)


def test_without_inequalities_there_are_no_rows():
    functions = WITH_EVERYTHING.functions
    q, u, _ = point(WITH_EVERYTHING)
    rows, end = functions.rows(q, u), functions.end_rows(q[:, -1])
    assert (rows.value.shape, rows.jacobian.shape) == ((0, 4), (0, 3, 4))
    assert (end.value.shape, end.jacobian.shape) == ((0,), (0, 2))
    assert not functions.rows_hessian(q, u, np.zeros((0, 4))).any()
    assert not functions.end_rows_hessian(q[:, -1], np.zeros(0)).any()


def test_rows_leave_map_and_cost_as_they_are():
    q, u, mu = point(WITH_EVERYTHING)
    plain = WITH_EVERYTHING.functions.derivatives(q, u, mu)
    for ours, theirs in zip(CONSTRAINED.functions.derivatives(q, u, mu), plain):
        np.testing.assert_array_equal(ours, theirs)
