"""The closed loop: robots drive through worlds, and plan again every control period.

The robot is integrated in finer steps than a plan has; a shield steps in where a plan
would collide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.navigation.planner import Plan, Planner, Situation
from ann_dc.navigation.safety_filter import Shield
from ann_dc.navigation.scenario import World
from ann_dc.progress import Progress, silent
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Count

SHIELD = Shield()
"""That of every journey which is not told otherwise."""
HELD = 2.0
"""Seconds at the end of a journey in which a robot that is held comes no nearer to the goal."""
SETTLED = 1e-3
"""Residual of a plan that counts as settled in what is said of a journey."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Journey:
    """One robot's way through one world.

    Attributes
    ----------
    world : World
    dt : float
        Control period, in seconds.
    q : (n, K+1) array
        States at the control instants.
    u : (m, K) array
        Controls applied.
    clearance : (K,) array
        Least distance between the robot's rim and an obstacle, of every period; negative where
        they collided.
    arrived : bool
        At the goal in time.
    shielded : (K,) booleans
        Where the shield stepped in.
    residuals, spent, pressed : (K,) arrays
        Of the plans.
    plans : tuple of (n, ...) arrays
        States of every plan.
    """

    world: World
    dt: float
    q: np.ndarray
    u: np.ndarray
    clearance: np.ndarray
    arrived: bool
    shielded: np.ndarray
    residuals: np.ndarray
    spent: np.ndarray
    pressed: np.ndarray
    plans: tuple[np.ndarray, ...]

    @property
    def collided(self) -> bool:
        """Whether it touched an obstacle."""
        return bool((self.clearance < 0.0).any())

    @property
    def held(self) -> bool:
        """True if it gave up while the shield kept it from moving on.

        In its last seconds (`HELD`) it came nearer to the goal by its own diameter at most, and the
        shield stepped in at half of the periods or more.
        """
        late = max(round(HELD / self.dt), 1)
        far = np.linalg.norm(self.q[:2, -1 - late :].T - self.world.goal, axis=1)
        stuck = bool(far[0] - far[-1] <= 2 * self.world.robot.radius)
        return not self.arrived and stuck and bool(self.shielded[-late:].mean() >= 0.5)

    @property
    def length(self) -> float:
        """Of its way."""
        return float(np.linalg.norm(np.diff(self.q[:2], axis=1), axis=0).sum())

    def __str__(self) -> str:
        periods, after = len(self.clearance), self.dt * len(self.clearance)
        gave_up = "gave up, held by the safety filter" if self.held else "gave up"
        end = "collided" if self.collided else "reached the goal" if self.arrived else gave_up
        rows = [
            f"{self.world.name}: {end} after {after:.1f} s, least room {self.clearance.min():.3g}"
        ]
        rows.append(f"way {self.length:.2f}, effort {self.effort:.2f}, {periods} control periods")
        if self.shielded.any():
            rows.append(f"the shield stepped in {self.shielded.sum()} times")
        if self.spent.any():
            settled = (self.residuals < SETTLED).mean()
            rows.append(
                f"plans settled to {SETTLED:g}: {settled:.0%}; fastest time constants a period: "
                f"median {np.median(self.spent):.0f}, longest {self.spent.max():.0f}"
            )
        return "\n".join(rows)

    @property
    def effort(self) -> float:
        """Sum of the squared controls times the period."""
        return float(self.dt * (self.u**2).sum())


@checked
def drive(
    worlds: Sequence[World],
    planner: Planner,
    *,
    shield: Shield | None = SHIELD,
    substeps: Count = 10,
    progress: Progress = silent,
) -> list[Journey]:
    """Let robots drive through worlds, all at once; no journey depends on another.

    Parameters
    ----------
    worlds : sequence of World
        With robots of one kind.
    planner : Planner
    shield : Shield or None
    substeps : int
        Steps of the plant in a control period.
    progress : Progress

    Returns
    -------
    list of Journey

    Examples
    --------
    >>> from ann_dc.navigation import design_planner, random_world
    >>> world = random_world(1)
    >>> (journey,) = drive([world], design_planner(world.robot, horizon=16))  # doctest: +SKIP
    """
    driver, dt = planner.begin(), planner.dt
    loops = [_Loop(world, number, dt, substeps) for number, world in enumerate(worlds)]
    while running := [loop for loop in loops if loop.runs]:
        progress(f"{running[0].time:.1f} s: {len(running)} of {len(loops)} on their way")
        situations = [loop.situation() for loop in running]
        for loop, situation, plan in zip(running, situations, driver.plan(situations)):
            instead = None if shield is None else shield.instead(situation, plan, dt)
            loop.advance(plan, plan.u[:, 0] if instead is None else instead, instead is not None)
    return [loop.journey() for loop in loops]


class _Loop:
    """One journey, period by period."""

    def __init__(self, world: World, number: int, dt: float, substeps: int) -> None:
        self.world, self.number, self.dt, self.substeps = world, number, dt, substeps
        self.plant = world.robot.steps(dt / substeps)
        self.q, self.time, self.arrived = [world.start], 0.0, False
        self.periods: list[tuple[np.ndarray, float, bool, Plan]] = []

    @property
    def runs(self) -> bool:
        """Whether it is still on its way."""
        return not self.arrived and self.time < self.world.duration - self.dt / 2

    def situation(self) -> Situation:
        """What the robot knows now."""
        return Situation(self.world, self.number, self.q[-1], self.time)

    def advance(self, plan: Plan, u: np.ndarray, shielded: bool) -> None:
        """Apply a plan's first control, or the shield's, for a period."""
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

    def journey(self) -> Journey:
        """What it came to."""
        u, clearance, shielded, plans = zip(*self.periods)
        return Journey(
            world=self.world,
            dt=self.dt,
            q=np.array(self.q).T,
            u=np.array(u).T,
            clearance=np.array(clearance),
            arrived=self.arrived,
            shielded=np.array(shielded),
            residuals=np.array([plan.residual for plan in plans]),
            spent=np.array([plan.spent for plan in plans]),
            pressed=np.array([plan.pressed for plan in plans]),
            plans=tuple(plan.q for plan in plans),
        )
