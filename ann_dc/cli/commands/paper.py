"""``ann-dc paper``: the paper's car, corrected; what its printed equations do; why gains matter."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ann_dc.cli.arguments.problem import arithmetic_of
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.report.json_file import make_room, write_json
from ann_dc.whole_files import make_folder


def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")] = (
        Path("out")
    ),
) -> None:
    """Solve the paper's car example, and show what its printed equations do.

    Four runs: the corrected network with wheel base D = 1 m and D = 0.5 m;
    the equations exactly as printed; and the corrected equations on the plain
    network (rho = 0, unit time constants), started 1 % off the optimum.
    Times as in 'ann-dc solve'. Writes result.json and the figures of the two
    corrected runs.

    Example:

      ann-dc paper --out out

    Exit code: 0 if both corrected runs settle and are certified, 1 if not, 2 bad input.
    """
    result = out / "result.json"
    make_folder(out)
    make_room(result)
    with progress_line() as progress:
        from ann_dc import plotting
        from ann_dc.problem.plants import car
        from ann_dc.report import paper as example

        with arithmetic_of(car()):
            corrected = [*example.corrected_runs(progress)]
            runs = [*corrected, *example.demonstrations(corrected[0].solution, progress)]
        written = []
        for run, folder in zip(corrected, ("car_D1", "car_D0.5")):
            progress(f"drawing {folder}")
            written += plotting.save_all(run.solution, make_folder(out / folder))
        write_json(result, {run.label: run.solution.as_dict() for run in runs})
    console().print(example.paper_table(runs), example.LEGEND, sep="\n")
    list_files([*written, result])
    raise typer.Exit(0 if all(run.solution.certified for run in corrected) else 1)
