"""Rows of the report of a circuit that runs for a given duration."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ann_dc.backends.spice.circuit_run import CircuitRun
from ann_dc.evaluation.rules import NEAR
from ann_dc.fidelity.circuit_study import CircuitStudy
from ann_dc.fidelity.waveform_prediction import final_difference, follows_until
from ann_dc.report.json_file import picked
from ann_dc.si_prefixes import engineering

NEAR_TEXT = f"{100 * NEAR:.0f} %"
"""Largest error of a circuit near the optimum, in words."""


def waveform_errors(found: CircuitStudy) -> dict[str, tuple[str, str, str]]:
    """Return the errors of the waveforms in ngspice and as predicted, with their references."""
    measured, predicted = measured_waveforms(found), predicted_waveforms(found)
    mean = "-" if measured is None else f"{math.sqrt(measured['mean_square_error']):.1e}"
    both = [_errors(each) for each in (measured, predicted)]
    finals, times = zip(*both)
    return {
        "final error": (*finals, f"largest of the {found.terms}, relative to the largest, "
                        "against the ODE"),
        "accurate until": (*times, f"unit time constants: {found.terms} within {NEAR_TEXT} of "
                           "the ODE"),
        "trajectory error": (mean, "-", "rms, relative to the rms value of the ODE"),
    }  # fmt: skip


def waveform_rows(found: CircuitStudy) -> dict[str, object]:
    """Return the duration and the checks of a circuit that runs for a given duration."""
    rows: dict[str, object] = {"duration": _length(found)}
    if predicted_waveforms(found) is None:
        rows["prediction"] = f"not available: {found.unpredicted}"
    if np.isfinite(found.final_difference):
        rows["difference"] = (
            f"{found.final_difference:.1e} between the final {found.terms} of ngspice and "
            "prediction, relative to the largest"
        )
    return rows | ({} if found.run is None else {"overload": overloads(found.run)})


def overloads(run: CircuitRun) -> str:
    """Return the overloaded nodes of a simulation, the worst first."""
    return "; ".join(map(str, run.overloads[:3])) or "none"


def _length(found: CircuitStudy) -> str:
    """Return the duration of a circuit's run in network time and in seconds."""
    end, unit = float(found.probe.time[-1]), found.circuit.scaling.time
    return f"{end:.6g} unit time constants, {engineering(unit * end, 's')}"


def _errors(waveforms: dict[str, float] | None) -> tuple[str, str]:
    """Return the final error and the time until which the ODE is followed."""
    if waveforms is None:
        return "-", "-"
    until = waveforms["follows_until"]
    return f"{waveforms['final_error']:.1e}", f"{until:.4g}" if math.isfinite(until) else "the end"


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
