"""``ann-dc plants``: the problems that come with the package, read off their docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ann_dc.cli.arguments.numbers import as_typed
from ann_dc.cli.arguments.problem import defaults_of, plant_of
from ann_dc.cli.terminal import console, progress_line
from ann_dc.report.tables import table

if TYPE_CHECKING:
    from rich.table import Table

    from ann_dc.cli.arguments.problem import Plant

_COMMON = {
    "dt": "Sampling interval in seconds.",
    "N": "Horizon: the number of stages.",
    "q_0": "State at the start, one number a component.",
    "q_d": "State at the end; 'free' leaves a component open.",
}


def plants(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A plant, to see its parameters.")
    ] = None,
) -> None:
    """List the plants that come with the package, or the parameters of one.

    Every plant is a problem that 'ann-dc solve' takes by name, and --set
    changes its parameters. dt is in seconds; other units stand with them.

    Examples:

      ann-dc plants
      ann-dc plants car
    """
    with progress_line():
        from ann_dc.problem import plants as known

        if name is None:
            shown: list[Any] = [_plant_table([known.get(plant) for plant in known.names()])]
        else:
            shown = _plant_page(plant_of(name))
    for part in shown:
        console().print(part)


def _plant_table(known: Iterable[Plant]) -> Table:
    listed = table("plant", "states", "controls", "N", "dt", "what it is", dense=True)
    listed.columns[0].no_wrap = True
    listed.columns[1].min_width = listed.columns[2].min_width = 13
    for plant in known:
        problem = plant()
        states, controls = (
            ", ".join(map(str, group)) for group in (problem.states, problem.controls)
        )
        row = (plant.__name__, states, controls, str(problem.horizon), f"{problem.dt:g}")
        listed.add_row(*row, _summary(plant))
    return listed


def _plant_page(plant: Plant) -> list[Any]:
    meanings = _documented(plant) | _COMMON
    parameters = table("parameter", "default", "meaning")
    for parameter, default in defaults_of(plant).items():
        parameters.add_row(parameter, as_typed(default), meanings.get(parameter, ""))
    name, value = next(iter(defaults_of(plant).items()))
    example = f"ann-dc solve {plant.__name__} --set {name}={as_typed(value)}"
    return [_summary(plant), str(plant()), parameters, f"change one with --set: {example}"]


def _summary(plant: Plant) -> str:
    """The first sentence of a plant's docstring, without its mark-up."""
    paragraph = " ".join((inspect.getdoc(plant) or "").split("\n\n")[0].split())
    plain = re.sub(r",? ?:math:`[^`]*`|``", "", paragraph)
    return re.split(r"(?<=\.)\s", plain)[0]


def _documented(plant: Plant) -> dict[str, str]:
    """The numpydoc section Parameters as a table."""
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
