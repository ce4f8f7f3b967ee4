"""The same problem by solvers on this CPU: they find the optimum, or are left out."""

import sys
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from costates import costates
from problems import SUITE
from reference import ipopt

from ann_dc.optimality.certificate import certify
from ann_dc.optimality.reference_solvers import ipopt_point, time_solvers
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem

PROBLEM = plants.double_integrator(N=4)

x, a = sp.symbols("x a")

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


LONG = plants.double_integrator(N=40, dt=3 / 40)
(X, V), (A,) = LONG.states, LONG.controls


@pytest.mark.parametrize(
    "changes",
    [
        {"bounds": {V: (None, 0.4)}},
        {"bounds": {A: (-0.6, 0.6)}},
        {"q_d": (None, None), "terminal_constraints": (X >= 1, V <= 0.1)},
        {"q_d": (1, None), "bounds": {V: (0, 0.45), A: (-0.4, 2)}},
    ],
)
def test_inequalities_and_limits_are_the_problems_own(changes):
    problem = replace(LONG, **changes)
    best, found = ipopt_point(problem), time_solvers(problem, repeats=1)
    free = ipopt_point(replace(problem, constraints=(), terminal_constraints=(), bounds={}))
    assert best.objective > free.objective + 1e-3
    assert len(found) == len(time_solvers(LONG, repeats=1))
    for timed in found:
        assert timed.objective == pytest.approx(best.objective, rel=1e-5)
    assert problem.functions.rows(best.q, best.u).value.max(initial=-1.0) < 1e-8
    assert problem.functions.end_rows(best.t[:, -1]).value.max(initial=-1.0) < 1e-8
    low, high = problem.control_limits.T[:, :, None]
    assert ((best.u > low - 1e-8) & (best.u < high + 1e-8)).all()


@pytest.mark.parametrize("name", PROBLEMS)
def test_multipliers_are_the_costates(name):
    problem = PROBLEMS[name]
    point, other = ipopt_point(problem), ipopt(problem)
    assert point.objective == pytest.approx(other.objective, rel=1e-9)
    q = np.column_stack([point.q, point.t[:, -1]])
    for own, reported in zip((point.mu, point.beta), costates(problem, q, point.u)):
        np.testing.assert_allclose(own, reported, atol=1e-7 * np.abs(reported).max())


def test_another_start_may_lead_to_another_optimum():
    """Around a disc in the way on either side, from where the search is told to begin."""
    x, y, a, b = sp.symbols("x y a b")
    problem = OptimalControlProblem(
        states=(x, y), controls=(a, b), map=(x + a, y + b), cost=a**2 + b**2, horizon=20,
        q_0=(-1, 0), q_d=(1, 0), constraints=(x**2 + y**2 >= 0.09,),
    )  # fmt: skip
    share = np.linspace(0, 1, 21)
    found = [
        ipopt_point(
            problem, np.array([2 * share - 1, bow * np.sin(np.pi * share)]), np.zeros((2, 20))
        )
        for bow in (0.8, -0.8)
    ]
    assert [np.sign(point.q[1, 10]) for point in found] == [1, -1]
    for point in found:
        assert certify(problem, *point.kkt).certified
    assert found[0].objective == pytest.approx(found[1].objective)


def test_a_solver_that_fails_is_left_out():
    """One stage cannot reach a target."""
    assert time_solvers(plants.double_integrator(N=1), repeats=1) == ()
    assert ipopt_point(plants.double_integrator(N=1)) is None


def test_without_casadi_there_is_no_time(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    assert time_solvers(PROBLEM) == ()
    assert ipopt_point(PROBLEM) is None


def test_ipopt_point_of_a_single_state_with_a_free_end():
    problem = OptimalControlProblem(
        states=(x,), controls=(a,), dynamics=(a,), cost=a**2, horizon=4, q_0=(1,),
        terminal_constraints={"end": x**2 <= 0.04},
    )  # fmt: skip
    found = ipopt_point(problem)
    assert found is not None
    assert found.t[0, -1] == pytest.approx(0.2, abs=1e-6)
