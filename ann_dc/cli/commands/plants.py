"""``ann-dc plants``: shipped problems and their parameters."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.numbers import as_typed
from ann_dc.cli.arguments.problem import defaults_of, plant_of
from ann_dc.cli.terminal import console, progress_line


def plants(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A plant, to see its parameters.")
    ] = None,
) -> None:
    """List the plants of the package, or the parameters of one.

    Every plant is a problem that 'ann-dc solve' accepts by name, and --set
    changes its parameters. The page of a plant lists its units.

    Usage examples:

      ann-dc plants
      ann-dc plants car
    """
    with progress_line():
        from ann_dc.problem import plants as known
        from ann_dc.report.plants import plant_page, plant_table

        if name is None:
            parts: list[Any] = [plant_table(known.get(plant) for plant in known.names())]
        else:
            plant = plant_of(name)
            typed = {n: as_typed(default) for n, default in defaults_of(plant).items()}
            parts = plant_page(plant, typed)
    for part in parts:
        console().print(part)
