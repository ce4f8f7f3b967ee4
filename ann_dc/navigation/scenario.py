"""Worlds: a robot, its start and goal, and static or moving obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.errors import ScenarioError, such_as
from ann_dc.navigation.obstacles import Obstacle, disc
from ann_dc.problem.robot import Robot, car_robot
from ann_dc.validation import Index, Own, Positive, checked


@such_as("ann_dc.navigation.random_scenario(0)")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Scenario:
    """Scenario of a navigation run.

    Raises `ScenarioError` if the start or goal is malformed. The same error is raised if the start
    is inside an obstacle that is present from the beginning, or the goal inside such a static
    obstacle.

    Attributes
    ----------
    start : (n,) array
        State of the robot at time zero.
    goal : (2,) array
        Target position.
    sensor : float
        Sensor range from the robot's centre to an obstacle's boundary.
    duration : float
        Time in seconds after which the robot gives up.
    arrived : float
        Distance from the goal below which the robot has arrived.
    """

    robot: Robot
    start: Annotated[np.ndarray, Own()]
    goal: Annotated[np.ndarray, Own()]
    obstacles: tuple[Obstacle, ...] = ()
    sensor: Positive = 3.0
    duration: Positive = 9.0
    arrived: Positive = 0.3
    name: str = "world"

    def __post_init__(self) -> None:
        for field, size in (("start", len(self.robot.states)), ("goal", 2)):
            value = _numbers(field, getattr(self, field))
            if value.shape != (size,) or not np.isfinite(value).all():
                raise ScenarioError(
                    f"{field}: expected {size} finite numbers, got {value.tolist()}"
                )
            object.__setattr__(self, field, value)
        for number, obstacle in enumerate(self.obstacles):
            for field, place, rests in (
                ("start", self.start[:2], True),
                ("goal", self.goal, not obstacle.moves),
            ):
                gap = obstacle.near(place[None], np.zeros(1)).distance[0] - self.robot.radius
                if rests and obstacle.appears <= 0.0 and gap < 0.0:
                    raise ScenarioError(
                        f"{field}: the robot (radius {self.robot.radius:g}) would stand {-gap:.3g} "
                        f"deep in obstacles[{number}]; move one of them"
                    )

    def sensed(self, place: np.ndarray, time: float) -> list[int]:
        """Return the indices of the obstacles visible from a place (2,) at a time."""
        return [
            number
            for number, obstacle in enumerate(self.obstacles)
            if obstacle.appears <= time
            and obstacle.near(place[None], np.array([time])).distance[0] <= self.sensor
        ]

    def clearance(self, places: np.ndarray, time: np.ndarray) -> float:
        """Return the least distance from the robot's rim at places (K, 2), times (K,)."""
        gaps = [
            obstacle.near(places, time).distance[time >= obstacle.appears]
            for obstacle in self.obstacles
        ]
        return float(min((gap.min(initial=np.inf) for gap in gaps), default=np.inf)) - (
            self.robot.radius
        )


def _numbers(field: str, given: object) -> np.ndarray:
    try:
        return np.array(given, float)
    except (TypeError, ValueError):
        raise ScenarioError(f"{field}: expected a list of numbers, got {given!r}") from None


@checked
def random_scenario(
    seed: Index, *, robot: Robot | None = None, counts: Sequence[int] = (3, 8)
) -> Scenario:
    """Create a world with random discs between (0, 0) and (5, 5), every second one moving.

    ``counts`` are the smallest and largest number of discs; the default robot is `car_robot`.

    Examples
    --------
    >>> world = random_scenario(0)
    >>> len(world.obstacles), sum(obstacle.moves for obstacle in world.obstacles)
    (8, 4)
    """
    draws = np.random.default_rng(seed)
    start, goal = np.zeros(2), np.array([5.0, 5.0])
    count = int(draws.integers(counts[0], counts[1] + 1))
    discs: list[Obstacle] = []
    while len(discs) < count:
        centre, radius = draws.uniform(0.8, 4.4, 2), draws.uniform(0.2, 0.45)
        if min(np.linalg.norm(centre - start), np.linalg.norm(centre - goal)) < radius + 0.8:
            continue
        if any(np.linalg.norm(centre - o.centre) < radius + o.radius + 0.35 for o in discs):
            continue
        velocity = np.zeros(2)
        if len(discs) % 2 == 1:
            angle = draws.uniform(0.0, 2 * np.pi)
            velocity = draws.uniform(0.2, 0.5) * np.array([np.cos(angle), np.sin(angle)])
        discs.append(disc(centre, radius, velocity=velocity))
    robot = robot or car_robot()
    state = np.zeros(len(robot.states))
    state[2:3] = np.pi / 4
    return Scenario(
        robot=robot, start=state, goal=goal, obstacles=tuple(discs), name=f"random {seed}"
    )
