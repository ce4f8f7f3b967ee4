"""``ann-dc inspect``: what is inside a file or an export, and whether it still does what it did."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ann_dc.cli.arguments.output import QuietOption, timed
from ann_dc.cli.arguments.records import unfolded
from ann_dc.cli.terminal import console, progress_line


@unfolded
@timed
def inspect(
    *,
    place: Annotated[
        Path,
        typer.Argument(
            metavar="PATH", help="A weight file, the folder of an export, or one with several."
        ),
    ],
    quiet: QuietOption = False,
) -> None:
    """Tell what is inside, compare the hashes, and see whether it still does what it did.

    An export is compared with its reference vector, in the runtime that it is
    for where that is installed; the network of a weight file is let settle.
    Nothing from a file is executed but by the runtime whose format it is. Of
    several exports there is a line each; look into one for all that it says.

    Examples:

      ann-dc inspect network.npz
      ann-dc inspect out/export/onnx
      ann-dc inspect out/export

    Exit code: 0 all is well, 1 something is wrong, 2 nothing of the kind there.
    """
    with progress_line(quiet) as progress:
        from ann_dc.cli.commands.export_tables import inspection_table, inspections_table
        from ann_dc.export.inspecting import inspect_export

        found = inspect_export(place, progress=progress)
    shown = inspection_table(found[0]) if len(found) == 1 else inspections_table(found)
    console(quiet=quiet).print(shown)
    raise typer.Exit(0 if all(each.good for each in found) else 1)
