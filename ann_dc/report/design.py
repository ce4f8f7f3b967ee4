"""Report of a gain design for one problem or an operating range."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from ann_dc.diagnosis import Diagnosis
from ann_dc.families.family_design import FamilyDesign
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.trial_run import Candidate
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.report.json_file import write_json
from ann_dc.report.tables import span, table
from ann_dc.weights.network_file import save as save_network

SHOWN = 12
"""Number of candidates in the table, fastest first."""


def candidate_table(design: Design) -> Table:
    """Return a table of the compared candidates, fastest first; the best is marked."""
    shown = table(
        "preconditioner", "rho", "ratio", "from the start (fastest time constants)", dense=True
    )
    for candidate in design.candidates[:SHOWN]:
        frozen = " (frozen)" if candidate is design.best else ""
        shown.add_row(
            candidate.gain_rule.kind.value + frozen,
            span(_penalties(design, candidate)),
            f"{candidate.ratio:.3g}",
            _settling(candidate),
        )
    if len(design.candidates) > SHOWN:
        shown.add_row(f"and {len(design.candidates) - SHOWN} slower ones", "", "", "")
    return shown


def _settling(candidate: Candidate) -> str:
    """Return the result of a trial run; only potentially fastest candidates have one."""
    if np.isnan(candidate.settling):
        return "not tried"
    return f"{candidate.settling:.0f}" if candidate.settling < np.inf else "not, or later"


def write_design(
    problem: OptimalControlProblem,
    design: Design,
    found: Diagnosis | None,
    folder: Path,
    progress: Progress = silent,
) -> list[Path]:
    """Write a design into an existing folder and return the paths of the files.

    The files are design.json, network.npz and why.png. A diagnosis is added to the JSON file and
    plotted. Raises `OutputError` if a file cannot be written.
    """
    written = [folder / "design.json", folder / "network.npz"]
    why = {} if found is None else {"why": diagnosis_dict(found)}
    write_json(written[0], design_dict(design) | why)
    save_network(design.network, written[1])
    if found is not None:
        from ann_dc import plotting  # loads matplotlib

        progress("drawing")
        written.append(plotting.save(plotting.diagnosis(found, problem), folder / "why.png"))
    return written


def design_dict(design: Design) -> dict[str, Any]:
    """Return gains, spectrum and candidates in network units as plain data for JSON."""
    names = [neuron.name for neuron in design.network.cell.neurons]
    return {
        "network": design.network.title,
        "settled": design.settled,
        "steps": design.first.steps,
        "found_by": design.first.found_by,
        "start": design.start,
        "rho_star": design.rho_star,
        "radius": design.spectrum.radius,
        "abscissa": design.spectrum.abscissa,
        "ratio": design.spectrum.stiffness_ratio,
        "preconditioner": design.gains.preconditioner.kind.value,
        "rho": dict(zip(names, design.gains.rho.tolist())),
        "rate": dict(zip(names, design.gains.rate.tolist())),
        "candidates": [
            {
                "preconditioner": candidate.gain_rule.kind.value,
                "rho": _penalties(design, candidate).tolist(),
                "ratio": candidate.ratio,
                "settling": candidate.settling,
            }
            for candidate in design.candidates
        ],
    }


def diagnosis_dict(found: Diagnosis) -> dict[str, Any]:
    """Return rows, modes and remedies in network units as plain data for JSON."""
    slowness = found.slowness
    return {
        "ratio": slowness.ratio,
        "distance_to_limit": slowness.distance,
        "reason": found.reason,
        "advice": found.advice,
        "shadow_over_penalty": [slowness.lowest, slowness.highest],
        "rows": [
            {
                "neuron": row.neuron,
                "penalty": row.penalty,
                "at_stage": row.at_stage.tolist(),
                "lowest": row.lowest,
                "highest": row.highest,
            }
            for row in slowness.rows
        ],
        "modes": [
            {
                "real": mode.eigenvalue.real,
                "imaginary": mode.eigenvalue.imag,
                "shares": dict(zip(mode.names, mode.shares.tolist())),
                "dual_share": mode.dual_share,
                "curvature": mode.curvature,
                "penalty": mode.penalty,
                "shadow_over_penalty": mode.shadow,
                "sign_changes": mode.sign_changes,
                "cause": mode.cause.name.lower(),
            }
            for mode in slowness.modes
        ],
        "remedies": [
            {"change": r.change, "ratio": r.ratio, "gain": r.gain, "compared": r.compared}
            for r in found.remedies
        ],
    }


def _penalties(design: Design, candidate: Candidate) -> np.ndarray:
    index = design.network.neuron_index
    return candidate.gains.rho[[index[dual.neuron] for dual in design.network.cell.duals]]


def write_family(designed: FamilyDesign, folder: Path, progress: Progress = silent) -> list[Path]:
    """Write a design over an operating range into a folder and return the paths.

    The folder must exist. The files are design.json, network.npz and family.png. Raises
    `OutputError` if a file cannot be written.
    """
    from ann_dc import plotting  # loads matplotlib

    written = [folder / "design.json", folder / "network.npz"]
    write_json(written[0], family_dict(designed))
    save_network(designed.network, written[1])
    progress("drawing")
    return [*written, plotting.save(plotting.family(designed), folder / "family.png")]


def family_dict(designed: FamilyDesign) -> dict[str, Any]:
    """Return ranges, gains, settled fraction, settling and failing inputs for JSON."""
    names = [neuron.name for neuron in designed.network.cell.neurons]
    found, low_high = designed.validation, designed.validation.interval
    return {
        "network": designed.network.title,
        "ranges": {name: list(ends) for name, ends in designed.family.ranges.items()},
        "preconditioner": designed.winner.gain_rule.kind.value,
        "points": designed.points,
        "rho": dict(zip(names, designed.gains.rho.tolist())),
        "rate": dict(zip(names, designed.gains.rate.tolist())),
        "held_out": len(found),
        "certified": int(found.certified.sum()),
        "share": found.share,
        "interval": list(low_high) if found.drawn else None,
        "settling": {
            "median": found.settling_quantile(0.5),
            "99 of 100": found.settling_quantile(0.99),
            "worst": found.settling_quantile(1.0),
        },
        "reasons": dict(Counter(failure.name.lower() for failure in found.failures.values())),
        "failures": [
            {
                "reason": failure.value,
                "inputs": {name: value.tolist() for name, value in found.samples[number].items()},
            }
            for number, failure in found.failures.items()
        ],
    }
