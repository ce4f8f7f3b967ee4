"""World files: conversion of TOML text to a `Scenario`.

The content of a file is never executed::

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
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ann_dc.errors import AnnDcError, ScenarioError
from ann_dc.files import read_table
from ann_dc.navigation.obstacles import Obstacle, disc, polygon
from ann_dc.navigation.scenario import Scenario
from ann_dc.problem.robot import Robot, car_robot, unicycle_robot
from ann_dc.validation import checked

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
