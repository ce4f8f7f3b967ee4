"""``ann-dc solve``: a problem in, a settled and certified network out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ann_dc.cli.arguments.backends import FormOption, backend_of, form_of, start_of
from ann_dc.cli.arguments.problem import (
    HorizonOption,
    ProblemArgument,
    SetOption,
    StartStateOption,
    TargetOption,
    arithmetic_of,
    problem_of,
)
from ann_dc.cli.terminal import console, list_files, notes, progress_line
from ann_dc.report.json_file import make_room, write_json
from ann_dc.report.solution import report_table
from ann_dc.whole_files import make_folder

if TYPE_CHECKING:
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.solution import Solution

ODE_PANEL = "With --backend ode"
RECURRENT_PANEL = "With --backend recurrent"


def solve(
    problem: ProblemArgument,
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
    backend: Annotated[
        str,
        typer.Option(
            metavar="BACKEND",
            help="How the network runs: ode (continuous time), recurrent (torch recurrent layers: "
            "discrete time).",
        ),
    ] = "ode",
    form: FormOption = "corrected",
    start: Annotated[
        str,
        typer.Option(
            metavar="START", help="Initial neurons: line (from q_0 to q_d), zero, random."
        ),
    ] = "line",
    seed: Annotated[int, typer.Option(min=0, help="Seed of --start random.")] = 0,
    refine: Annotated[
        bool, typer.Option("--refine", help="Search for faster gains: seconds more.")
    ] = False,
    limit: Annotated[
        float | None,
        typer.Option(
            help="Longest run: in fastest time constants of the network (ode), in steps "
            "(recurrent).",
            show_default="20000 or 50000",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the figures into this folder.")
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="Write the result as JSON.")
    ] = None,
    save: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the frozen network (.npz).")
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors.")] = False,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="METHOD",
            help="Integrator: RK23, RK45, DOP853, Radau, BDF, LSODA (SciPy).",
            show_default="RK45",
            rich_help_panel=ODE_PANEL,
        ),
    ] = None,
    verify: Annotated[
        bool | None,
        typer.Option(
            "--verify/--no-verify",
            help="Run twice, the second time at 100 times tighter tolerances.",
            show_default="verify",
            rich_help_panel=ODE_PANEL,
        ),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            metavar="ORDER",
            help="Which neurons move when: simultaneous, two-phase (duals after primals), "
            "stage-by-stage (one cell serves the stages in turn).",
            show_default="simultaneous",
            rich_help_panel=RECURRENT_PANEL,
        ),
    ] = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="H",
            help="Network time of a step: a number, or adaptive (as long as progress earns it).",
            show_default="adaptive",
            rich_help_panel=RECURRENT_PANEL,
        ),
    ] = None,
    accelerate: Annotated[
        bool,
        typer.Option(
            "--accelerate",
            help="Anderson acceleration: fewer steps, with a memory of the last 20.",
            rich_help_panel=RECURRENT_PANEL,
        ),
    ] = False,
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

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with notes(quiet), progress_line(quiet) as progress:
        declared = problem_of(problem, settings or (), horizon, q_0, q_d)
        for file in (json_file, save):
            make_room(file)
        if plot is not None:
            make_folder(plot)
        chosen = backend_of(
            backend,
            limit=limit,
            progress=progress,
            method=method,
            verify=verify,
            order=order,
            step=step,
            accelerate=accelerate or None,
        )
        solution = solved(
            declared,
            form=form_of(form),
            start=start_of(start, seed, declared),
            refine=refine,
            backend=chosen,
            progress=progress,
        )
        report = report_table(solution, chosen)
        written = _write(solution, plot, json_file, save, progress)
    console(quiet=quiet).print(report)
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if solution.certified else 1)


def solved(problem: OptimalControlProblem, **settings: Any) -> Solution:
    """`ann_dc.solve`, with numbers that overflow told as what they are: bad input."""
    from ann_dc.solver import solve as solve_problem

    with arithmetic_of(problem):
        return solve_problem(problem, **settings)


def _write(
    solution: Solution,
    plot: Path | None,
    json_file: Path | None,
    save: Path | None,
    progress: Callable[[str], None],
) -> list[Path]:
    written: list[Path] = []
    if plot is not None:
        from ann_dc import plotting

        progress("drawing")
        written += plotting.save_all(solution, plot)
    if json_file is not None:
        write_json(json_file, solution.as_dict())
        written.append(json_file)
    if save is not None:
        from ann_dc.export.weights.network_file import save as save_network

        save_network(solution.network, save)
        written.append(save)
    return written
