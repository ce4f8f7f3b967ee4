"""The same problem by solvers on this CPU: they find the optimum, or are left out."""

import sys
from dataclasses import replace

import pytest
from problems import SUITE
from reference import ipopt

from ann_dc.optimality import time_solvers
from ann_dc.problem import plants

PROBLEM = plants.double_integrator(N=4)

PROBLEMS = {
    "car": SUITE["car"].problem,
    "unicycle": SUITE["unicycle"].problem,
    "double_integrator": PROBLEM,
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_solvers_on_the_cpu_find_the_optimum(name):
    found = time_solvers(PROBLEMS[name], repeats=2)
    assert found
    assert {timed.name for timed in found} <= {"IPOPT", "fatrop"}
    best = ipopt(PROBLEMS[name])
    assert best.success
    for timed in found:
        assert timed.objective == pytest.approx(best.objective, rel=1e-6), timed.name
        assert timed.seconds > 0
        assert timed.iterations > 0


def test_a_free_end_and_inputs_that_change_are_the_problems_own():
    """Anything that the problem says, and multiple shooting must not forget."""
    for problem in (
        replace(PROBLEM, q_d=(1.0, None)),
        replace(PROBLEM, q_0=(0.0, None), cost=PROBLEM.cost + PROBLEM.states[1] ** 2),
        replace(SUITE["unicycle"].problem, q_d=(2.0, 1.0, None)),
    ):
        for timed in time_solvers(problem, repeats=1):
            assert timed.objective == pytest.approx(ipopt(problem).objective, rel=1e-6)


def test_a_solver_that_fails_is_left_out():
    """One stage cannot reach a target."""
    assert time_solvers(plants.double_integrator(N=1), repeats=1) == ()


def test_without_casadi_there_is_no_time(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    assert time_solvers(PROBLEM) == ()
