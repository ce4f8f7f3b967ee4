"""Controls without effect are held, and the optima stay the problem's."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc.decomposition import held, idle_controls
from ann_dc.optimality import ipopt_point
from ann_dc.problem import natural_scales

x, v, a, b = sp.symbols("x v a b")

CHAIN = ann_dc.OptimalControlProblem(
    states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, cost=x**2, horizon=8,
    q_0=(1, 0), bounds={a: (-1, 1)},
)  # fmt: skip


def idle_stages(problem):
    return idle_controls(problem).sum(axis=0).tolist()


@pytest.mark.parametrize(
    ("fields", "stages"),
    [
        ({}, 2),
        ({"cost": x**2 + v**2}, 1),
        ({"terminal_cost": x**2}, 1),
        ({"terminal_cost": v}, 0),
        ({"q_d": (None, 0)}, 0),
        ({"bounds": {a: (-1, 1), v: (-1, 1)}}, 0),
        ({"constraints": [x + v <= 5]}, 1),
        ({"cost": x**2 + 1e-9 * a**2}, 0),
    ],
)
def test_control_is_idle_where_only_free_states_follow_it(fields, stages):
    assert idle_stages(replace(CHAIN, **fields)) == [stages]


def test_idle_control_changes_no_cost():
    rng, problem = np.random.default_rng(0), CHAIN
    u = rng.uniform(-1, 1, (1, 8))
    other = np.where(idle_controls(problem).T, rng.uniform(-1, 1, (1, 8)), u)
    paths = [problem.functions.rollout(np.array([1.0, 0.0]), w) for w in (u, other)]
    costs = [problem.functions.objective(q, w) for q, w in zip(paths, (u, other))]
    assert costs[0] == costs[1]
    assert not np.array_equal(u, other)


def test_problem_without_idle_controls_is_itself():
    for problem in (ann_dc.plants.car(), replace(CHAIN, cost=x**2 + a**2)):
        assert held(problem) is problem


def test_held_problem_has_the_scales_of_the_problem():
    from_problem, from_held = (natural_scales(p) for p in (CHAIN, held(CHAIN)))
    np.testing.assert_allclose(from_held.states, from_problem.states, rtol=1e-12)
    np.testing.assert_allclose(from_held.controls, from_problem.controls, rtol=1e-12)
    assert from_held.cost == pytest.approx(from_problem.cost, rel=1e-12)


@pytest.mark.parametrize("bounds", [(-1, 1), (0, 1), (0.5, 2), (-3, -1)])
def test_solve_certifies_a_strict_minimum_with_held_controls_inside_their_limits(bounds):
    problem = replace(CHAIN, bounds={a: bounds})
    solution = ann_dc.solve(problem)
    assert solution.certified, solution.status
    assert "held where it has no effect: a" in str(solution)
    free = solution["a"][-2:]
    assert (bounds[0] < free).all()
    assert (free < bounds[1]).all()
    reference = ipopt_point(problem, solution["q"].T, solution["u"].T)
    assert solution.objective == pytest.approx(reference.objective, rel=1e-6)
