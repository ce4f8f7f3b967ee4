"""``ann-dc report``: result of a study as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ann_dc.cli.arguments.output import QuietOption, timed
from ann_dc.cli.arguments.records import unfolded
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.report.json_file import make_room

NAME = "report.html"
"""Default file name in the folder of the study, without --out."""


@unfolded
@timed
def report(
    *,
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a study: what ann-dc study --out made.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help=f"The page; {NAME} in DIR without it."),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Write the result of a study as one HTML page to read, search and print.

    The page is self-contained and needs no network connection. It shows the
    declaration of the study, outcomes with causes, the yield against the
    specification with its interval, and exponents. Interactive figures
    support hovering and zooming. The slowest and worst cases are listed with
    the command that repeats each. A table of all records can be sorted by a
    click and filtered by text and numbers. For a running study the page shows
    the records so far.

    Usage examples:

      ann-dc report out/study
      ann-dc report out/study --out study.html

    Exit code: 0 written, 2 study not found, a missing package, or unwritable
    output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        from ann_dc.report.study_page import write_study_page
        from ann_dc.study.store import Store

        file = out or folder / NAME
        with Store.open(folder) as store:
            make_room(file)
            write_study_page(store, file, progress=progress)
            count = len(store)
    console(quiet=quiet).print(f"{count:,} points")
    list_files([file], quiet=quiet)
