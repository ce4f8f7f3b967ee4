"""Rows of the report of a circuit that runs for a given duration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rich.text import Text

from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.evaluation.rules import NEAR
from ann_dc.fidelity.circuit_study import CircuitStudy
from ann_dc.fidelity.waveform_prediction import final_difference, follows_until
from ann_dc.report.json_file import picked
from ann_dc.si_prefixes import engineering


def waveform_rows(found: CircuitStudy) -> dict[str, object]:
    """Return the rows on the waveforms of a circuit, in ngspice and as predicted."""
    rows: dict[str, object] = {"outcome": "not simulated"}
    measured, predicted = measured_waveforms(found), predicted_waveforms(found)
    if found.run is not None and measured is not None:
        rows = {
            "outcome": Text("completed", "green"),
            "duration": _length(found),
            "ngspice": _sentence(found, measured),
            "trajectory": f"rms error {math.sqrt(measured['mean_square_error']):.1e} of the ODE's "
            "rms value",
            "overload": overloads(found.run),
        }
    nothing = f"nothing: {found.unpredicted}"
    rows["predicted"] = nothing if predicted is None else _sentence(found, predicted)
    if np.isfinite(found.final_difference):
        rows["difference"] = (
            f"final {found.terms} of ngspice and prediction differ by "
            f"{found.final_difference:.1e} of the largest"
        )
    return rows


def overloads(run: CircuitRun) -> str:
    """Return the overloaded nodes of a simulation, the worst first."""
    return "; ".join(map(str, run.overloads[:3])) or "none"


def _length(found: CircuitStudy) -> str:
    """Return the duration of a circuit's run in network time and in seconds."""
    end, unit = float(found.probe.time[-1]), found.circuit.scaling.time
    return f"{end:.6g} unit time constants, {engineering(unit * end, 's')}"


def _sentence(found: CircuitStudy, waveforms: dict[str, float]) -> str:
    """Return the final error against the ODE, and the time until which it is followed."""
    error, until = waveforms["final_error"], waveforms["follows_until"]
    away = f"within {NEAR:.0%} of them all the way"
    if math.isfinite(until):
        away = f"within {NEAR:.0%} of them until {until:.4g} unit time constants"
    return f"final {found.terms} {error:.1e} of the largest off the ODE's, {away}"


def measured_waveforms(found: CircuitStudy) -> dict[str, float] | None:
    """Return the errors of the waveforms in ngspice; None without a simulation."""
    if found.run is None:
        return None
    trajectory = found.run.trajectory
    controls = trajectory.control_values
    return {
        "final_error": final_difference(controls[-1], found.probe),
        "follows_until": follows_until(found.probe, trajectory.time, controls),
        "mean_square_error": found.run.mean_square_error,
    }


def predicted_waveforms(found: CircuitStudy) -> dict[str, float] | None:
    """Return the errors of the predicted waveforms; None without a prediction."""
    return found.waveforms and picked(found.waveforms, "final_error", "follows_until")


def waveform_dict(found: CircuitStudy) -> dict[str, Any]:
    """Return the same figures for the JSON file."""
    return {
        "outcome": None if found.run is None else "completed",
        "duration": float(found.probe.time[-1]),
        "overloads": [str(overload) for overload in found.run.overloads] if found.run else [],
        "measured": measured_waveforms(found),
        "predicted": predicted_waveforms(found),
        "final_difference": found.final_difference,
    }
