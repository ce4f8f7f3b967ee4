"""What is said of a solution: certified or not, why, how fast, with which gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table

from ann_dc.report.tables import named_rows, span, verdict_text

if TYPE_CHECKING:
    from ann_dc.backends.ode import OdeBackend
    from ann_dc.backends.recurrent.backend import RecurrentBackend
    from ann_dc.solution import Solution


def report_table(solution: Solution, backend: OdeBackend | RecurrentBackend) -> Table:
    """Everything that `solve` prints."""
    from ann_dc.backends.ode import OdeBackend

    proof = solution.certificate
    rows = {
        "problem": solution.problem,
        "equations": solution.equations.form,
        "status": solution.status,
        "certified": verdict_text(solution.certified, solution.verdict),
        "objective": f"{solution.objective:.10g}",
        "KKT residual": f"{proof.kkt_residual:.1e} in the problem's units (constraints "
        f"{proof.constraint_residual:.1e}, stationarity {proof.stationarity_residual:.1e})",
        "second order": proof.verdict,
        "Newton step": f"{proof.newton_step:.1e} of a component's range, at most",
        "roll-out error": f"{solution.rollout_error:.1e}, from where the controls alone arrive "
        "to q_d",
        **_times(solution, None if isinstance(backend, OdeBackend) else backend),
        **_gains(solution),
    }
    return named_rows(rows)


def _times(solution: Solution, recurrent: RecurrentBackend | None) -> dict[str, str]:
    units = "{:.4g} units of network time = {:.4g} fastest time constants".format
    times, run, design = {}, solution.run, solution.design
    if recurrent is not None:
        times["recurrence"] = _recurrence(recurrent)
    if solution.status.settled:
        constants = solution.settling_in_fastest_time_constants
        times["settling time"] = units(solution.settling_time, constants)
        if recurrent is not None:
            times["settling steps"] = f"{run.settling_steps} recurrent steps of {run.steps} done"
        times["verified"] = run.verified
    if design is not None and design.settled:
        predicted = design.predicted_settling()
        continuous = "" if recurrent is None else ", in continuous time"
        times["predicted"] = units(predicted, predicted * design.spectrum.radius) + continuous
    return times


def _recurrence(backend: RecurrentBackend) -> str:
    """How the steps are made."""
    length = getattr(backend.step, "step", None)
    steps = "adaptive steps" if length is None else f"steps of {length:g}"
    accelerated = "" if backend.acceleration is None else ", Anderson acceleration"
    return f"{backend.order.name.replace(' ', '-')} order, {steps}{accelerated}"


def _gains(solution: Solution) -> dict[str, str]:
    design, coordinators = solution.design, solution.network.coordinators
    if design is None:
        return {}
    index = design.network.neuron_index
    rho = span([design.gains.rho[index[dual.neuron]] for dual in design.network.cell.duals])
    origin = (
        f"{design.rho_star:.3g} would do for any time constants"
        if design.settled
        else "designed where a first run stopped without settling"
    )
    return {
        "rho": f"{rho} ({origin})",
        "coordinators": "none" if coordinators is None else f"{coordinators.size()} coarse neurons",
    }
