"""Listing of the shipped problems, from their docstrings and parameters."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rich.table import Table

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.report.tables import table, unit_list

Plant = Callable[..., OptimalControlProblem]

COMMON = {
    "dt": "Sampling interval.",
    "N": "Horizon: the number of stages.",
    "q_0": "Initial state; 'free' for an open component.",
    "q_d": "Terminal state; 'free' for an open component.",
}
"""Meaning of the parameters that every plant has."""


def plant_table(known: Iterable[Plant]) -> Table:
    """Return a table with one row per plant."""
    listed = table("plant", "states", "controls", "N", "dt", "description", dense=True)
    listed.columns[0].no_wrap = True
    for column, width in zip(listed.columns[1:5], (13, 12, 3, 7)):
        column.min_width = column.max_width = width  # the description has the rest of the line
    for plant in known:
        problem = plant()
        states, controls = (
            ", ".join(map(str, group)) for group in (problem.states, problem.controls)
        )
        row = (plant.__name__, states, controls, str(problem.horizon), problem.interval)
        listed.add_row(*row, _summary(plant))
    return listed


def plant_page(plant: Plant, defaults: Mapping[str, str]) -> list[Any]:
    """Return the description, parameters (with typed defaults) and use of a plant."""
    meanings = _documented(plant) | COMMON
    parameters = table("parameter", "default", "meaning")
    for parameter, default in defaults.items():
        parameters.add_row(parameter, default, meanings.get(parameter, ""))
    name, value = next(iter(defaults.items()))
    example = f"ann-dc solve {plant.__name__} --set {name}={value}"
    units = f"units: {unit_list(plant())}"
    return [_summary(plant), str(plant()), units, parameters, f"example: {example}"]


def plant_dict(plant: Plant, defaults: Mapping[str, str]) -> dict[str, Any]:
    """Return the problem and the parameters of a plant as data for JSON."""
    problem, meanings = plant(), _documented(plant) | COMMON
    return {
        "name": plant.__name__,
        "description": _summary(plant),
        "states": [*map(str, problem.states)],
        "controls": [*map(str, problem.controls)],
        "horizon": problem.horizon,
        "interval": problem.interval,
        "units": {**problem.units, "time": problem.time_unit},
        "parameters": {
            name: {"default": default, "meaning": meanings.get(name, "")}
            for name, default in defaults.items()
        },
    }


def _summary(plant: Plant) -> str:
    """Return the first sentence of a plant's docstring without verb and mark-up."""
    paragraph = " ".join((inspect.getdoc(plant) or "").split("\n\n")[0].split())
    plain = re.sub(r",? ?:math:`[^`]*`|``", "", paragraph)
    declared = re.sub(r"^Declare (the |an? )?", "", re.split(r"(?<=\.)\s", plain)[0])
    return declared[:1].upper() + declared[1:]


def _documented(plant: Plant) -> dict[str, str]:
    """Return the numpydoc section Parameters by parameter."""
    _, _, section = (inspect.getdoc(plant) or "").partition("Parameters\n----------\n")
    meanings: dict[str, str] = {}
    names: list[str] = []
    for line in section.split("\n\n")[0].splitlines():
        if not line.startswith(" "):
            names = [n.strip() for n in line.partition(" :")[0].split(",")]
            continue
        for name in names:
            text = f"{meanings.get(name, '')} {line.strip()}"
            meanings[name] = text.replace("``", "").strip()
    return meanings
