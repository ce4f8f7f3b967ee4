"""``ann-dc design``: the gains of a problem's network, what was compared, and why it is slow."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ann_dc.cli.arguments.backends import StartOptions, start_of
from ann_dc.cli.arguments.kinds import KindsOption, kinds_of
from ann_dc.cli.arguments.output import QuietOption
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.records import unfolded
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.network.metrics.contract import ALL_KINDS
from ann_dc.whole_files import make_folder


@unfolded
def design(
    *,
    problem: ProblemOptions,
    start: StartOptions,
    kinds: KindsOption = None,
    refine: Annotated[
        bool, typer.Option("--refine", help="Search for faster gains: seconds more.")
    ] = False,
    why: Annotated[
        bool, typer.Option("--why", help="Why it is as slow as it is, and what would help.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Write design.json, network.npz and, with --why, why.png into this folder.",
        ),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Choose the gains of a problem's network, without running it to the end.

    The ratio of the fastest to the slowest rate at the settled point is what
    the design makes small: settling to 1e-6 takes 14 times as many fastest
    time constants. Its limit is 2. --why tells how far away that is: which
    modes are slow, which rows of the constraints are weakly reachable (how
    much more than its penalty a multiplier answers a push), and what would
    help. Numbers are in network units.

    Examples:

      ann-dc design car
      ann-dc design pendulum --why --out out/pendulum
      ann-dc design two_link_arm --kinds pyramid --refine --why

    Exit code: 0 the first run settled, so that the gains belong to the
    solution, 1 it did not, 2 bad input or unwritable output.
    """
    with progress_line(quiet) as progress:
        declared = problem.declared()
        if out is not None:
            make_folder(out)
        neurons, allowed = start_of(start), kinds_of(kinds, ALL_KINDS)

        from ann_dc import diagnosis, solver
        from ann_dc.analysis.objectives import SETTLING_TIME
        from ann_dc.report.design import candidate_table, write_design

        with arithmetic_of(declared):
            network = solver.synthesize(declared, start=neurons(declared))
            designed = solver.design(
                network,
                kinds=allowed,
                refine=SETTLING_TIME if refine else None,
                progress=progress,
            )
            progress("looking for the slowest modes")
            found = diagnosis.analyse(designed) if why and designed.settled else None
        written = [] if out is None else write_design(designed, found, out, progress)
    shown = console(quiet=quiet)
    shown.print(str(designed), soft_wrap=True)
    shown.print()
    shown.print(candidate_table(designed))
    if found is not None:
        shown.print(f"\n{found}", soft_wrap=True)
    elif why:
        shown.print("\nnothing to analyse: the first run did not settle, so no optimum is known")
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if designed.settled else 1)
