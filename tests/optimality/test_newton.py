"""The Newton step against a dense solution of the KKT conditions, and against known optima."""

from dataclasses import replace

import numpy as np
import pytest
from costates import costates
from points import random_point
from problems import SUITE
from reference import ipopt

from ann_dc.optimality import newton_step
from ann_dc.problem import natural_scales, plants

NAMES = ["car", "unicycle", "bicycle", "van_der_pol", "lq_unst", "pendulum_state_cost", "cstr"]


def dense_step(problem, q, u, mu) -> float:
    """The same from one dense matrix in (q_0..q_N, u, mu), with a row for whatever is fixed."""
    functions, n, m, N = problem.functions, problem.n, problem.m, problem.horizon
    F, B = functions.map_jacobian(q[:, :-1], u)
    W = functions.hessian(q[:, :-1], u, mu)
    of_q, of_u = functions.cost_gradient(q[:, :-1], u)
    _, end_slope, end_hessian = functions.terminal(q[:, -1])
    states, controls = n * (N + 1), m * N
    H, A = np.zeros((states + controls,) * 2), np.zeros((n * N, states + controls))
    slope = np.concatenate([np.column_stack([of_q, end_slope]).T.ravel(), of_u.T.ravel()])
    for k in range(N):
        z = np.r_[n * k : n * (k + 1), states + m * k : states + m * (k + 1)]
        rows = slice(n * k, n * (k + 1))
        H[np.ix_(z, z)] += W[:, :, k]
        A[rows, z] = np.hstack([F[:, :, k], B[:, :, k]])
        A[rows, n * (k + 1) : n * (k + 2)] = -np.eye(n)
    H[states - n : states, states - n : states] += end_hessian
    c = (functions.map(q[:, :-1], u) - q[:, 1:]).T.ravel()
    free = np.ones((N + 1, n), bool)
    free[0] = [value is None for value in problem.q_0]
    free[-1] = [value is None for value in problem.q_d]
    kept = np.r_[free.ravel(), np.ones(controls, bool)]
    scales = natural_scales(problem)
    D = np.r_[np.tile(scales.state_factors, N + 1), np.tile(scales.control_factors, N)][kept]
    E = np.tile(1 / scales.state_factors, N)
    H = D[:, None] * H[np.ix_(kept, kept)] * D / scales.cost
    A = E[:, None] * A[:, kept] * D
    K = np.block([[H, A.T], [A, np.zeros((n * N, n * N))]])
    of_z = slope + _of_constraints(problem, F, B, mu)
    right = -np.r_[D * of_z[kept] / scales.cost, E * c]
    step = np.zeros(len(kept))
    step[kept] = np.linalg.solve(K, right)[: kept.sum()]
    moves = step[:states].reshape(-1, n), step[states:].reshape(-1, m)
    offsets = [scale.offset for scale in scales.states + scales.controls]
    places = (
        (q.T - offsets[:n]) / scales.state_factors,
        (u.T - offsets[n:]) / scales.control_factors,
    )
    ranges = [np.abs(values).max(axis=0) for values in places]
    return max((np.abs(move).max(axis=0) / size).max() for move, size in zip(moves, ranges))


def _of_constraints(problem, F, B, mu):
    """A' mu of the map's rows."""
    of_q = np.zeros((problem.horizon + 1, problem.n))
    of_q[:-1] += np.einsum("ijk,ik->kj", F, mu)
    of_q[1:] -= mu.T
    return np.concatenate([of_q.ravel(), np.einsum("ijk,ik->kj", B, mu).ravel()])


@pytest.mark.parametrize("name", NAMES)
def test_a_band_says_what_a_dense_matrix_says(name):
    rng = np.random.default_rng(0)
    for trial in range(4):
        problem = SUITE[name].problem.with_horizon(int(rng.integers(4, 12)))
        if trial:  # something free at either end
            ends = {"q_0": problem.q_0, "q_d": problem.q_d}
            for end, given in ends.items():
                ends[end] = [None if rng.random() < 0.3 else value for value in given]
            problem = replace(problem, **ends)
        q, u, mu = random_point(problem, rng, spread=0.1)
        np.testing.assert_allclose(
            newton_step(problem, q, u, mu), dense_step(problem, q, u, mu), rtol=1e-8
        )


@pytest.mark.parametrize("name", NAMES)
def test_a_newton_step_leads_to_the_optimum(name):
    """The step is the distance to the optimum, up to its square."""
    problem = SUITE[name].problem
    found = ipopt(problem)
    mu, _ = costates(problem, found.q, found.u)
    assert newton_step(problem, found.q, found.u, mu) < 1e-5
    u = found.u.copy()
    from_zero = u[0] - natural_scales(problem).controls[0].offset
    u[0, 3] += 1e-3 * np.abs(from_zero).max()
    np.testing.assert_allclose(newton_step(problem, found.q, u, mu), 1e-3, rtol=0.05)


def test_where_the_multipliers_are_not_told_there_is_no_step():
    """One stage with both ends fixed: more constraints than controls."""
    problem = plants.double_integrator(N=1)
    zero = np.zeros((2, 2))
    assert np.isnan(newton_step(problem, zero, np.zeros((1, 1)), zero[:, :1]))
