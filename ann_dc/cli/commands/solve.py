"""``ann-dc solve``: a problem in, a settled and certified network out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from ann_dc.cli.arguments.backends import (
    BackendOption,
    FormOption,
    LimitOption,
    RunOptions,
    StartOptions,
    backend_of,
    form_of,
    objective_of,
    start_of,
)
from ann_dc.cli.arguments.kinds import KindsOption, kinds_of
from ann_dc.cli.arguments.output import JsonOption, QuietOption
from ann_dc.cli.arguments.problem import ProblemOptions, arithmetic_of
from ann_dc.cli.arguments.records import unfolded
from ann_dc.cli.terminal import console, list_files, notes, progress_line
from ann_dc.report.json_file import make_room
from ann_dc.whole_files import make_folder


@dataclass(frozen=True, kw_only=True)
class SolutionFiles:
    """What is written, and where."""

    plot: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the figures into this folder.")
    ] = None
    json_file: JsonOption = None
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the frozen network (.npz).")
    ] = None

    def make_room(self) -> None:
        """Before a long run: all of them can be written."""
        for file in (self.json_file, self.save):
            make_room(file)
        if self.plot is not None:
            make_folder(self.plot)


@unfolded
def solve(
    *,
    problem: ProblemOptions,
    backend: BackendOption = "ode",
    form: FormOption = "corrected",
    start: StartOptions,
    kinds: KindsOption = None,
    refine: Annotated[
        bool,
        typer.Option("--refine", help="Search for faster gains, or for fewer steps: 20 s more."),
    ] = False,
    limit: LimitOption = None,
    files: SolutionFiles,
    quiet: QuietOption = False,
    run: RunOptions,
) -> None:
    """Let the network solve a problem, and check that its answer is an optimum.

    Settling is told in units of network time and in fastest time constants
    of the network: multiply the latter by the time constant of your hardware.
    dt is in seconds; states and controls are in the problem's own units.
    With --backend recurrent, settling is told in steps too.

    Examples:

      ann-dc solve car --set D=0.5 --json out/car.json
      ann-dc solve unicycle -N 30 --q-d 2,1,free --plot out
      ann-dc solve demos/pendulum.toml --method LSODA
      ann-dc solve car --backend recurrent --accelerate
      ann-dc solve pendulum --kinds pyramid,time-constants

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with notes(quiet), progress_line(quiet) as progress:
        declared = problem.declared()
        files.make_room()
        chosen = backend_of(backend, run, limit=limit, progress=progress)
        equations, neurons = form_of(form), start_of(start)
        allowed = kinds_of(kinds, chosen.kinds)

        from ann_dc import solver
        from ann_dc.report.solution import report_table, write_solution

        with arithmetic_of(declared):
            solution = solver.solve(
                declared,
                form=equations,
                start=neurons(declared),
                kinds=allowed,
                refine=objective_of(backend, run) if refine else None,
                backend=chosen,
                progress=progress,
            )
        table = report_table(solution, chosen)
        written = write_solution(
            solution, plot=files.plot, json_file=files.json_file, save=files.save, progress=progress
        )
    console(quiet=quiet).print(table)
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if solution.certified else 1)
