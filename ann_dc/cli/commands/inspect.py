"""``ann-dc inspect``: content and verification of a network file or an export."""

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
    """Show the content of a file or export, and verify hashes and behaviour.

    Names and hashes of all files of an export are checked. Files that can be
    run are compared with their test vector, in their runtime if that is
    installed. The network of a weight file is run until it settles. Code in a
    file is never executed: torch programs and netlists are not run. Several
    exports have one line each; inspect a single export for all details.

    Usage examples:

      ann-dc inspect network.npz
      ann-dc inspect out/export/onnx
      ann-dc inspect out/export

    Exit code: 0 verified, 1 verification failed, 2 no network file or
    export found.
    """
    with progress_line(quiet) as progress:
        from ann_dc.cli.commands.export_tables import inspection_table, inspections_table
        from ann_dc.export.catalogue import inspect_export

        found = inspect_export(place, progress=progress)
    shown = inspection_table(found[0]) if len(found) == 1 else inspections_table(found)
    console(quiet=quiet).print(shown)
    raise typer.Exit(0 if all(each.good for each in found) else 1)
