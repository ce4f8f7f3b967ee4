"""Report of a solution: certificate, diagnosis, settling time and gains."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from ann_dc import plotting
from ann_dc.backends.curves import write_curves
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.run import Backend
from ann_dc.backends.status import Outcome
from ann_dc.gain_design.neighbourhood import neighbourhood
from ann_dc.gain_design.procedure import Design
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.complementarity import Complementarity
from ann_dc.progress import Progress, silent
from ann_dc.report.json_file import write_json
from ann_dc.report.tables import headline, indented, named_rows, span, table, unit_list
from ann_dc.solution.solution import Solution
from ann_dc.timing import phase
from ann_dc.weights.network_file import save as save_network

LISTED = 12
"""Largest number of rows of the table of stages that is shown in full by default."""
FIRST, LAST = 4, 3
"""Numbers of rows at both ends of a longer table."""
NO_SOLUTION = "values are the last state of the network, not a solution"
"""Remark on objective, states and controls of an infeasible or unbounded problem."""
FAR = 3.0
"""Ratio of measured and predicted settling time from which the report remarks on it."""
SMALLEST = 1e-7
"""Values below this fraction of the largest of their column are shown as zero."""
WIDEST = 8
"""Largest number of states and controls in the table of stages."""


class Stages(Enum):
    """Rows of the table of stages: a selection of long ones, all, or none."""

    SHORT = "short"
    ALL = "all"
    NONE = "none"


def solution_report(
    solution: Solution, backend: Backend | None = None, stages: Stages = Stages.SHORT
) -> Group:
    """Return the report that ``ann-dc solve`` prints: result, cost and time, checks, settings.

    A table of states and controls follows. Rows of the backend are omitted if it is unknown.
    """
    certificate = solution.certificate
    rows = {
        "objective": f"{solution.objective:.10g} {solution.problem.cost_unit}".rstrip(),
        **({} if isinstance(solution.problem.dt, float) else {"step length": solution.chosen_step}),
        **({} if certificate.largest is None else {"objectives": certificate.largest.counts}),
        **_times(solution, _recurrence(backend)),
        "status": solution.status,
        "KKT residual": f"{certificate.kkt_residual:.1e}, relative in natural scales "
        f"(feasibility {certificate.constraint_residual:.1e}, "
        f"stationarity {certificate.stationarity_residual:.1e})",
        **_inequalities(certificate.complementarity),
        **(
            {}
            if certificate.soft_rows is None
            else {"soft constraints": certificate.soft_rows.reported}
        ),
        "second order": certificate.verdict,
        "Newton step": f"{certificate.newton_step:.1e} of a component's range at most",
        "simulation error": f"{solution.rollout_error:.1e} of a state's scale (terminal state of "
        "a simulation of the discrete-time equations against q_d)",
        **_verification(solution),
        "problem": solution.problem,
        "units": unit_list(solution.problem),
        "equations": solution.equations.form,
        **_gains(solution),
    }
    parts = [_headline(solution), indented(named_rows(rows))]
    if stages is not Stages.NONE:
        parts += ["", indented(stage_table(solution, stages))]
    return Group(*parts)


def _headline(solution: Solution) -> Text:
    """Return the result in one line."""
    reached = "settled at" if solution.status.settled else "found"
    verdict = (
        f"{reached} a certified optimum, {solution.verdict}"
        if solution.certified
        else f"not certified: {solution.verdict}{_without_solution(solution)}"
    )
    return headline(solution.problem.name, verdict, solution.certified)


def _without_solution(solution: Solution) -> str:
    """Return a remark on the values of a problem without a solution, else an empty text."""
    has_none = solution.status.outcome in (Outcome.INFEASIBLE, Outcome.UNBOUNDED)
    return f" ({NO_SOLUTION})" if has_none else ""


def stage_table(solution: Solution, stages: Stages = Stages.SHORT) -> Table:
    """Return the table of states and controls over the stages, in the user's units."""
    problem = solution.problem
    names = [*map(str, problem.states), *map(str, problem.controls)]
    hidden = len(names) - WIDEST
    units = [problem.unit(name) for name in names[:WIDEST]]
    heads = [f"{n} ({unit})" if unit else n for n, unit in zip(names, units)]
    shown = table("k", f"t ({problem.time_unit})", *heads, dense=True)
    for column in shown.columns:
        column.justify, column.no_wrap = "right", True
    columns = [solution.time, *(solution[name] for name in names[:WIDEST])]
    count = len(solution.time)
    rows = [*range(count)]
    if stages is Stages.SHORT and count > LISTED:
        rows = [*rows[:FIRST], -1, *rows[-LAST:]]
    for k in rows:
        cells = [_number(c, k) if k < len(c) else "" for c in columns]
        shown.add_row(*([str(k), *cells] if k >= 0 else ["..."]))
    notes = ["all stages: --table all"] * (len(rows) < count)
    notes += [NO_SOLUTION] * bool(_without_solution(solution))
    notes += [f"{hidden} more columns: --trajectory FILE"] * (hidden > 0)
    shown.caption = "; ".join(notes) or None
    return shown


def _number(column: np.ndarray, k: int) -> str:
    """Return a value to five digits; zero if it is a rounding error of its column."""
    return f"{column[k] if abs(column[k]) > SMALLEST * np.abs(column).max() else 0:.5g}"


def _inequalities(kept: Complementarity | None) -> dict[str, str]:
    if kept is None:
        return {}
    return {
        "inequalities": f"{kept.counts}; violation {kept.violation:.1e} of a range, wrong signs "
        f"{kept.wrong_sign:.1e}, complementarity {kept.product:.1e}"
    }


def _times(solution: Solution, recurrence: str | None) -> dict[str, str]:
    times, run, design = {}, solution.run, solution.design
    if design is not None and design.first.found_by:
        times["optimum found by"] = design.first.found_by
    if design is not None and design.start:
        times["initial state"] = _preset(design)
        with phase("neighbourhood"):
            times["neighbourhood"] = str(neighbourhood(design))
    if recurrence is not None:
        times["recurrence"] = recurrence
    found = []
    if solution.status.settled:
        found.append(f"{solution.normalised_settling_time:.3g} tau_min measured")
        if recurrence is not None:
            times["settling steps"] = f"{run.settling_steps} recurrent steps of {run.steps} done"
    if design is not None and (predicted := solution.predicted_settling) is not None:
        continuous = "" if recurrence is None else " in continuous time"
        found.append(f"{predicted * design.spectrum.radius:.3g} predicted{continuous}")
    if found:
        remark = _prediction_remark(solution) if recurrence is None else ""
        times["settling time"] = f"{', '.join(found)} (tau_min: fastest time constant{remark})"
    return times


def _preset(design: Design) -> str:
    """Return the preset of a design, with the option to try for the given initial guess."""
    text = f"{design.start} (preset), not the given initial guess"
    multilevel = PreconditionerKind.MULTILEVEL
    if design.best.kind is multilevel:
        return text
    return f"{text}; to settle from the guess, try --preconditioner {multilevel.value}"


def _prediction_remark(solution: Solution) -> str:
    """Return a remark if measured and predicted settling time differ by the factor `FAR`."""
    measured, predicted = solution.settling_time, solution.predicted_settling
    if predicted is None or not solution.status.settled:
        return ""
    differ = max(measured, predicted) > FAR * min(measured, predicted)
    return "; the prediction holds near the optimum" if differ else ""


def _verification(solution: Solution) -> dict[str, str]:
    return {"verified": solution.run.verified} if solution.status.settled else {}


def _recurrence(backend: Backend | None) -> str | None:
    """Return a description of the recurrent steps; None for continuous time."""
    if backend is None or isinstance(backend, OdeBackend):
        return None
    if not isinstance(backend, RecurrentBackend):
        return type(backend).__name__
    length = getattr(backend.step, "step", None)
    steps = "adaptive steps" if length is None else f"steps of {length:g}"
    accelerated = "" if backend.acceleration is None else ", Anderson acceleration"
    return f"{backend.order.name.replace(' ', '-')} order, {steps}{accelerated}"


def _gains(solution: Solution) -> dict[str, str]:
    design, preconditioner = solution.design, solution.network.preconditioner
    if design is None:
        return {}
    index = design.network.neuron_index
    rho = span([design.gains.rho[index[dual.neuron]] for dual in design.network.cell.duals])
    origin = (
        f"threshold {design.rho_star:.3g}"
        if design.settled
        else "designed at the end of a run that did not settle"
    )
    return {
        "preconditioner": preconditioner.kind.value,
        "penalty rho": f"{rho} ({origin})",
    }


def write_solution(
    solution: Solution,
    *,
    figures: Path | None = None,
    json_file: Path | None = None,
    trajectory: Path | None = None,
    weights: Path | None = None,
    folder: Path | None = None,
    overwrite: bool = False,
    progress: Progress = silent,
) -> list[Path]:
    """Write the requested files and return their paths.

    `figures` is the folder of the figures and `trajectory` the file of all neurons over time.
    `weights` is the file of the network with its gains. `folder` is for `load_solution`;
    `overwrite` replaces a solution saved there.
    """
    written: list[Path] = []
    if figures is not None:
        progress("drawing")
        with phase("figures"):
            written += plotting.save_all(solution, figures)
    with phase("other files"):
        if json_file is not None:
            write_json(json_file, solution.as_dict())
        if trajectory is not None:
            write_curves(solution.trajectory, trajectory)
        if weights is not None:
            save_network(solution.network, weights)
        if folder is not None:
            solution.save(folder, overwrite=overwrite)
    paths = (json_file, trajectory, weights, folder)
    return written + [path for path in paths if path is not None]
