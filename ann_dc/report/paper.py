"""The paper's car example, a line a run: what settles, what does not, and what is said of it."""

from __future__ import annotations

from rich.table import Table

from ann_dc.paper.example import PaperRun
from ann_dc.report.tables import table

LEGEND = """\
corrected:      the equations that hold, with designed gains (D: wheel base in m).
printed:        equations (16), (17) to the letter: rho = 0 and unit time constants.
designed gains: the same with the gains of the corrected network; rho is no part of the letter.
without dB/dq:  corrected but for one term of (11), S3; the straight path of Figure 4.
plain:          the equations that hold, with rho = 0 and unit time constants.
Time constants are those of the settling: unit ones (tau = 1), and the network's fastest."""


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
