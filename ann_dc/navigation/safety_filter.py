"""Safety filter: controls that replace unsafe or unconverged plans."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ann_dc.errors import such_as
from ann_dc.navigation.planner import Plan, Situation
from ann_dc.validation import Count, NotNegative, Positive, checked

STILL = 1e-6
"""Largest change of a state in one period for which a robot counts as stationary."""

GENTLE = 0.25
"""Fraction of a limit that is tried as an escape control in addition to the limit itself."""


@such_as("ann_dc.navigation.SafetyFilter()")
@checked
@dataclass(frozen=True, kw_only=True)
class SafetyFilter:
    """Safety filter that replaces a plan with too little clearance or convergence.

    Escape manoeuvres are constant controls, each at zero, at one of its limits or at a quarter of a
    limit. They are simulated for a few steps, and the manoeuvre with the most clearance is
    selected. A robot with two controls has 25 manoeuvres, which a digital circuit can simulate in
    each period. A plan with more clearance is never replaced.

    A stationary robot in a static world would never move again. If standing still is the best
    manoeuvre, the first control of the plan is still applied, provided that a manoeuvre with twice
    the clearance remains afterwards.

    Attributes
    ----------
    steps : int
        Number of nodes of the plan, and of each manoeuvre, that are checked.
    room : float
        Required clearance of a plan between the robot's rim and an obstacle, in the world's length
        unit.
    trusted : float
        Residual above which a plan counts as not converged.
    """

    steps: Count = 8
    room: NotNegative = 0.05
    trusted: Positive = 0.1

    def instead(self, situation: Situation, plan: Plan, dt: float) -> np.ndarray | None:
        """Return controls (m,) that replace those of a plan, or None; steps last dt seconds."""
        if not situation.world.sensed(situation.q[:2], situation.time):
            return None
        doubtful = plan.residual > self.trusted
        best = -np.inf if doubtful else self._room(situation, plan.q[:, 1 : self.steps + 1], dt)
        if best >= self.room:
            return None
        controls, ways, rooms = self._ways_out(situation, situation.q[:, None], dt)
        chosen = int(rooms.argmax())
        if not rooms[chosen] > best:
            return None
        stands = np.array_equal(ways[chosen, :2, -1], situation.q[:2])
        if stands and not doubtful and self._leaves_a_way_out(situation, plan, dt):
            return None
        return controls[:, chosen]

    def _leaves_a_way_out(self, situation: Situation, plan: Plan, dt: float) -> bool:
        """Return True if a manoeuvre with twice the clearance remains after a control."""
        first = np.clip(plan.u[:, :1].T, *situation.world.robot.limits.T).T
        before = _rolled(situation, situation.q[:, None], first, 1, dt)[0]
        moves = not np.allclose(before[:, 1], situation.q, rtol=0.0, atol=STILL)
        return moves and self._ways_out(situation, before, dt)[2].max() >= 2 * self.room

    def _ways_out(
        self, situation: Situation, before: np.ndarray, dt: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return controls (m, W), later states (W, n, K) and clearances (W,) of all manoeuvres."""
        ends = [
            dict.fromkeys((0.0, low, high, GENTLE * low, GENTLE * high))
            for low, high in situation.world.robot.limits
        ]
        controls = np.array(list(itertools.product(*ends))).T
        start = np.repeat(before[:, -1:], controls.shape[1], axis=1)
        steps = self.steps + 1 - before.shape[1]
        ways = _rolled(situation, start, controls, steps, dt)[..., 1:]
        rooms = [self._room(situation, np.hstack([before[:, 1:], way]), dt) for way in ways]
        return controls, ways, np.array(rooms)

    def _room(self, situation: Situation, q: np.ndarray, dt: float) -> float:
        """Return the least clearance along states (n, K) from visible obstacles."""
        world, time = situation.world, situation.time + dt * np.arange(1, q.shape[1] + 1)
        seen = world.sensed(situation.q[:2], situation.time)
        gaps = [world.obstacles[i].near(q[:2].T, time).distance.min() for i in seen]
        return min(gaps) - world.robot.radius


def _rolled(
    situation: Situation, q: np.ndarray, u: np.ndarray, steps: int, dt: float
) -> np.ndarray:
    """Simulate W manoeuvres (W, n, K+1) from states (n, W) with constant controls (m, W)."""
    step, limits = situation.world.robot.steps(dt), situation.world.robot.state_limits.T[..., None]
    way = [q]
    for _ in range(steps):
        way.append(np.clip(step.map(way[-1], u), *limits))
    return np.array(way).transpose(2, 1, 0)
