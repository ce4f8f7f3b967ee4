"""The paper's car example in four runs, and their table.

Two runs hold: the corrected equations with designed gains, for both wheel bases. Two do not, and
say why the corrections and the gains matter: the equations exactly as printed, (16) and (17), and
the corrected ones on the plain network (rho = 0, unit time constants), started near the optimum.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from rich.table import Table

from ann_dc.backends.ode import OdeBackend
from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import PRINTED
from ann_dc.gain_design.rules.gains import hand_gains
from ann_dc.problem.plants import car
from ann_dc.problem.start import Start
from ann_dc.progress import Progress, silent
from ann_dc.report.tables import table
from ann_dc.solution.solution import Solution
from ann_dc.solver import solve
from ann_dc.synthesis.synthesis import synthesize

OFF = 0.01
"""How far from the optimum the plain network starts, as a share of every neuron's value."""

LEGEND = """\
corrected: the equations that hold, with designed gains (D: wheel base in m).
printed:   equations (16), (17) to the letter, with the same gains.
plain:     the equations that hold, with rho = 0 and unit time constants.
Time constants are those of the settling: unit ones (tau = 1), and the network's fastest."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PaperRun:
    """One row of the table: a ``label``, a solution, and how its remark begins."""

    label: str
    solution: Solution
    remark: str = ""


def corrected_runs(progress: Progress = silent) -> Iterator[PaperRun]:
    """The equations that hold, with designed gains, for both wheel bases."""
    for label, problem in {"corrected D=1": car(), "corrected D=0.5": car(D=0.5)}.items():
        tell = lambda line, label=label: progress(f"{label}: {line}")  # noqa: E731
        yield PaperRun(label=label, solution=solve(problem, progress=tell))


def demonstrations(optimum: Solution, progress: Progress = silent) -> Iterator[PaperRun]:
    """What does not work, and need not be watched for long."""
    problem = optimum.problem
    brief = OdeBackend(verify=False, limit=2000, most_steps=3000)
    progress("printed D=1")
    yield PaperRun(label="printed D=1", solution=solve(problem, form=PRINTED, backend=brief))
    progress("plain D=1")
    gains = hand_gains(synthesize(decompose(problem)))
    yield PaperRun(
        label="plain D=1",
        solution=solve(problem, gains=gains, start=_near(optimum), backend=brief),
        remark=f"started {OFF:.0%} off the optimum, moved away and ",
    )


def _near(optimum: Solution) -> Start:
    """A start with every neuron a little off its optimum."""
    values = {name: (1 + OFF) * rows.T for name, rows in optimum.populations.items()}
    return Start(q=values["q"], u=values["u"], mu=values["mu"], beta=values["beta"])


def paper_table(runs: list[PaperRun]) -> Table:
    """Objective, residuals, settling and outcome of every run."""
    shown = table(
        "run", "objective", "KKT\nresidual", "roll-out\nerror", "unit time\nconstants",
        "fastest\ntime\nconstants", "what happened", dense=True,
    )  # fmt: skip
    shown.columns[0].max_width = 9
    for column in shown.columns[1:6]:
        column.no_wrap, column.justify = True, "right"
    for run in runs:
        shown.add_row(run.label, *_row(run))
    return shown


def _row(run: PaperRun) -> tuple[str, ...]:
    solution = run.solution
    residuals = f"{solution.kkt_residual:.1e}", f"{solution.rollout_error:.1e}"
    if not solution.status.settled:
        message = solution.status.message.partition(";")[0]
        return ("-", *residuals, "-", "-", run.remark + message)
    constants = solution.settling_in_fastest_time_constants
    times = f"{solution.settling_time:.1f}", f"{constants:.0f}"
    return (f"{solution.objective:.4f}", *residuals, *times, f"settled: {solution.verdict}")
