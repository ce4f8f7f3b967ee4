"""``ann-dc paper``: the paper's car, corrected; what its printed equations do; Figures 4 to 6."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.problem import arithmetic_of
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room, write_json
from ann_dc.whole_files.files import make_folder


def paper(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for results and figures.")] = (
        Path("out")
    ),
) -> None:
    """Solve the paper's car example, and show what its printed equations do.

    Six runs: the corrected network with wheel base D = 1 m and D = 0.5 m;
    (16) and (17) exactly as printed, where rho = 0, and once more with the
    gains of the corrected network; the corrected equations without dB/dq; and
    on the plain network (rho = 0, unit time constants), started 1 % off the
    optimum. Then the two-level iteration of Figure 6, with both theorems.
    Times as in 'ann-dc solve'. Writes result.json, the figures of the two
    corrected runs, and Figures 4 to 6, beside what the printed equations give.

    Example:

      ann-dc paper --out out

    Exit code: 0 if both corrected runs settle and are certified, 1 if not, 2 bad input.
    """
    result = out / "result.json"
    make_folder(out)
    make_room(result)
    with progress_line() as progress:
        from ann_dc import plotting
        from ann_dc.paper import example
        from ann_dc.plotting.paper.example import figure_4, figure_5
        from ann_dc.problem.plants import car
        from ann_dc.report.paper import LEGEND, paper_table

        with arithmetic_of(car()):
            corrected = [*example.corrected_runs(progress)]
            runs = [*corrected, *example.demonstrations(corrected[0].solution, progress)]
        written = []
        for run, folder in zip(corrected, ("car_D1", "car_D0.5")):
            progress(f"drawing {folder}")
            written += plotting.save_all(run.solution, make_folder(out / folder))
        by_label = {run.label: run.solution for run in runs}
        labels = ("corrected D=1", "without dB/dq", "printed D=1")
        optimum, straight, letter = (by_label[label] for label in labels)
        said, data, more, around = _two_levels(out, progress)
        for name, draw in {"figure_4": figure_4, "figure_5": figure_5}.items():
            figure = draw(optimum, straight, letter, around.get(name, ()))
            written.append(plotting.save(figure, out / f"{name}.png"))
        write_json(result, {name: found.as_dict() for name, found in by_label.items()} | data)
    console().print(paper_table(runs), LEGEND, said, sep="\n")
    list_files([*written, *more, result])
    raise typer.Exit(0 if all(run.solution.certified for run in corrected) else 1)


def _two_levels(
    out: Path, progress: Progress
) -> tuple[Any, dict[str, Any], list[Path], dict[str, list[Any]]]:
    """Return the table of Figure 6, its numbers and pictures, and panels for Figures 4 and 5."""
    from ann_dc import plotting
    from ann_dc.paper.replans import iterations
    from ann_dc.plotting.paper import controls_around, path_around, two_levels
    from ann_dc.report.coordination import iterations_dict, iterations_table

    found = iterations(progress=progress)
    figures = {
        "figure_6": two_levels.figure_6(found),
        "equation_21": two_levels.figure_of_definitions(found),
        "theorem_IV_1": two_levels.figure_of_following(found),
    }
    written = [plotting.save(figure, out / f"{name}.png") for name, figure in figures.items()]
    data = {"two levels": iterations_dict(found)}
    around = {
        "figure_4": [path_around(plans) for plans in found.cases],
        "figure_5": [controls_around(plans) for plans in found.cases],
    }
    return iterations_table(found), data, written, around
