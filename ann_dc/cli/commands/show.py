"""``ann-dc show``: network of a problem before any run.

``ann-dc plants``: shipped problems and their parameters.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ann_dc.cli.arguments.backends import FormOption, form_of
from ann_dc.cli.arguments.options import JsonOption, argument, completing, option, unfolded
from ann_dc.cli.arguments.problem import (
    ProblemOptions,
    as_typed,
    defaults_of,
    plant_of,
    plants_known,
)
from ann_dc.cli.arguments.words import TableOption, stages_of
from ann_dc.cli.terminal import finish, progress_line
from ann_dc.errors import ProblemError
from ann_dc.report.json_file import make_room, write_results


@unfolded
def show(
    *,
    equations: bool = option(
        "Show the equations (11)-(15) of a stage.", "--equations", default=False
    ),
    cell: bool = option("Show the cell: neurons, blocks and connections.", "--cell", default=False),
    counts: bool = option("Show the number of parts of the network.", "--counts", default=False),
    scales: bool = option(
        "Show the scale and offset of every network value.", "--scales", default=False
    ),
    latex: bool = option("Show the equations as LaTeX.", "--latex", default=False),
    form: FormOption = "corrected",
    table: TableOption = "short",
    problem: ProblemOptions,
    json_file: JsonOption = None,
) -> None:
    """Show the network of a problem: equations, cell, counts, scales.

    PROBLEM may also be a folder written by ann-dc solve --save. Then the
    stored solution, or the network of its problem, is shown.

    Without options: the equations as text, the counts and the scales. Time
    constants tau and weights are in network units, before gains are designed.
    Scales follow from the problem, so the network is the same in any units.
    --set scale.x=1000 sets a scale manually. --json writes equations, cell and
    scales, or the stored solution.

    Usage examples:

      ann-dc show car
      ann-dc show car --cell
      ann-dc show car --json -
      ann-dc show demos/pendulum.toml --latex > equations.tex
      ann-dc show out/car

    Exit code: 0 shown, 2 bad input or unwritable output.
    """
    make_room(json_file)
    with progress_line() as progress:
        from ann_dc.decomposition.equations import decompose
        from ann_dc.decomposition.latex import as_latex
        from ann_dc.report.cell import cell_listing, network_dict, remarks, scale_table
        from ann_dc.synthesis.synthesis import synthesize

        rows = stages_of(table)
        chosen = equations or cell or counts or latex or scales
        saved = _saved(problem)
        if saved is not None and not chosen:
            from ann_dc.report.solution import Stages, solution_report

            written = write_results(saved.as_dict(), json_file)
            finish([solution_report(saved, stages=Stages(rows))], written)
        declared = problem.declared() if saved is None else saved.problem
        stage = decompose(declared, form_of(form))
        parts: list[Any] = []
        if equations or latex or not chosen:
            progress("equations")
            parts.append(as_latex(stage) if latex else str(stage))
        written: list[Path] = []
        if cell or counts or json_file or not chosen:
            progress("network")
            network = synthesize(stage)
            parts += cell_listing(network) if cell else []
            parts += [str(network)] if counts or not chosen else []
            written = write_results(network_dict(stage, network), json_file)
        parts += [] if latex else remarks(stage.problem)
        if scales or not chosen:
            parts.append(scale_table(stage.problem))
    finish([line for part in parts for line in ("", part)][1:], written)


def _saved(problem: ProblemOptions):
    """Return the solution stored in the folder PROBLEM; None if it is not a folder."""
    from ann_dc.problem import plants
    from ann_dc.solution.loading import load_solution

    if problem.problem in plants.names() or not Path(problem.problem).is_dir():
        return None
    if any((problem.settings, problem.horizon, problem.q_0, problem.q_d)):
        raise ProblemError(
            f"{problem.problem}: a saved solution cannot be changed; omit --set, --horizon, "
            "--q-0 and --q-d"
        )
    return load_solution(problem.problem)


@unfolded
def plants(
    *,
    name: str | None = argument(
        "Plant whose parameters are listed.",
        default=None,
        metavar="[NAME]",
        autocompletion=completing(plants_known),
    ),
    json_file: JsonOption = None,
) -> None:
    """List the plants of the package, or the parameters of one.

    Every plant is a problem that 'ann-dc solve' accepts by name, and --set
    changes its parameters. The page of a plant lists its units.

    Usage examples:

      ann-dc plants
      ann-dc plants car
      ann-dc plants --json -

    Exit code: 0 listed, 2 bad input or unwritable output.
    """
    make_room(json_file)
    with progress_line():
        from ann_dc.problem import plants as known
        from ann_dc.report.plants import plant_dict, plant_page, plant_table

        if name is None:
            each = [known.get(word) for word in known.names()]
            parts: list[Any] = [plant_table(each)]
            content: Any = [plant_dict(plant, _typed(plant)) for plant in each] if json_file else []
        else:
            plant = plant_of(name)
            parts = plant_page(plant, _typed(plant))
            content = plant_dict(plant, _typed(plant))
        written = write_results(content, json_file)
    finish(parts, written)


def _typed(plant: Any) -> dict[str, str]:
    """Return the defaults of the parameters of a plant, as --set takes them."""
    return {name: as_typed(default) for name, default in defaults_of(plant).items()}
