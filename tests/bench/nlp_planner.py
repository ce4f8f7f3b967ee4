"""The planner that a digital computer would run: the same horizon by IPOPT, discs as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import sympy as sp

from ann_dc.navigation.half_planes import Margin
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.navigation.scenario import Scenario
from ann_dc.problem.robot import Robot

AWAY = np.array([100.0, 100.0, 0.5])
"""x, y and reach of a slot without a disc."""
OPTIONS = {
    "print_time": False,
    "expand": True,
    "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-6},
}


@dataclass(frozen=True, kw_only=True, eq=False)
class NlpPlanner:
    """Model-predictive control with disc rows, their violation priced, solved anew each period."""

    robot: Robot
    horizon: int = 20
    dt: float = 0.1
    slots: int = 8
    pull: float = 0.15
    price: float = 100.0
    margin: Margin = field(default_factory=Margin)

    def begin(self) -> _NlpDriver:
        """A driver that starts cold."""
        return _NlpDriver(self)


class _NlpDriver:
    def __init__(self, planner: NlpPlanner) -> None:
        self.planner = planner
        robot, N = planner.robot, planner.horizon
        n, m, slots = len(robot.states), len(robot.controls), planner.slots
        words = {s: ca.SX.sym(str(s)) for s in (*robot.states, *robot.controls)}
        step = ca.vertcat(
            *(
                sp.lambdify([*words], f, modules=[_CASADI, "math"])(*words.values())
                for f in robot.stepped(planner.dt)
            )
        )
        states, controls = (
            ca.vertcat(*(words[s] for s in of)) for of in (robot.states, robot.controls)
        )
        self.step = ca.Function("step", [states, controls], [step])
        Q, U, slack = ca.MX.sym("Q", n, N), ca.MX.sym("U", m, N), ca.MX.sym("S", N)
        q_0, goal, discs = ca.MX.sym("q0", n), ca.MX.sym("goal", 2), ca.MX.sym("d", 3 * slots, N)
        before = ca.horzcat(q_0, Q[:, :-1])
        cost, rows = planner.price * ca.sum1(slack), []
        for k in range(N):
            q, u = before[:, k], U[:, k]
            cost += planner.pull * ca.sumsqr(q[:2] - goal)
            for of, at in ((robot.states, q), (robot.controls, u)):
                for i, symbol in enumerate(of):
                    cost += robot.effort.get(str(symbol), 0.0) / 2 * at[i] ** 2
            for slot in range(slots):
                x, y, reach = (discs[3 * slot + i, k] for i in range(3))
                near = (reach**2 - (q[0] - x) ** 2 - (q[1] - y) ** 2) / (2 * reach)
                rows.append(near - slack[k])
        gaps = ca.vec(self.step.map(N)(before, U) - Q)
        self.solver = ca.nlpsol(
            "planner",
            "ipopt",
            {
                "x": ca.vertcat(ca.vec(Q), ca.vec(U), slack),
                "p": ca.vertcat(q_0, goal, ca.vec(discs)),
                "f": cost,
                "g": ca.vertcat(gaps, *rows),
            },
            OPTIONS,
        )
        low, high = robot.state_limits.T
        ends = np.tile(low, (N, 1)), np.tile(high, (N, 1))
        for end, free in zip(ends, (-np.inf, np.inf)):
            end[-1] = free
        u_low, u_high = (np.tile(side, (N, 1)) for side in robot.limits.T)
        upper = np.zeros((N, slots))
        upper[0] = np.inf
        self.bounds = {
            "lbx": np.r_[ends[0].ravel(), u_low.ravel(), np.zeros(N)],
            "ubx": np.r_[ends[1].ravel(), u_high.ravel(), np.full(N, np.inf)],
            "lbg": np.r_[np.zeros(n * N), np.full(N * slots, -np.inf)],
            "ubg": np.r_[np.zeros(n * N), upper.ravel()],
        }
        self.plans: dict[int, tuple[np.ndarray, np.ndarray]] = {}

    def plan(self, situations: Sequence[Situation]) -> list[Plan]:
        """One solve a situation, from the plan before, shifted."""
        return [self._plan(situation) for situation in situations]

    def _plan(self, situation: Situation) -> Plan:
        planner, N = self.planner, self.planner.horizon
        Q, U = self._guess(situation)
        n, m = Q.shape[1], U.shape[1]
        discs = self._discs(situation.world, situation)
        answer = self.solver(
            x0=np.r_[Q.ravel(), U.ravel(), np.zeros(N)],
            p=np.r_[situation.q, situation.world.goal, discs.ravel()],
            **self.bounds,
        )
        found = np.array(answer["x"]).ravel()
        good = self.solver.stats()["success"]
        if good:
            Q, U = found[: n * N].reshape(N, n), found[n * N : (n + m) * N].reshape(N, m)
        self.plans[situation.number] = Q, U
        pressed = float(np.abs(np.array(answer["lam_g"]).ravel()[n * N :]).max()) / planner.price
        return Plan(
            q=np.vstack([situation.q, Q]).T,
            u=U.T,
            residual=0.0 if good else np.inf,
            relative_multiplier=pressed,
        )

    def _guess(self, situation: Situation) -> tuple[np.ndarray, np.ndarray]:
        planner, N, q = self.planner, self.planner.horizon, situation.q
        if situation.number in self.plans:
            Q, U = (np.vstack([part[1:], part[-1:]]) for part in self.plans[situation.number])
            Q[-1] = np.array(self.step(Q[-2], U[-1])).ravel()
            return Q, U
        way = situation.world.goal - q[:2]
        speed = 0.8 * planner.robot.limits[0, 1]
        share = min(1.0, speed * N * planner.dt / np.linalg.norm(way))
        Q = np.tile(q, (N, 1))
        Q[:, :2] += np.outer(np.linspace(0, share, N + 1)[1:], way)
        U = np.zeros((N, len(planner.robot.controls)))
        U[:, 0] = share * np.linalg.norm(way) / (N * planner.dt)
        return Q, U

    def _discs(self, world: Scenario, situation: Situation) -> np.ndarray:
        planner, N = self.planner, self.planner.horizon
        time = situation.time + planner.dt * np.arange(N)
        room = planner.margin.at(N) + planner.robot.radius
        discs = np.tile(AWAY, (N, planner.slots))
        for slot, number in enumerate(world.sensed(situation.q[:2], situation.time)):
            disc = world.obstacles[number]
            reach = np.hypot(disc.radius + room, planner.margin.between)
            discs[:, 3 * slot : 3 * slot + 3] = np.column_stack([disc.centres(time), reach])
        return discs


_CASADI = {name: getattr(ca, name) for name in ("sin", "cos", "tan", "sqrt", "exp")}
