"""``ann-dc paper``: the paper's car, corrected; what its printed equations do; why gains matter."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ann_dc.cli.commands.solve import solved
from ann_dc.cli.terminal import console, list_files, progress_line
from ann_dc.report.json_file import make_room, write_json
from ann_dc.report.tables import table
from ann_dc.whole_files import make_folder

if TYPE_CHECKING:
    from rich.table import Table

    from ann_dc.problem.start import Start
    from ann_dc.solution import Solution

LEGEND = """\
corrected: the equations that hold, with designed gains (D: wheel base in m).
printed:   equations (16), (17) to the letter, with the same gains.
plain:     the equations that hold, with rho = 0 and unit time constants."""
OFF = 0.01
"""How far from the optimum the plain network starts, as a share of every neuron's value."""

CAR_UNITS = {"x": "m", "y": "m", "phi": "rad", "varphi": "rad", "nu": "m/s", "eta": "rad/s"}
"""What the figures write on their axes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperRun:
    """One row of the table: a solution, and how its remark begins."""

    label: str
    solution: Solution
    remark: str = ""


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

        corrected = list(_corrected(progress))
        runs = [*corrected, *_demonstrations(corrected[0].solution, progress)]
        written = []
        for run, folder in zip(corrected, ("car_D1", "car_D0.5")):
            progress(f"drawing {folder}")
            written += plotting.save_all(run.solution, make_folder(out / folder), CAR_UNITS)
        write_json(result, {run.label: run.solution.as_dict() for run in runs})
    console().print(_paper_table(runs), LEGEND, sep="\n")
    list_files([*written, result])
    raise typer.Exit(0 if all(run.solution.certified for run in corrected) else 1)


def _corrected(progress: Callable[[str], None]) -> Iterator[PaperRun]:
    """The equations that hold, with designed gains, for both wheel bases."""
    from ann_dc.problem.plants import car

    for label, problem in {"corrected D=1": car(), "corrected D=0.5": car(D=0.5)}.items():
        tell = lambda line, label=label: progress(f"{label}: {line}")  # noqa: E731
        yield PaperRun(label=label, solution=solved(problem, progress=tell))


def _demonstrations(optimum: Solution, progress: Callable[[str], None]) -> Iterator[PaperRun]:
    """What does not work, and need not be watched for long."""
    from ann_dc.backends.ode import OdeBackend
    from ann_dc.decomposition.equations import decompose
    from ann_dc.decomposition.form import PRINTED
    from ann_dc.gain_design.gains import hand_gains
    from ann_dc.synthesis.synthesis import synthesize

    problem = optimum.problem
    brief = OdeBackend(verify=False, limit=2000, most_steps=3000)
    progress("printed D=1")
    yield PaperRun(label="printed D=1", solution=solved(problem, form=PRINTED, backend=brief))
    progress("plain D=1")
    gains = hand_gains(synthesize(decompose(problem)))
    yield PaperRun(
        label="plain D=1",
        solution=solved(problem, gains=gains, start=_near(optimum), backend=brief),
        remark=f"started {OFF:.0%} off the optimum, moved away and ",
    )


def _near(optimum: Solution) -> Start:
    """A start with every neuron a little off its optimum."""
    from ann_dc.problem.start import Start

    values = {name: (1 + OFF) * rows.T for name, rows in optimum.populations.items()}
    return Start(q=values["q"], u=values["u"], mu=values["mu"], beta=values["beta"])


def _paper_table(runs: list[PaperRun]) -> Table:
    shown = table(
        "run", "objective", "KKT\nresidual", "roll-out\nerror", "settling\ntime",
        "fastest\ntime\nconstants", "what happened", dense=True,
    )  # fmt: skip
    shown.columns[0].max_width = 9
    for column in shown.columns[1:6]:
        column.no_wrap, column.justify = True, "right"
    for run in runs:
        shown.add_row(run.label, *_paper_row(run))
    return shown


def _paper_row(run: PaperRun) -> tuple[str, ...]:
    solution = run.solution
    residuals = f"{solution.kkt_residual:.1e}", f"{solution.rollout_error:.1e}"
    if not solution.status.settled:
        message = solution.status.message.partition(";")[0]
        return ("-", *residuals, "-", "-", run.remark + message)
    constants = solution.settling_in_fastest_time_constants
    times = f"{solution.settling_time:.1f}", f"{constants:.0f}"
    return (f"{solution.objective:.4f}", *residuals, *times, f"settled: {solution.verdict}")
