"""The shield: what a robot does instead of a plan that would collide, or that is none."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ann_dc.hints.checked import checked
from ann_dc.hints.values import Count, NotNegative, Positive
from ann_dc.hints.words import such_as
from ann_dc.navigation.planner import Plan, Situation


@such_as("ann_dc.navigation.Shield()")
@checked
@dataclass(frozen=True, kw_only=True)
class Shield:
    """Stands still, or takes the way out with the most room, where a plan leaves too little.

    Ways out are constant controls, each at one of its limits or at zero, rolled out a few steps. A
    digital circuit looks at some ten of them each period; a better plan is never overruled.

    Attributes
    ----------
    steps : int
        Nodes of the plan, and of each way out, that it looks at.
    room : float
        What a plan has to leave between the robot's rim and an obstacle.
    trusted : float
        Residual of a plan above which it is none.
    """

    steps: Count = 8
    room: NotNegative = 0.05
    trusted: Positive = 0.1

    def instead(self, situation: Situation, plan: Plan, dt: float) -> np.ndarray | None:
        """Controls (m,) to apply instead of a plan's, or None.

        Parameters
        ----------
        situation : Situation
        plan : Plan
        dt : float
            Seconds a step.
        """
        if not situation.world.sensed(situation.q[:2], situation.time):
            return None
        doubtful = plan.residual > self.trusted
        best = -np.inf if doubtful else self._room(situation, plan.q[:, 1 : self.steps + 1], dt)
        if best >= self.room:
            return None
        instead = None
        robot = situation.world.robot
        step = robot.steps(dt)
        ends = [dict.fromkeys((0.0, low, high)) for low, high in robot.limits]
        for u in map(np.array, itertools.product(*ends)):
            way = [situation.q[:, None]]
            for _ in range(self.steps):
                way.append(step.map(way[-1], u[:, None]))
            room = self._room(situation, np.hstack(way[1:]), dt)
            if room > best:
                best, instead = room, u
        return instead

    def _room(self, situation: Situation, q: np.ndarray, dt: float) -> float:
        """Least room along states (n, K), as far as obstacles are in sight."""
        world, time = situation.world, situation.time + dt * np.arange(1, q.shape[1] + 1)
        seen = world.sensed(situation.q[:2], situation.time)
        gaps = [world.obstacles[i].near(q[:2].T, time).distance.min() for i in seen]
        return min(gaps) - world.robot.radius
