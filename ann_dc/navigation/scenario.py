"""Worlds: a robot, its start and goal, and static or moving obstacles.

The TOML text of a world file is never executed::

    start = [0, 0, 0.785, 0]     # the robot's state
    goal = [5, 5]
    sensor = 3.0                 # optional, as are duration, arrived and name

    [robot]
    kind = "car"                 # or "unicycle"; the rest are arguments of car_robot
    reverse = 0.8

    [[discs]]
    centre = [2.0, 1.5]
    radius = 0.4
    velocity = [0.0, 0.3]        # optional, as is appears = 2.0

    [[polygons]]
    corners = [[3, 3], [4, 3], [4, 3.5]]
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from ann_dc.errors import AnnDcError, ScenarioError, such_as
from ann_dc.files import read_table
from ann_dc.navigation.obstacles import Obstacle, disc, polygon
from ann_dc.problem.robot import Robot, car_robot, unicycle_robot
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
            for field, place, is_checked in (
                ("start", self.start[:2], True),
                ("goal", self.goal, not obstacle.moves),
            ):
                gap = obstacle.near(place[None], np.zeros(1)).distance[0] - self.robot.radius
                if is_checked and obstacle.appears <= 0.0 and gap < 0.0:
                    raise ScenarioError(
                        f"{field}: the robot (radius {self.robot.radius:g}) overlaps by "
                        f"{-gap:.3g} with obstacles[{number}]; move one of them"
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


ROBOTS: Mapping[str, Callable[..., Robot]] = {"car": car_robot, "unicycle": unicycle_robot}
OBSTACLES: Mapping[str, Callable[..., Obstacle]] = {"discs": disc, "polygons": polygon}
REQUIRED = ("start", "goal", "robot")
OPTIONAL = ("name", "sensor", "duration", "arrived", *OBSTACLES)


@checked
def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Read a world from a TOML file.

    The stem of the path is the name of the world unless the file contains ``name``. Raises
    `FileFormatError` if the file does not exist or is not TOML. Raises `ScenarioError` if the
    content does not describe a world; the message begins with the path and the field.
    """
    file = Path(path)
    table = read_table(file, "world", "demos/crossing.toml")
    try:
        return _world(table, file.stem)
    except AnnDcError as error:
        raise ScenarioError(f"{file}: {error}") from error


def _world(table: Mapping[str, Any], name: str) -> Scenario:
    _check_keys("", table, REQUIRED + OPTIONAL, REQUIRED)
    given = _table("robot", table["robot"])
    kind = str(given.get("kind"))
    if kind not in ROBOTS:
        raise ScenarioError(f"robot.kind: expected one of {', '.join(ROBOTS)}, got {kind!r}")
    robot = _made("robot", ROBOTS[kind], {k: v for k, v in given.items() if k != "kind"})
    obstacles = []
    for field, make in OBSTACLES.items():
        rows = table.get(field, [])
        if not isinstance(rows, list):
            raise ScenarioError(f"{field}: expected tables, each written [[{field}]], got {rows!r}")
        for number, row in enumerate(rows):
            obstacles.append(_made(f"{field}[{number}]", make, _table(field, row)))
    plain = {key: table[key] for key in ("sensor", "duration", "arrived") if key in table}
    return Scenario(
        robot=robot,
        start=table["start"],
        goal=table["goal"],
        obstacles=tuple(obstacles),
        name=str(table.get("name", name)),
        **plain,
    )


def _made(field: str, make: Callable[..., Any], given: Mapping[str, Any]) -> Any:
    parameters = inspect.signature(make).parameters
    needed = [n for n, parameter in parameters.items() if parameter.default is parameter.empty]
    _check_keys(f"{field}.", given, tuple(parameters), tuple(needed))
    try:
        return make(**given)
    except AnnDcError as error:
        raise ScenarioError(f"{field}.{error}") from error


def _check_keys(field: str, table: Mapping, known: tuple[str, ...], needed: tuple) -> None:
    for key in table:
        if key not in known:
            raise ScenarioError(f"{field}{key}: unknown key; known are {', '.join(known)}")
    for key in needed:
        if key not in table:
            raise ScenarioError(f"{field}{key}: missing; the keys are {', '.join(known)}")


def _table(field: str, given: Any) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise ScenarioError(f"{field}: expected a table, got {given!r}")
    return given
