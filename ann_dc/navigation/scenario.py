"""Worlds: a robot, where it is and where it wants to be, what stands or moves in its way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.errors import WorldError
from ann_dc.navigation.obstacles import Obstacle, disc
from ann_dc.problem.robot import Robot, car_robot
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Index, Own, Positive, such_as


@such_as("ann_dc.navigation.random_world(0)")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class World:
    """What a robot is to find its way through.

    Attributes
    ----------
    robot : Robot
    start : (n,) array
        Its state at time zero.
    goal : (2,) array
        Where its place is to be.
    obstacles : tuple of Obstacle
    sensor : float
        How far it sees, from its centre to an obstacle's boundary.
    duration : float
        Seconds after which it gives up.
    arrived : float
        At the goal is what is nearer to it than this.
    name : str

    Raises
    ------
    WorldError
        If the start or the goal lies in an obstacle that is there from the beginning.
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
                raise WorldError(f"{field}: expected {size} finite numbers, got {value.tolist()}")
            object.__setattr__(self, field, value)
        for number, obstacle in enumerate(self.obstacles):
            for field, place, rests in (
                ("start", self.start[:2], True),
                ("goal", self.goal, not obstacle.moves),
            ):
                gap = obstacle.near(place[None], np.zeros(1)).distance[0] - self.robot.radius
                if rests and obstacle.appears <= 0.0 and gap < 0.0:
                    raise WorldError(
                        f"{field}: the robot (radius {self.robot.radius:g}) would stand {-gap:.3g} "
                        f"deep in obstacles[{number}]; move one of them"
                    )

    def sensed(self, place: np.ndarray, time: float) -> list[int]:
        """Numbers of the obstacles that are in sight from a place (2,) at a time."""
        return [
            number
            for number, obstacle in enumerate(self.obstacles)
            if obstacle.appears <= time
            and obstacle.near(place[None], np.array([time])).distance[0] <= self.sensor
        ]

    def clearance(self, places: np.ndarray, time: np.ndarray) -> float:
        """Least distance from the robot's rim at places (K, 2) and times (K,) to any obstacle."""
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
        raise WorldError(f"{field}: expected a list of numbers, got {given!r}") from None


@checked
def random_world(
    seed: Index, *, robot: Robot | None = None, counts: Sequence[int] = (3, 8)
) -> World:
    """Discs at random between (0, 0) and (5, 5), every second one moving.

    Parameters
    ----------
    seed : int
    robot : Robot, optional
        `car_robot` by default.
    counts : (int, int)
        Fewest and most discs.

    Examples
    --------
    >>> world = random_world(0)
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
    return World(robot=robot, start=state, goal=goal, obstacles=tuple(discs), name=f"random {seed}")
