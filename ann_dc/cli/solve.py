"""``ann-dc solve``: a problem in, a settled and certified network out."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ann_dc.cli.files import make_room, write_json
from ann_dc.cli.problem import (
    HorizonOption,
    ProblemArgument,
    SetOption,
    StartStateOption,
    TargetOption,
    problem_of,
)
from ann_dc.cli.report import report_table
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.cli.words import FormOption, backend_of, form_of, start_of
from ann_dc.errors import AnnDcError, ProblemError
from ann_dc.whole_files import make_folder

if TYPE_CHECKING:
    from ann_dc.problem.declaration import OptimalControlProblem
    from ann_dc.solution import Solution


def solve(
    problem: ProblemArgument,
    settings: SetOption = None,
    horizon: HorizonOption = None,
    q_0: StartStateOption = None,
    q_d: TargetOption = None,
    backend: Annotated[
        str, typer.Option(metavar="BACKEND", help="How the network runs: ode (continuous time).")
    ] = "ode",
    method: Annotated[
        str,
        typer.Option(
            metavar="METHOD", help="Integrator: RK23, RK45, DOP853, Radau, BDF, LSODA (SciPy)."
        ),
    ] = "RK45",
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
    verify: Annotated[
        bool, typer.Option(help="Run twice, the second time at 100 times tighter tolerances.")
    ] = True,
    limit: Annotated[
        float, typer.Option(help="Longest run, in fastest time constants of the network.")
    ] = 20_000.0,
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
) -> None:
    """Let the network solve a problem, and check that its answer is an optimum.

    Settling is told in units of network time and in fastest time constants
    of the network: multiply the latter by the time constant of your hardware.
    dt is in seconds; states and controls are in the problem's own units.

    Examples:

      ann-dc solve car --set D=0.5 --json out/car.json
      ann-dc solve unicycle -N 30 --q-d 2,1,free --plot out
      ann-dc solve demos/pendulum.toml --method LSODA

    Exit code: 0 settled and certified, 1 not settled or not certified,
    2 bad input or unwritable output, 130 interrupted.
    """
    with progress_line(quiet) as progress:
        declared = problem_of(problem, settings or (), horizon, q_0, q_d)
        for file in (json_file, save):
            make_room(file)
        if plot is not None:
            make_folder(plot)
        solution = solved(
            declared,
            form=form_of(form),
            start=start_of(start, seed, declared),
            refine=refine,
            backend=backend_of(
                backend, method=method, limit=limit, verify=verify, progress=progress
            ),
            progress=progress,
        )
        report = report_table(solution)
        written = _write(solution, plot, json_file, save, progress)
    console(quiet=quiet).print(report)
    list_files(written, quiet=quiet)
    raise typer.Exit(0 if solution.certified else 1)


def solved(problem: OptimalControlProblem, **settings: Any) -> Solution:
    """`ann_dc.solve`, with numbers that overflow told as what they are: bad input."""
    import numpy as np

    from ann_dc.solver import solve as solve_problem

    try:
        with np.errstate(all="ignore"):  # the outcome tells, not a warning on the way
            return solve_problem(problem, **settings)
    except AnnDcError:
        raise
    except (ArithmeticError, MemoryError, ValueError) as error:
        raise ProblemError(
            f"{problem.name}: the arithmetic failed ({error}); choose units in which states and "
            "controls are near 1, or a shorter horizon"
        ) from error


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
        from ann_dc.network.files import save as save_network

        save_network(solution.network, save)
        written.append(save)
    return written
