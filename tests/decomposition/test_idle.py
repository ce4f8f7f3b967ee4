"""Controls without effect are held, and the optima stay the problem's."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from reference import best_of

import ann_dc
from ann_dc.decomposition.idle import determined, held, idle_controls
from ann_dc.optimality.reference_solvers import ipopt_point
from ann_dc.problem.scales import natural_scales

x, y, h, v, a, b = sp.symbols("x y h v a b")

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


def rolling(speed):
    """A cart that is steered, which a cart at rest does not feel."""
    return ann_dc.OptimalControlProblem(
        states=(x, y, h, v), controls=(a, b), dynamics=(v * sp.cos(h), v * sp.sin(h), v * b, a),
        dt=0.2, cost=a**2, horizon=10, q_0=(0, 0, 0, speed), q_d=(1, 0.3, None, 0),
        bounds={b: (-1, 1)},
    )  # fmt: skip


@pytest.mark.parametrize(("speed", "stages"), [(0, [0, 9]), (0.5, [9])])
def test_control_is_idle_where_a_state_of_zero_multiplies_it(speed, stages):
    problem = rolling(speed)
    assert np.flatnonzero(idle_controls(problem)[:, 1]).tolist() == stages
    assert np.flatnonzero(idle_controls(problem, any_start=True)[:, 1]).tolist() == [9]


@pytest.mark.slow
def test_solve_certifies_steering_from_rest():
    solution = ann_dc.solve(rolling(0))
    assert solution.certified, solution.verdict
    assert solution.objective == pytest.approx(best_of(rolling(0)).objective, rel=1e-6)


def test_row_that_q_0_alone_determines_has_room_where_it_touches():
    problem = replace(
        CHAIN,
        q_0=(0, 0),
        bounds={x: (0, None), a: (-1, 1)},
        cost=(x - 1) ** 2 + v**2,
        terminal_cost=v**2,
    )
    ((name, room),) = determined(problem).rooms.items()
    assert name == "x_low"
    assert np.flatnonzero(room).tolist() == [0, 1]  # x_1 = x_0 + dt v_0
    assert held(problem, any_start=True) is problem
    solution = ann_dc.solve(problem)
    assert solution.certified, solution.verdict
    assert solution.objective == pytest.approx(best_of(problem).objective, rel=1e-6)


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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("bounds", [(-1, 1), (0, 1), (0.5, 2), (-3, -1)])
def test_solve_certifies_a_strict_minimum_with_held_controls_inside_their_limits(bounds):
    problem = replace(CHAIN, bounds={a: bounds})
    solution = ann_dc.solve(problem)
    assert solution.certified, solution.status
    assert "constant where it has no effect: a" in str(solution)
    free = solution["a"][-2:]
    assert (bounds[0] < free).all()
    assert (free < bounds[1]).all()
    reference = ipopt_point(problem, solution["q"].T, solution["u"].T)
    assert solution.objective == pytest.approx(reference.objective, rel=1e-6)
