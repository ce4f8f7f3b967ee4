"""What is said of a solution: certified or not, why, how fast, with which gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.table import Table
from rich.text import Text

from ann_dc.cli.terminal import span

if TYPE_CHECKING:
    from ann_dc.solution import Solution


def report_table(solution: Solution) -> Table:
    """Everything that `solve` prints."""
    proof = solution.certificate
    table = Table(show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    good = solution.certified
    rows = {
        "problem": solution.problem,
        "equations": solution.equations.form,
        "status": solution.status,
        "certified": Text(
            f"{'yes' if good else 'no'}: {solution.verdict}", "green" if good else "red"
        ),
        "objective": f"{solution.objective:.10g}",
        "KKT residual": f"{proof.kkt_residual:.1e} in the problem's units (constraints "
        f"{proof.constraint_residual:.1e}, stationarity {proof.stationarity_residual:.1e})",
        "second order": proof.verdict,
        "Newton step": f"{proof.newton_step:.1e} of a component's range, at most",
        "roll-out error": f"{solution.rollout_error:.1e}, from where the controls alone arrive "
        "to q_d",
        **_times(solution),
        **_gains(solution),
    }
    for name, value in rows.items():
        table.add_row(name, value if isinstance(value, Text) else str(value))
    return table


def _times(solution: Solution) -> dict[str, str]:
    units = "{:.4g} units of network time = {:.4g} fastest time constants".format
    times, design = {}, solution.design
    if solution.status.settled:
        constants = solution.settling_in_fastest_time_constants
        times["settling time"] = units(solution.settling_time, constants)
        times["verified"] = solution.run.verified
    if design is not None and design.settled:
        predicted = design.predicted_settling()
        times["predicted"] = units(predicted, predicted * design.spectrum.radius)
    return times


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
