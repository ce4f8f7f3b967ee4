"""``ann-dc paper``: corrected car example, printed equations and Figures 4 to 6."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.options import JsonOption, option, unfolded
from ann_dc.cli.arguments.problem import arithmetic_of
from ann_dc.cli.terminal import finish, progress_line
from ann_dc.files import make_folder
from ann_dc.progress import Progress
from ann_dc.report.json_file import make_room, write_results


@unfolded
def paper(
    *,
    output: Path = option("Folder of results and figures.", default=Path("out"), metavar="DIR"),
    json_file: JsonOption = None,
) -> None:
    """Solve the paper's car example and show the effect of its printed equations.

    Six runs: the corrected network with wheel base D = 1 m and D = 0.5 m; (16)
    and (17) exactly as printed (rho = 0), and with the gains of the corrected
    network; the corrected equations without dB/dq, and on the plain network
    (rho = 0, unit time constants) from 1 % off the optimum. Then the two-level
    iteration of Figure 6, with both theorems. Times are as in 'ann-dc solve'.
    Files: result.json, the figures of the two corrected runs, and Figures 1 to
    6 with the printed equations for comparison.

    Usage examples:

      ann-dc paper --output out

    Exit code: 0 both corrected runs settle and are certified, 1 otherwise,
    2 bad input or unwritable output.
    """
    result = output / "result.json"
    make_folder(output)
    make_room(json_file, result)
    with progress_line() as progress:
        from ann_dc import plotting
        from ann_dc.paper import example
        from ann_dc.plotting.paper import free_controls, free_paths
        from ann_dc.problem.plants import car
        from ann_dc.report.paper import LEGEND, paper_table

        with arithmetic_of(car().name):
            corrected = [*example.corrected_runs(progress)]
            runs = [*corrected, *example.demonstrations(corrected[0].solution, progress)]
        written = []
        for run, folder in zip(corrected, ("car_D1", "car_D0.5")):
            progress(f"figures: {folder}")
            written += plotting.save_all(run.solution, make_folder(output / folder))
        by_label = {run.label: run.solution for run in runs}
        labels = ("corrected D=1", "without dB/dq", "printed D=1")
        shown = [by_label[label] for label in labels]
        for name, draw in {"paths": free_paths, "controls": free_controls}.items():
            written.append(plotting.save(draw(*shown), output / f"without_obstacles_{name}.png"))
        said, data, more = _two_levels(output, progress)
        content = {name: found.as_dict() for name, found in by_label.items()} | data
        written += [*more, *write_results(content, result, json_file)]
    good = all(run.solution.certified for run in corrected)
    finish([paper_table(runs), LEGEND, *said], written, code=0 if good else 1)


def _two_levels(
    out: Path, progress: Progress
) -> tuple[tuple[Any, ...], dict[str, Any], list[Path]]:
    """Return the report on Figures 1 to 6 and the theorems, its data and its files."""
    from ann_dc import plotting
    from ann_dc.paper import around, iterations
    from ann_dc.plotting.paper import (
        figure_1,
        figure_2,
        figure_3,
        figure_4,
        figure_5,
        iterations as two_levels,
    )
    from ann_dc.problem.plants import car
    from ann_dc.report import paper as report

    found = iterations(progress=progress)
    cases = [around(plans, car(), progress) for plans in found.cases]
    progress("figures 1 to 6")
    figures = {
        "figure_1": figure_1(),
        "figure_2": figure_2(car()),
        "figure_3": figure_3(car()),
        "figure_4": figure_4(cases),
        "figure_5": figure_5(cases),
        "figure_6": two_levels.figure_6(found),
        "equation_21": two_levels.figure_of_definitions(found),
        "theorem_IV_1": two_levels.figure_of_following(found),
    }
    written = [plotting.save(figure, out / f"{name}.png") for name, figure in figures.items()]
    said = report.around_table(cases), report.iterations_table(found)
    data = {"two levels": report.iterations_dict(found), "around": report.around_dict(cases)}
    return said, data, written
