"""A journey of a planner whose answers are known."""

from dataclasses import dataclass

import numpy as np

from ann_dc.navigation.closed_loop import ClosedLoopRun, drive
from ann_dc.navigation.obstacles import disc, polygon
from ann_dc.navigation.planner import Plan
from ann_dc.navigation.scenario import Scenario
from ann_dc.problem.robot import unicycle_robot

ROBOT = unicycle_robot()


@dataclass(frozen=True)
class Ahead:
    """Half speed ahead, with residuals and multipliers made up."""

    dt: float = 0.1
    budget: float = 100.0

    def begin(self):
        """Itself."""
        return self

    def plan(self, situations):
        """The same for all."""
        u = np.tile([[1.0], [0.1]], 6)
        return [
            Plan(
                q=ROBOT.steps(0.1).rollout(s.q, u), u=u, residual=1e-3 / (1 + s.time),
                relative_multiplier=s.time / 2, spent=100.0,
            )
            for s in situations
        ]  # fmt: skip


def a_journey() -> ClosedLoopRun:
    """Eight periods beside a disc that moves and a wall."""
    obstacles = (
        disc((1.0, 1.2), 0.3, velocity=(0.1, -0.2)),
        polygon([(0.5, -1.5), (1.5, -1.5), (1.5, -1.0)]),
    )
    world = Scenario(
        robot=ROBOT, start=np.zeros(3), goal=np.array([3.0, 0.0]), obstacles=obstacles, duration=0.8
    )
    return drive([world], Ahead())[0]
