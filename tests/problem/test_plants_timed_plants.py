"""Time plus effort against IPOPT, for which the step length is a plain variable with bounds.

The transcriptions are written down once more here, in CasADi; nothing of ann_dc is in them.
"""

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
import sympy as sp

import ann_dc
from ann_dc.problem import plants
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.step_length import StepLength

OPTIONS = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}}


@dataclass(frozen=True)
class Timed:
    """A plant as a textbook has it: rates of q in CasADi, ends, bounds of h, price of time."""

    rates: object
    q_0: tuple
    q_d: tuple
    controls: int
    horizon: int
    bounds: tuple
    price: float

    def ipopt(self) -> tuple[float, float]:
        """(objective, h), from a straight line and the geometric mean of the bounds."""
        n, N = len(self.q_0), self.horizon
        q, u, h = ca.SX.sym("q", n, N + 1), ca.SX.sym("u", self.controls, N), ca.SX.sym("h")
        gaps = [
            q[:, k] + h * ca.vertcat(*self.rates(q[:, k], u[:, k])) - q[:, k + 1] for k in range(N)
        ]
        program = {
            "x": ca.vertcat(ca.vec(q), ca.vec(u), h),
            "f": h * (N * self.price + ca.sumsqr(u) / 2),
            "g": ca.vertcat(*gaps, q[:, 0] - ca.DM(self.q_0), q[:, N] - ca.DM(self.q_d)),
        }
        solver = ca.nlpsol("timed", "ipopt", program, OPTIONS)
        line = np.linspace(self.q_0, self.q_d, N + 1).ravel()
        push = np.full(self.controls * N, 1.0)
        free = np.full(line.size + push.size, np.inf)
        answer = solver(
            x0=np.concatenate([line, push, [np.sqrt(np.prod(self.bounds))]]),
            lbx=np.append(-free, self.bounds[0]), ubx=np.append(free, self.bounds[1]),
            lbg=0, ubg=0,
        )  # fmt: skip
        assert solver.stats()["success"]
        return float(answer["f"]), float(answer["x"][-1])


def mass_rates(q, u):
    return q[1], u[0]


def car_rates(q, u):
    return (
        ca.cos(q[2]) * u[0] - 0.1 * q[0], ca.sin(q[2]) * u[0] - 0.1 * q[1],
        ca.tan(q[3]) * u[0] - 0.1 * q[2], u[1] - 0.1 * q[3],
    )  # fmt: skip


def pendulum_rates(q, u):
    return q[1], 4.905 * ca.sin(q[0]) - 0.1 * q[1] + u[0]


def mass(**bounds) -> OptimalControlProblem:
    h = sp.Symbol("h")
    given = plants.double_integrator()
    return replace(given, dt=StepLength(**bounds), cost=h * (1 + given.cost))


CASES = {
    "mass": (
        lambda: mass(low=0.02, high=0.5),
        Timed(mass_rates, (0, 0), (1, 0), 1, 20, (0.02, 0.5), 1.0),
    ),
    "mass without an upper bound": (
        lambda: mass(low=0.02),
        Timed(mass_rates, (0, 0), (1, 0), 1, 20, (0.02, 10.0), 1.0),
    ),
    "car": (
        plants.get("car_free_time"),
        Timed(car_rates, (0, 0, 0, 0), (5, 5, 0, 0), 2, 9, (0.02, 2.0), 1.0),
    ),
    "mass in haste": (  # its upper bound holds
        lambda: mass(low=0.02, high=0.05),
        Timed(mass_rates, (0, 0), (1, 0), 1, 20, (0.02, 0.05), 1.0),
    ),
    "pendulum": (
        plants.get("pendulum_free_time"),
        Timed(pendulum_rates, (np.pi, 0), (0, 0), 1, 20, (0.02, 0.25), 20.0),
    ),
}


@cache
def solved(name: str) -> ann_dc.Solution:
    return ann_dc.solve(CASES[name][0]())


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n.startswith("mass ") else n for n in CASES],
)
def test_the_network_settles_at_ipopts_optimum(name):
    solution, (objective, h) = solved(name), CASES[name][1].ipopt()
    assert solution.certified
    assert solution.objective == pytest.approx(objective, rel=1e-5)
    assert solution.step_length == pytest.approx(h, rel=1e-5)


def test_one_number_serves_all_stages():
    solution = solved("car")
    assert np.ptp(solution["h"]) < 1e-6 * solution.step_length
    assert solution.total_time == pytest.approx(9 * solution.step_length)
    assert solution.time == pytest.approx(solution.step_length * np.arange(10), rel=1e-6)


def test_a_step_length_at_its_bound_is_told():
    assert "0.05 s (its upper bound), 20 stages last 1 s" in str(solved("mass in haste"))
    assert "upper bound" not in str(solved("mass"))


def test_minutes_instead_of_seconds_are_the_same_network():
    """The coordinate of a step length has no unit."""
    problem = mass(low=0.02, high=0.5)
    rates = [sp.Float(60.0) * rate for rate in problem.dynamics]
    slow = replace(
        problem, dynamics=rates, cost=60 * problem.cost, dt=StepLength(low=0.02 / 60, high=0.5 / 60)
    )
    here, there = (ann_dc.synthesize(p) for p in (problem, slow))
    x = here.start_state + 0.1
    assert ann_dc.evaluator(there).rhs(x) == pytest.approx(ann_dc.evaluator(here).rhs(x), rel=1e-9)


@pytest.mark.parametrize("name", ["car_free_time", "pendulum_free_time"])
def test_a_step_length_that_is_given_is_what_it_says(name):
    chosen, given = plants.get(name)(N=3), plants.get(name)(N=3, dt=0.1)
    assert (given.n, given.dt, given.handed_on) == (chosen.n - 1, 0.1, ())
    assert sp.simplify(chosen.cost.subs(chosen.dt.symbol, 0.1) - given.cost) == 0
