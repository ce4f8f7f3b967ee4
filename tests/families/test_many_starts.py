"""Many starts: the optima are optima by another solver too, and every start is accounted for."""

import subprocess
import sys
from dataclasses import replace
from functools import cache

import casadi
import numpy as np
import pytest
import sympy
from problems import SUITE

from ann_dc import multistart
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.errors import ProblemError
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess, interpolated_guess

BLOCKS = {name: getattr(casadi, name) for name in ("sin", "cos", "tan", "exp", "sqrt")}
TWO = replace(plants.unicycle_soft_obstacle(N=16, dt=0.2), name="obstacle")


@cache
def obstacle():
    return multistart(TWO, 12)


@pytest.mark.slow
def test_the_known_optima_and_no_others():
    known = SUITE["unicycle_obstacle"]
    found = multistart(known.problem, 12)
    np.testing.assert_allclose([o.objective for o in found.optima], known.optima, rtol=1e-3)


@pytest.mark.slow
def test_both_ways_around_the_obstacle():
    found = obstacle()
    x, y = 1.5, 0.6
    beside = [optimum.q[1, np.abs(optimum.q[0] - x).argmin()] > y for optimum in found.optima]
    assert sorted(beside) == [False, True]
    assert found.best is found.optima[0]
    led = sorted(start for optimum in found.optima for start in optimum.starts)
    assert len(led) + found.unsettled == len(found.starts) == 12
    assert len(set(led)) == len(led)
    assert [optimum.share for optimum in found.optima] == [o.count / 12 for o in found.optima]
    assert all(optimum.certificate.certified for optimum in found.optima)


def stays(problem, q: np.ndarray, u: np.ndarray) -> tuple[float, float]:
    """(objective, largest move of a control) of IPOPT that is started at an optimum."""
    opti = casadi.Opti()
    Q, U = opti.variable(*q.shape), opti.variable(*u.shape)
    symbols = [*problem.states, *problem.controls]
    step = sympy.lambdify(symbols, list(problem.f), modules=[BLOCKS])
    cost = sympy.lambdify(symbols, problem.cost, modules=[BLOCKS])
    total = 0
    for k in range(problem.horizon):
        values = [*(Q[i, k] for i in range(problem.n)), *(U[i, k] for i in range(problem.m))]
        opti.subject_to(Q[:, k + 1] == casadi.vertcat(*step(*values)))
        total = total + cost(*values)
    opti.subject_to(Q[:, 0] == np.array(problem.q_0))
    for i, goal in enumerate(problem.q_d):
        if goal is not None:
            opti.subject_to(Q[i, -1] == goal)
    opti.minimize(total)
    opti.set_initial(Q, q)
    opti.set_initial(U, u)
    quiet = {"print_level": 0, "sb": "yes", "tol": 1e-10}
    opti.solver("ipopt", {"print_time": False}, quiet)
    solved = opti.solve()
    return float(solved.value(total)), float(np.abs(solved.value(U).reshape(u.shape) - u).max())


@pytest.mark.slow
def test_ipopt_started_at_an_optimum_stays_there():
    for optimum in obstacle().optima:
        objective, moved = stays(TWO, optimum.q, optimum.u)
        np.testing.assert_allclose(optimum.objective, objective, rtol=1e-6)
        assert moved < 1e-5 * np.abs(optimum.u).max()


@pytest.mark.slow
def test_an_optimum_run_alone_is_the_same():
    found = obstacle()
    for index, optimum in enumerate(found.optima):
        solution = found.solution(index)
        assert solution.certified
        np.testing.assert_allclose(solution.objective, optimum.objective, rtol=1e-8)


@pytest.mark.slow
def test_it_reads_well():
    lines = str(obstacle()).splitlines()
    assert lines[0].startswith("obstacle (N = ")
    assert "2 certified optima from 12 starts" in lines[0]
    assert lines[2].split()[0].startswith("1.81")
    data = obstacle().as_dict()
    assert [len(optimum["states"]["x"]) for optimum in data["optima"]] == [TWO.horizon + 1] * 2


def test_a_start_that_the_batch_gives_up_has_a_run_of_its_own():
    problem = plants.double_integrator(N=5)
    found = multistart(problem, 3, backend=RecurrentBackend(limit=4))
    assert (found.best.count, found.best.frozen, found.unsettled) == (3, 0, 0)
    assert found.best.objective == pytest.approx(500, rel=1e-9)
    assert found.solution().design is not found.design
    assert not found.solution().status.settled  # with four steps


def test_starts_of_ones_own():
    problem = plants.double_integrator(N=5)
    line = interpolated_guess(problem)
    found = multistart(problem, [line, InitialGuess(q=line.q, u=0 * line.u)])
    assert [optimum.starts for optimum in found.optima] == [(0, 1)]
    bad = InitialGuess(q=np.full_like(line.q, np.inf), u=line.u)
    with pytest.raises(ProblemError, match=r"starts\[1\]\.q: inf"):
        multistart(problem, [line, bad])


@pytest.mark.parametrize("count", [0, -3, 1.5, "many", None, True])
def test_counts_that_are_refused(count):
    with pytest.raises(ProblemError, match="starts: expected a whole number"):
        multistart(plants.double_integrator(N=5), count)


@pytest.mark.slow
def test_two_processes_say_the_same_bytes():
    script = (
        "import ann_dc, hashlib; f = ann_dc.multistart(ann_dc.plants.car(N=5, dt=0.18), 5);"
        "print(f, hashlib.sha256(f.batch.states.tobytes()).hexdigest())"
    )
    said = {
        subprocess.run([sys.executable, "-c", script], capture_output=True, check=True).stdout
        for _ in range(2)
    }
    assert len(said) == 1


@pytest.mark.slow
def test_starts_that_stall_are_counted():
    x, a = sympy.symbols("x a")
    far = OptimalControlProblem(
        states=(x,), controls=(a,), map=(x + sympy.tanh(a),), cost=a**2, horizon=3,
        q_0=(0,), q_d=(40,),
    )  # fmt: skip
    found = multistart(far, 2, backend=RecurrentBackend(limit=20_000))
    assert found.best is None
    assert found.unsettled == 2
    assert "2 stalled" in str(found)
    assert "no controls reach q_d.x = 40" in str(found)


@pytest.mark.slow
def test_what_the_frozen_network_loses_has_a_run_of_its_own():
    """Far apart: constants of one optimum hold none of the others, and each is one for IPOPT."""
    problem = SUITE["car_g3"].problem
    found = multistart(problem, 12)
    assert len(found) >= 4
    assert found.unsettled <= 4
    for optimum in found.optima:
        objective, moved = stays(problem, optimum.q, optimum.u)
        np.testing.assert_allclose(optimum.objective, objective, rtol=1e-6)
        assert moved < 1e-5 * np.abs(optimum.u).max()
    lost = next(i for i, optimum in enumerate(found.optima) if not optimum.frozen)
    assert found.solution(lost).objective == pytest.approx(found.optima[lost].objective, rel=1e-6)
