"""``ann-dc report``: what a study found, as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ann_dc.cli.arguments.output import QuietOption, timed
from ann_dc.cli.arguments.records import unfolded
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.report.json_file import make_room

NAME = "report.html"
"""File in the study's folder where --out gives no other."""


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
    """Write what a study found as one HTML page, to be read, searched and printed.

    The page needs no network and no other file: send it, keep it, open it from
    the disk. It tells what was asked, how the points ended and why, the yield
    against the spec with its interval, exponents, figures that one can hover
    over and zoom, the slowest and worst points with the command that repeats
    each, and all rows as a table that sorts by a click and filters by words
    and by numbers. A study that still runs gives the page of what it has.

    Examples:

      ann-dc report out/study
      ann-dc report out/study --out study.html

    Exit code: 0 written, 2 no study there, a package is missing, or unwritable
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
