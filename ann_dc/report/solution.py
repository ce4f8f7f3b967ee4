"""Report of a solution: certificate, diagnosis, settling time and gains."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from ann_dc import plotting
from ann_dc.backends.curves import write_curves
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.recurrent.backend import RecurrentBackend
from ann_dc.backends.run import Backend
from ann_dc.gain_design.neighbourhood import neighbourhood
from ann_dc.optimality.complementarity import Complementarity
from ann_dc.progress import Progress, silent
from ann_dc.report.json_file import write_json
from ann_dc.report.tables import named_rows, span, unit_list, verdict_text
from ann_dc.solution.solution import Solution
from ann_dc.weights.network_file import save as save_network


def report_table(solution: Solution, backend: Backend | None = None) -> Table:
    """Return the table that ``ann-dc solve`` prints.

    Rows of the backend are omitted if the backend is unknown.
    """
    certificate = solution.certificate
    rows = {
        "problem": solution.problem,
        "units": unit_list(solution.problem),
        "equations": solution.equations.form,
        "status": solution.status,
        "certified": verdict_text(solution.certified, solution.verdict),
        "objective": f"{solution.objective:.10g} {solution.problem.cost_unit}".rstrip(),
        **({} if isinstance(solution.problem.dt, float) else {"step length": solution.chosen_step}),
        "KKT residual": f"{certificate.kkt_residual:.1e}, relative, in natural scales "
        f"(constraints {certificate.constraint_residual:.1e}, "
        f"stationarity {certificate.stationarity_residual:.1e})",
        **_inequalities(certificate.complementarity),
        **({} if certificate.soft_rows is None else {"soft rows": certificate.soft_rows.reported}),
        **({} if certificate.largest is None else {"objectives": certificate.largest.counts}),
        "second order": certificate.verdict,
        "Newton step": f"{certificate.newton_step:.1e} of a component's range, at most",
        "roll-out error": f"{solution.rollout_error:.1e} of a state's scale, from where the "
        "controls alone arrive to q_d",
        **_times(solution, _recurrence(backend)),
        **_gains(solution),
    }
    return named_rows(rows)


def _inequalities(kept: Complementarity | None) -> dict[str, str]:
    if kept is None:
        return {}
    return {
        "inequalities": f"{kept.counts}; violated by {kept.violation:.1e} of a range, wrong signs "
        f"{kept.wrong_sign:.1e}, complementarity {kept.product:.1e}"
    }


def _times(solution: Solution, recurrence: str | None) -> dict[str, str]:
    reported = "{1:.4g} fastest time constants = {0:.4g} unit time constants".format
    times, run, design = {}, solution.run, solution.design
    if design is not None and design.first.found_by:
        times["optimum found by"] = design.first.found_by
    if design is not None and design.start:
        times["network starts from"] = f"{design.start} as presets, not from the given start"
        times["neighbourhood"] = str(neighbourhood(design))
    if recurrence is not None:
        times["recurrence"] = recurrence
    if solution.status.settled:
        constants = solution.normalised_settling_time
        times["settling time"] = reported(solution.settling_time, constants)
        if recurrence is not None:
            times["settling steps"] = f"{run.settling_steps} recurrent steps of {run.steps} done"
        times["verified"] = run.verified
    if design is not None and (predicted := solution.predicted_settling) is not None:
        continuous = "" if recurrence is None else ", in continuous time"
        times["predicted"] = reported(predicted, predicted * design.spectrum.radius) + continuous
    return times


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
        f"{design.rho_star:.3g} would do for any time constants"
        if design.settled
        else "designed where a first run stopped without settling"
    )
    return {
        "rho": f"{rho} ({origin})",
        "preconditioner": preconditioner.kind.value,
    }


def write_solution(
    solution: Solution,
    *,
    plot: Path | None = None,
    json_file: Path | None = None,
    curves: Path | None = None,
    network: Path | None = None,
    folder: Path | None = None,
    progress: Progress = silent,
) -> list[Path]:
    """Write the requested files and return their paths.

    `plot` is the folder of the figures, `curves` the file of all neurons over time (.csv or .npz),
    `network` that of the network with its gains, and `folder` is for `load_solution`.
    """
    written: list[Path] = []
    if plot is not None:
        progress("drawing")
        written += plotting.save_all(solution, plot)
    if json_file is not None:
        write_json(json_file, solution.as_dict())
    if curves is not None:
        write_curves(solution.trajectory, curves)
    if network is not None:
        save_network(solution.network, network)
    if folder is not None:
        solution.save(folder)
    return written + [path for path in (json_file, curves, network, folder) if path is not None]
