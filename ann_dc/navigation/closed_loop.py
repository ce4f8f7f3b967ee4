"""Closed loop: robots drive through worlds and replan every control period.

The robot is integrated in finer steps than those of a plan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.navigation.planner import Plan, Planner, Situation
from ann_dc.navigation.safety_filter import SafetyFilter
from ann_dc.navigation.scenario import Scenario
from ann_dc.progress import Progress, silent
from ann_dc.validation import Count, checked

SHIELD = SafetyFilter()
"""Default safety filter of a closed-loop run."""
HELD = 2.0
"""Duration in seconds, at the end of a journey, over which progress to the goal is tested."""
SETTLED = 1e-3
"""Residual below which a plan counts as settled in the summary of a journey."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedLoopRun:
    """Closed-loop run of one robot through one world.

    Attributes
    ----------
    world : Scenario
        World of the run.
    dt : float
        Control period, in seconds.
    q : (n, K+1) array
        States at the control instants.
    u : (m, K) array
        Applied controls.
    clearance : (K,) array
        Least distance between the robot's rim and an obstacle in every period; negative after a
        collision.
    arrived : bool
        True if the robot reached the goal in time.
    shielded : (K,) booleans
        Periods in which the shield replaced the plan.
    residuals, spent, relative_multiplier : (K,) arrays
        Residual, network time in fastest time constants, and relative obstacle multiplier of every
        plan; see `Plan`.
    plans : tuple of (n, ...) arrays
        States of every plan.
    """

    world: Scenario
    dt: float
    q: np.ndarray
    u: np.ndarray
    clearance: np.ndarray
    arrived: bool
    shielded: np.ndarray
    residuals: np.ndarray
    spent: np.ndarray
    relative_multiplier: np.ndarray
    plans: tuple[np.ndarray, ...]

    @property
    def collided(self) -> bool:
        """True if the robot touched an obstacle."""
        return bool((self.clearance < 0.0).any())

    @property
    def held(self) -> bool:
        """True if the robot gave up while the shield prevented its progress.

        During the last seconds (`HELD`) the robot approached the goal by at most its diameter, and
        the shield replaced the plan in at least half of the periods.
        """
        late = max(round(HELD / self.dt), 1)
        far = np.linalg.norm(self.q[:2, -1 - late :].T - self.world.goal, axis=1)
        stuck = bool(far[0] - far[-1] <= 2 * self.world.robot.radius)
        return not self.arrived and stuck and bool(self.shielded[-late:].mean() >= 0.5)

    @property
    def length(self) -> float:
        """Length of the path."""
        return float(np.linalg.norm(np.diff(self.q[:2], axis=1), axis=0).sum())

    def __str__(self) -> str:
        periods, after = len(self.clearance), self.dt * len(self.clearance)
        gave_up = "not reached, stopped by the safety filter" if self.held else "goal not reached"
        end = "collided" if self.collided else "reached the goal" if self.arrived else gave_up
        rows = [
            f"{self.world.name}: {end} after {after:.1f} s, smallest clearance "
            f"{self.clearance.min():.3g}"
        ]
        rows.append(
            f"path length {self.length:.2f}, effort {self.effort:.2f}, {periods} control periods"
        )
        if self.shielded.any():
            rows.append(f"safety filter active {self.shielded.sum()} times")
        if self.spent.any():
            settled = (self.residuals < SETTLED).mean()
            rows.append(
                f"plans settled to {SETTLED:g}: {settled:.0%}; network time per period "
                f"(tau_min): median {np.median(self.spent):.0f}, longest {self.spent.max():.0f}"
            )
        return "\n".join(rows)

    @property
    def effort(self) -> float:
        """Control effort: sum of the squared controls times the period."""
        return float(self.dt * (self.u**2).sum())


@checked
def drive(
    worlds: Sequence[Scenario],
    planner: Planner,
    *,
    safety_filter: SafetyFilter | None = SHIELD,
    substeps: Count = 10,
    progress: Progress = silent,
) -> list[ClosedLoopRun]:
    """Drive robots through worlds simultaneously, as independent closed-loop runs.

    Parameters
    ----------
    worlds : sequence of Scenario
        Worlds with robots of one kind; the runs are in their order.
    planner : Planner
        Planner of all runs.
    safety_filter : SafetyFilter or None
        Safety filter; None disables the filter.
    substeps : int
        Integration steps of the plant per control period.
    progress : Progress
        Receives status messages, one line at a time.

    Examples
    --------
    >>> from ann_dc.navigation import design_planner, random_scenario
    >>> world = random_scenario(1)
    >>> (journey,) = drive([world], design_planner(world.robot, horizon=16))  # doctest: +SKIP
    """
    driver, dt = planner.begin(), planner.dt
    loops = [_Loop(world, number, dt, substeps) for number, world in enumerate(worlds)]
    while running := [loop for loop in loops if loop.runs]:
        progress(f"{running[0].time:.1f} s: {len(running)} of {len(loops)} still running")
        situations = [loop.situation() for loop in running]
        for loop, situation, plan in zip(running, situations, driver.plan(situations)):
            instead = None if safety_filter is None else safety_filter.instead(situation, plan, dt)
            loop.advance(plan, plan.u[:, 0] if instead is None else instead, instead is not None)
    return [loop.journey() for loop in loops]


class _Loop:
    """State of one journey, advanced period by period."""

    def __init__(self, world: Scenario, number: int, dt: float, substeps: int) -> None:
        self.world, self.number, self.dt, self.substeps = world, number, dt, substeps
        self.plant = world.robot.steps(dt / substeps)
        self.q, self.time, self.arrived = [world.start], 0.0, False
        self.periods: list[tuple[np.ndarray, float, bool, Plan]] = []

    @property
    def runs(self) -> bool:
        return not self.arrived and self.time < self.world.duration - self.dt / 2

    def situation(self) -> Situation:
        return Situation(self.world, self.number, self.q[-1], self.time)

    def advance(self, plan: Plan, u: np.ndarray, shielded: bool) -> None:
        """Apply the first control of a plan, or that of the shield, for one period."""
        robot = self.world.robot
        u = np.clip(u, *robot.limits.T)
        low, high = robot.state_limits.T
        way = [self.q[-1]]
        for _ in range(self.substeps):
            way.append(np.clip(self.plant.map(way[-1][:, None], u[:, None])[:, 0], low, high))
        times = self.time + self.dt / self.substeps * np.arange(1, self.substeps + 1)
        clear = self.world.clearance(np.array(way[1:])[:, :2], times)
        self.q.append(way[-1])
        self.time += self.dt
        self.periods.append((u, clear, shielded, plan))
        self.arrived = bool(np.linalg.norm(way[-1][:2] - self.world.goal) < self.world.arrived)

    def journey(self) -> ClosedLoopRun:
        u, clearance, shielded, plans = zip(*self.periods)
        return ClosedLoopRun(
            world=self.world,
            dt=self.dt,
            q=np.array(self.q).T,
            u=np.array(u).T,
            clearance=np.array(clearance),
            arrived=self.arrived,
            shielded=np.array(shielded),
            residuals=np.array([plan.residual for plan in plans]),
            spent=np.array([plan.spent for plan in plans]),
            relative_multiplier=np.array([plan.relative_multiplier for plan in plans]),
            plans=tuple(plan.q for plan in plans),
        )
