"""``ann-dc show``: what is wired for a problem, before anything runs."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from ann_dc.cli.arguments.backends import FormOption, form_of
from ann_dc.cli.arguments.problem import ProblemOptions
from ann_dc.cli.arguments.records import unfolded
from ann_dc.cli.terminal import console, progress_line


@unfolded
def show(
    *,
    equations: Annotated[
        bool, typer.Option("--equations", help="The equations (11)-(15) of a stage.")
    ] = False,
    cell: Annotated[
        bool, typer.Option("--cell", help="The cell: neurons, blocks and connections.")
    ] = False,
    counts: Annotated[
        bool, typer.Option("--counts", help="How many parts the network has.")
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="The equations as LaTeX.")] = False,
    form: FormOption = "corrected",
    problem: ProblemOptions,
) -> None:
    """Show what is wired for a problem: equations, cell, counts.

    Without options: the equations as text, and the counts. Time constants
    tau and weights are in network units, before gains are designed.

    Examples:

      ann-dc show car
      ann-dc show car --cell
      ann-dc show demos/pendulum.toml --latex > equations.tex
    """
    with progress_line() as progress:
        from ann_dc.decomposition.equations import decompose
        from ann_dc.decomposition.latex import as_latex
        from ann_dc.report.cell import cell_listing
        from ann_dc.synthesis.synthesis import synthesize

        stage = decompose(problem.declared(), form_of(form))
        chosen = equations or cell or counts or latex
        parts: list[Any] = []
        if equations or latex or not chosen:
            progress("writing the equations")
            parts.append(as_latex(stage) if latex else str(stage))
        if cell or counts or not chosen:
            progress("wiring the network")
            network = synthesize(stage)
            parts += cell_listing(network) if cell else []
            parts += [str(network)] if counts or not chosen else []
    for number, part in enumerate(parts):
        if number:
            console().print()
        console().print(part, soft_wrap=isinstance(part, str))
