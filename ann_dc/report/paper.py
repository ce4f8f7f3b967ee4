"""Report of the paper's car example: outcomes of all runs, obstacles, and Figure 6."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.table import Table

from ann_dc.paper.around import RADIUS, Around, obstacles
from ann_dc.paper.example import PaperRun
from ann_dc.paper.replans import Iterations, Plans
from ann_dc.report.tables import named_rows, table
from ann_dc.si_prefixes import counted
from ann_dc.two_level.run import TwoLevelRun

LEGEND = """\
corrected:      corrected equations with designed gains (D: wheel base in m).
printed:        equations (16), (17) as printed: rho = 0 and unit time constants.
designed gains: the same with the gains of the corrected network (rho is not printed).
without dB/dq:  corrected but for one term of (11), S3; the straight path of Figure 4.
plain:          corrected equations with rho = 0 and unit time constants.
Settling times are in unit time constants (tau = 1), and in tau_min, the fastest time constant."""


def paper_table(runs: list[PaperRun]) -> Table:
    """Return a table of objective, residuals, settling and outcome of every run."""
    shown = table(
        "run", "objective", "KKT\nresidual", "simulation\nerror", "unit time\nconstants",
        "tau_min", "result", dense=True,
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
    constants = solution.normalised_settling_time
    times = f"{solution.settling_time:.1f}", f"{constants:.0f}"
    return (f"{solution.objective:.4f}", *residuals, *times, f"settled: {solution.verdict}")


def around_table(cases: Sequence[Around]) -> Table:
    """Return a table of the paths around the obstacles of Figures 4 and 5."""
    return named_rows({f"Figure 4 {case.plans.case.name}": _around_text(case) for case in cases})


def _around_text(case: Around) -> str:
    segments, discs = case.ways.values()
    solution = case.discs
    return (
        f"as printed, {case.leap:.2f} m of the path are without a plan; with segments planned: "
        f"clearance {case.room(segments):.3f} m along the segments, {segments.u.shape[1]} "
        f"stages; obstacles as constraints of one network: {solution.status.outcome.value}, "
        f"{solution.verdict}, E = {solution.objective:.2f}, clearance {case.room(discs):.3f} m; "
        f"simulation errors {case.error(segments):.0e} and {case.error(discs):.0e}"
    )


def around_dict(cases: Sequence[Around]) -> dict[str, Any]:
    """Return obstacles, paths, controls and margins of Figures 4 and 5 as plain data."""
    return {case.plans.case.name: _case_dict(case) for case in cases}


def _case_dict(case: Around) -> dict[str, Any]:
    ways = {
        name: {
            "states": way.q,
            "controls": way.u,
            "room": case.room(way),
            "rollout_error": case.error(way),
        }
        for name, way in case.ways.items()
    }
    return {
        "obstacles": obstacles(case.plans),
        "radius": RADIUS,
        "printed": [{"states": q, "controls": u} for q, u in case.printed],
        "left_out": case.leap,
        "legs_certified": [segment.certified for segment in case.segments],
        "discs_objective": case.discs.objective,
        "discs_certified": case.discs.certified,
        **ways,
    }


def iterations_table(found: Iterations) -> Table:
    """Return a table of Figure 6 and of both theorems."""
    cases = {plans.case.name: _plans_text(plans) for plans in found.cases}
    return named_rows(
        {
            "Theorem IV.1": f"{found.following}; {_followed(found.gradient)}",
            "Theorem IV.2": found.hypothesis,
            "as in (32)": f"with diag(0.99, 0.1) at every state: {found.printed_hypothesis}",
            **cases,
            "(28)-(30), (33) printed": _letter_text(found.letter),
        }
    )


def _plans_text(plans: Plans) -> str:
    own, newton = plans.run, plans.newton.residuals
    count = len(plans.starts)
    done = int(own.settled.sum())
    needed = ", ".join(str(int((sample >= own.tolerance).sum())) for sample in newton.T)
    return (
        f"{count} plans with lambda = |B/A| / 2: {done} settled after {own.rounds} outer "
        f"iterations; from T_0 a Newton coordinator needs {needed}"
    )


def _followed(run: TwoLevelRun) -> str:
    distances = run.distances
    if distances is None:
        return "not measured"
    v, mu = ((part / distances.reported).max() for part in (distances.v, distances.mu))
    return (
        f"measured in {counted(run.rounds, 'outer iterations')}: at most {v:.3g} and {mu:.3g} times"
    )


def _letter_text(run: TwoLevelRun) -> str:
    found, gain = run.lyapunov, run.gains[:, 0, 0]
    if found is None:
        return run.message(0)
    return (
        f"{run.message(0)}; lambda from {gain[0]:.3g} to {gain[-1]:.3g}, Theta from "
        f"{found.theta[0, 0]:.3g} to {found.theta[-1, 0]:.3g}: the stages do not use the map, "
        "and t and beta diverge together"
    )


def iterations_dict(found: Iterations) -> dict[str, Any]:
    """Return the data of Figure 6 and of both theorems for JSON."""
    return {
        "theorem_IV_1_rates": [found.following.v, found.following.mu],
        "theorem_IV_2_holds": found.hypothesis.holds,
        "theorem_IV_2_holds_as_printed": found.printed_hypothesis.holds,
        **{plans.case.name: _curves(plans.run) for plans in found.cases},
        "(28)-(30), (33) printed": _curves(found.letter),
    }


def _curves(run: TwoLevelRun) -> dict[str, Any]:
    found, printed = run.lyapunov, run.printed_lyapunov
    if found is None or printed is None:
        return {}
    return {
        "lambda": run.gains[:, 0].T,
        "A": found.A.T,
        "B": found.B.T,
        "theta": found.theta.T,
        "A_as_printed": printed.A.T,
        "B_as_printed": printed.B.T,
        "settled": run.settled,
    }
