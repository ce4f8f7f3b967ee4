"""Targets that can be met and targets that cannot, against closed forms and IPOPT."""

import numpy as np
import pytest
from hopeless import INFEASIBLE, UNBOUNDED
from problems import SUITE
from reference import ipopt

from ann_dc.optimality.feasibility import feasible_path, out_of_reach
from ann_dc.problem import plants
from ann_dc.problem.scales import straight_line


def searched(problem):
    line = straight_line(problem)
    return feasible_path(problem, line.q, line.u)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", INFEASIBLE)
def test_what_is_out_of_reach_and_what_is_nearest(name):
    problem, nearest = INFEASIBLE[name]
    found = out_of_reach(problem, searched(problem))
    assert found is not None
    assert found.reached.keys() == {f"q_d.{state}" for state in nearest}
    for state, value in nearest.items():
        size = max(abs(d) for d in problem.q_d)
        np.testing.assert_allclose(found.reached[f"q_d.{state}"], value, atol=1e-3 * size)
        assert f"q_d.{state} = " in found.message
        rollout = problem.functions.rollout(problem.q_0, found.path.u)[:, -1]
        end = rollout[[str(s) for s in problem.states].index(state)]
        np.testing.assert_allclose(end, value, atol=0.02 * size)


@pytest.mark.parametrize("name", ["twins", "mass is kept", "too far"])
def test_ipopt_finds_no_path_either(name):
    assert not ipopt(INFEASIBLE[name][0]).success


@pytest.mark.sampled(10)
@pytest.mark.parametrize("name", SUITE)
def test_every_problem_of_the_suite_has_a_path_that_meets_it(name):
    problem = SUITE[name].problem
    path = searched(problem)
    assert path.met
    assert out_of_reach(problem, path) is None
    # the plant itself agrees, as far as a roll-out of an unstable one can
    gap = problem.functions.map(path.q[:, :-1], path.u) - path.q[:, 1:]
    assert np.abs(gap).max() <= 1e-7 * np.abs(path.q).max()
    first, last = problem.ends
    fixed = np.array(problem.fixed)
    np.testing.assert_array_equal(path.q[:, 0], first)
    np.testing.assert_array_equal(path.q[fixed, -1], last[fixed])


@pytest.mark.parametrize("name", UNBOUNDED)
def test_a_cost_without_a_minimum_is_another_matter(name):
    assert searched(UNBOUNDED[name]).met


def test_a_path_of_no_numbers_is_left_out():
    problem = plants.double_integrator(N=5)
    line = straight_line(problem)
    assert feasible_path(problem, np.full_like(line.q, np.nan), line.u).met
