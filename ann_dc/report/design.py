"""Report of a gain design for one problem or an operating range."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group
from rich.table import Table

from ann_dc import plotting
from ann_dc.diagnosis import Diagnosis
from ann_dc.families.family_design import FamilyDesign
from ann_dc.gain_design.choice import NEAR_LIMIT
from ann_dc.gain_design.procedure import Design
from ann_dc.gain_design.trial_run import Candidate
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, PreconditionerKind
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.report.json_file import picked, write_results
from ann_dc.report.tables import headline, indented, named_rows, table
from ann_dc.weights.network_file import save as save_network


def design_report(
    problem: OptimalControlProblem,
    design: Design,
    requested: Sequence[PreconditionerKind] = ALL_KINDS,
) -> Group:
    """Return the report that ``ann-dc design`` prints: result, comparison, gains."""
    kind = design.best.kind.value
    result = f"gains designed, {kind} preconditioner"
    if not design.settled:
        result = f"gains of the last state of a run that did not settle, {kind} preconditioner"
    elif design.best.settling < np.inf:
        result += f", settling time {design.best.settling:.0f} tau_min in a trial run"
    return Group(
        headline(problem.name, result, design.settled),
        indented(candidate_table(design, requested)),
        indented(named_rows(design.rows)),
    )


def candidate_table(design: Design, requested: Sequence[PreconditionerKind] = ALL_KINDS) -> Table:
    """Return a table with one row per preconditioner: candidates, stiffness ratio and settling.

    A row has the best candidate of its kind; candidates with equal gains count once. Requested
    kinds that were not evaluated follow with the reason.
    """
    heads = "preconditioner", "candidates", "stiffness ratio", "settling (tau_min)", "result"
    shown = table(*heads, dense=True)
    shown.columns[0].no_wrap = True
    for column in shown.columns[1:4]:
        column.justify = "right"
    kinds = [design.best.kind, *(c.kind for c in sorted(design.candidates, key=_rank))]
    for kind in dict.fromkeys(kinds):
        found = [candidate for candidate in design.candidates if candidate.kind is kind]
        best = design.best if kind is design.best.kind else min(found, key=_rank)
        distinct = {_fingerprint(design, candidate) for candidate in found}
        is_timed = best.settling < np.inf
        shown.add_row(
            kind.value,
            str(len(distinct)),
            f"{best.ratio:.3g}",
            f"{best.settling:.0f}" if is_timed else "-",
            _result(design, best),
        )
    others: dict[str, list[str]] = {}
    for kind in requested:
        if kind not in kinds:
            shown.add_row(kind.value, "-", "-", "-", "not evaluated")
            others.setdefault(_reason(design, kind, requested), []).append(kind.value)
    lines = [f"not evaluated: {', '.join(names)} ({reason})" for reason, names in others.items()]
    shown.caption = "\n".join(lines) or None
    return shown


def _rank(candidate: Candidate) -> tuple[float, float]:
    return candidate.rank


def _fingerprint(design: Design, candidate: Candidate) -> tuple[object, ...]:
    """Return the ratio, settling time and penalties of a candidate to six digits."""
    penalties = np.ravel(_penalties(design, candidate))
    return (*candidate.rank, *(f"{penalty:.6g}" for penalty in penalties))


def _result(design: Design, best: Candidate) -> str:
    """Return the result of a kind; only potentially fastest candidates have a trial run."""
    if best is design.best:
        return "selected"
    if np.isnan(best.settling):
        return "no trial run" if np.isfinite(best.ratio) else "unstable"
    return "slower" if best.settling < np.inf else "slower or not settled"


def _reason(
    design: Design, kind: PreconditionerKind, requested: Sequence[PreconditionerKind]
) -> str:
    """Return the reason for which a kind was not evaluated."""
    best = design.best
    if kind.is_stiffness and design.network.cell.objectives:
        return "objectives couple all stages"
    if kind.is_stiffness and not design.first.settled:
        return "needs a settled first run"
    grid = PreconditionerKind.RESISTIVE_GRID
    if kind is PreconditionerKind.CYCLIC_REDUCTION and grid in requested:
        return f"represented by the {grid.value}"
    if best.settling < np.inf and best.ratio < NEAR_LIMIT:
        return f"the {best.kind.value} is within a factor {NEAR_LIMIT / 2:g} of the limit"
    return "cannot be built for this network"


def write_design(
    problem: OptimalControlProblem,
    design: Design,
    found: Diagnosis | None,
    folder: Path | None = None,
    json_file: Path | None = None,
    progress: Progress = silent,
) -> list[Path]:
    """Write a design into an existing folder or a JSON file and return the paths of the files.

    The files of the folder are design.json, network.npz and, with a diagnosis, diagnosis.png. A
    diagnosis is added to the JSON data. Raises `OutputError` if a file cannot be written.
    """
    diagnosis = {} if found is None else {"diagnosis": _diagnosis_dict(found)}
    written = _written(_design_dict(design) | diagnosis, design.network, folder, json_file)
    if found is not None and folder is not None:
        progress("drawing")
        figure = plotting.diagnosis(found, problem)
        written.append(plotting.save(figure, folder / "diagnosis.png"))
    return written


def _written(
    content: dict[str, Any], network: Network, folder: Path | None, json_file: Path | None
) -> list[Path]:
    if folder is None:
        return write_results(content, json_file)
    written = write_results(content, json_file, folder / "design.json")
    save_network(network, folder / "network.npz")
    return [*written, folder / "network.npz"]


def _design_dict(design: Design) -> dict[str, Any]:
    """Return gains, spectrum and candidates in network units as plain data for JSON."""
    names = [neuron.name for neuron in design.network.cell.neurons]
    return {
        "network": design.network.title,
        "settled": design.settled,
        **picked(design.first, "steps", "found_by"),
        **picked(design, "start", "rho_star"),
        **picked(design.spectrum, "radius", "abscissa"),
        "ratio": design.spectrum.stiffness_ratio,
        "preconditioner": design.gains.preconditioner.kind.value,
        "rho": dict(zip(names, design.gains.rho)),
        "rate": dict(zip(names, design.gains.rate)),
        "candidates": [
            {
                "preconditioner": candidate.gain_rule.kind.value,
                "rho": _penalties(design, candidate),
                **picked(candidate, "ratio", "settling"),
            }
            for candidate in design.candidates
        ],
    }


def _diagnosis_dict(found: Diagnosis) -> dict[str, Any]:
    """Return rows, modes and remedies in network units as plain data for JSON."""
    slowness = found.slowness
    return {
        "ratio": slowness.ratio,
        "distance_to_limit": slowness.distance,
        **picked(found, "reason", "advice"),
        "shadow_over_penalty": [slowness.lowest, slowness.highest],
        "rows": [
            picked(row, "neuron", "penalty", "at_stage", "lowest", "highest")
            for row in slowness.rows
        ],
        "modes": [
            {
                "real": mode.eigenvalue.real,
                "imaginary": mode.eigenvalue.imag,
                "shares": dict(zip(mode.names, mode.shares)),
                **picked(mode, "dual_share", "curvature", "penalty"),
                "shadow_over_penalty": mode.sensitivity,
                "sign_changes": mode.sign_changes,
                "cause": mode.cause.name.lower(),
            }
            for mode in slowness.modes
        ],
        "remedies": [
            picked(remedy, "change", "ratio", "gain", "compared") for remedy in found.remedies
        ],
    }


def _penalties(design: Design, candidate: Candidate) -> np.ndarray:
    index = design.network.neuron_index
    return candidate.gains.rho[[index[dual.neuron] for dual in design.network.cell.duals]]


def write_family(
    designed: FamilyDesign,
    folder: Path | None = None,
    json_file: Path | None = None,
    progress: Progress = silent,
) -> list[Path]:
    """Write a design over an operating range into a folder or a JSON file; return the paths.

    The folder must exist. Its files are design.json, network.npz and family.png. Raises
    `OutputError` if a file cannot be written.
    """
    written = _written(_family_dict(designed), designed.network, folder, json_file)
    if folder is None:
        return written
    progress("drawing")
    return [*written, plotting.save(plotting.family(designed), folder / "family.png")]


def _family_dict(designed: FamilyDesign) -> dict[str, Any]:
    """Return ranges, gains, settled fraction, settling and failing inputs for JSON."""
    names = [neuron.name for neuron in designed.network.cell.neurons]
    found = designed.validation
    return {
        "network": designed.network.title,
        "ranges": designed.family.ranges,
        "preconditioner": designed.winner.gain_rule.kind.value,
        "points": designed.points,
        "rho": dict(zip(names, designed.gains.rho)),
        "rate": dict(zip(names, designed.gains.rate)),
        "held_out": len(found),
        "certified": int(found.certified.sum()),
        "share": found.share,
        "interval": found.interval if found.drawn else None,
        "settling": {
            "median": found.settling_quantile(0.5),
            "99 of 100": found.settling_quantile(0.99),
            "worst": found.settling_quantile(1.0),
        },
        "reasons": dict(Counter(failure.name.lower() for failure in found.failures.values())),
        "failures": [
            {
                "reason": failure.value,
                "inputs": found.samples[number],
            }
            for number, failure in found.failures.items()
        ],
    }
