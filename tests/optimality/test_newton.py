"""The Newton step against a dense solution of the KKT conditions, and against known optima."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from costates import costates
from points import random_point
from problems import SUITE
from reference import ipopt

from ann_dc.optimality import newton
from ann_dc.optimality.expansion import Expansion
from ann_dc.problem import plants
from ann_dc.problem.scales import natural_scales

NAMES = ["car", "unicycle", "bicycle", "van_der_pol", "lq_unst", "pendulum_state_cost", "cstr"]


def newton_step(problem, q, u, mu, zeta=None) -> float:
    return newton.newton_step(Expansion.at(problem, q, u, mu, zeta), q)


def dense_step(problem, q, u, mu, zeta=None) -> tuple[float, np.ndarray]:
    """The same from one dense matrix in (q_0..q_N, u, mu), with a row for whatever is fixed.

    Rows with a multiplier in ``zeta`` (r, N) hold as equations; their new multipliers come too.
    """
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
    G, g = _held(problem, q, u, zeta, H)
    c = (functions.map(q[:, :-1], u) - q[:, 1:]).T.ravel()
    free = np.ones((N + 1, n), bool)
    free[0] = [value is None for value in problem.q_0]
    free[-1] = [value is None for value in problem.q_d]
    kept = np.r_[free.ravel(), np.ones(controls, bool)]
    scales = natural_scales(problem)
    D = np.r_[np.tile(scales.state_factors, N + 1), np.tile(scales.control_factors, N)][kept]
    E = np.tile(1 / scales.state_factors, N)
    H = D[:, None] * H[np.ix_(kept, kept)] * D / scales.cost
    A = np.vstack([E[:, None] * A[:, kept] * D, G[:, kept] * D])
    K = np.block([[H, A.T], [A, np.zeros((len(A), len(A)))]])
    of_z = slope + _of_constraints(problem, F, B, mu)
    right = -np.r_[D * of_z[kept] / scales.cost, E * c, g]
    step, solved = np.zeros(len(kept)), np.linalg.solve(K, right)
    step[kept] = solved[: kept.sum()]
    moves = step[:states].reshape(-1, n), step[states:].reshape(-1, m)
    offsets = [scale.offset for scale in scales.states + scales.controls]
    places = (
        (q.T - offsets[:n]) / scales.state_factors,
        (u.T - offsets[n:]) / scales.control_factors,
    )
    ranges = [np.abs(values).max(axis=0) for values in places]
    largest = max((np.abs(move).max(axis=0) / size).max() for move, size in zip(moves, ranges))
    return largest, solved[len(solved) - len(g) :]


def _held(problem, q, u, zeta, H):
    """Slopes and values of the rows that have a multiplier; their curvature goes into H."""
    if zeta is None:
        return np.zeros((0, len(H))), np.zeros(0)
    n, m, states = problem.n, problem.m, problem.n * (problem.horizon + 1)
    rows, bent = problem.functions.rows(q[:, :-1], u), problem.functions.rows_hessian
    slopes, values = [], []
    for i, k in np.argwhere(zeta > 0):
        z = np.r_[n * k : n * (k + 1), states + m * k : states + m * (k + 1)]
        slopes.append(np.zeros(len(H)))
        slopes[-1][z] = rows.jacobian[i, :, k]
        values.append(rows.value[i, k])
    for k, curvature in enumerate(np.moveaxis(bent(q[:, :-1], u, zeta), -1, 0)):
        z = np.r_[n * k : n * (k + 1), states + m * k : states + m * (k + 1)]
        H[np.ix_(z, z)] += curvature
    return np.array(slopes), np.array(values)


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
            newton_step(problem, q, u, mu), dense_step(problem, q, u, mu)[0], rtol=1e-8
        )


SLOW = pytest.mark.slow


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("car", marks=SLOW),
        pytest.param("unicycle", marks=SLOW),
        pytest.param("van_der_pol", marks=SLOW),
        pytest.param("cstr", marks=SLOW),
        "double_integrator",
    ],
)
def test_rows_that_touch_are_equations(name):
    """Curved rows that touch at a stage or two, wherever the point is."""
    rng, seen = np.random.default_rng(1), 0
    edges = sp.symbols("edge_0 edge_1")
    for _ in range(30):
        problem = SUITE[name].problem.with_horizon(int(rng.integers(4, 12)))
        q, u, mu = random_point(problem, rng, spread=0.1)
        z = [*problem.states, *problem.controls]
        factors = rng.normal(size=(2, len(z))) / np.array(
            [scale.factor for scales in [natural_scales(problem)]
             for scale in scales.states + scales.controls]
        )  # fmt: skip
        own = [sp.Add(*(f * s for f, s in zip(row, z))) for row in factors]
        rows = [mean + mean**2 / 4 for mean in own]
        touching = np.zeros((2, problem.horizon), bool)
        touching[rng.integers(0, 2, 2), rng.integers(1, problem.horizon, 2)] = True
        values = [sp.lambdify(z, row)(*q[:, :-1], *u) for row in rows]
        problem = replace(
            problem,
            constraints=[row <= edge for row, edge in zip(rows, edges)],
            inputs={**problem.inputs, **dict(zip(edges, values + 1.0 * ~touching))},
        )
        zeta = np.where(touching, natural_scales(problem).cost, 0.0)
        expected, multipliers = dense_step(problem, q, u, mu, zeta)
        if multipliers.min() > 0:
            np.testing.assert_allclose(newton_step(problem, q, u, mu, zeta), expected, rtol=1e-3)
            seen += 1
    assert seen > 4


def test_a_row_of_the_end_holds_it_or_lets_it_go():
    """Where x is at its bound the step is that of a fixed end on the side that pulls, else free."""
    problem = plants.double_integrator(N=6, q_d=(1, None))
    x, sides = problem.states[0], set()
    for seed in range(10):
        q, u, mu = random_point(problem, np.random.default_rng(seed))
        q[0, -1] = 1.0
        fixed, free = newton_step(problem, q, u, mu), replace(problem, q_d=(None, None))
        reported = [
            newton_step(replace(free, terminal_constraints=(row, x + 1 >= 0)), q, u, mu)
            for row in (x >= 1, x <= 1)
        ]
        expected = [fixed, newton_step(free, q, u, mu)]
        is_upper = abs(reported[1] - fixed) < abs(reported[0] - fixed)
        np.testing.assert_allclose(reported[::-1] if is_upper else reported, expected, rtol=1e-6)
        sides.add(is_upper)
    assert sides == {False, True}


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
