"""Prediction of a circuit whose network does not settle: the waveforms of its emulation.

The emulation runs from reset for the duration of the circuit. Its waveforms include the lags,
finite gains and offsets of the parts, so they differ from those of the ideal network. On a limit
cycle or a chaotic attractor the differences grow, and the circuit follows the ideal network for a
limited time only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ann_dc.backends.ode import LSODA, OdeBackend
from ann_dc.backends.run import Run
from ann_dc.backends.spice.circuit_run import states_of
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.evaluation.rules import NEAR
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.prediction import CLOCKED, LARGEST, Reason, Unpredicted, not_emulated

METHOD = replace(LSODA, rtol=1e-9, atol=1e-12)
"""Integration method: poles of parts are 100,000 times as fast as the network."""

MOST_STEPS = 300_000
"""Largest number of steps of an emulated run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveformPrediction:
    """Predicted waveforms of a circuit over a given duration.

    Attributes
    ----------
    run : Run
        Run of the emulation, in units of the ideal network.
    final : (m,) array
        Controls at its end, or all states of a network without controls.
    final_error : float
        Largest difference of `final` from the ideal network's, relative to the largest value of a
        control on the way.
    follows_until : float
        Network time from which a control differs by more than 1 % of this value; see
        `follows_until`.
    """

    run: Run
    final: np.ndarray
    final_error: float
    follows_until: float


def predicted_waveforms(instance: CircuitInstance) -> WaveformPrediction | Unpredicted:
    """Run the emulation of a circuit for the duration of its probe run."""
    probe = instance.probe
    if missing := _not_run(instance):
        return missing
    emulation = instance.moving
    duration = float(probe.time[-1])
    backend = OdeBackend(method=METHOD, duration=duration, most_steps=MOST_STEPS, verify=False)
    run = backend.run(emulation.network)
    if not (run.status.outcome is Outcome.COMPLETED or run.status.settled):
        sentence = f"the emulation cannot be run for {duration:g}: {run.status}"
        return Unpredicted(reason=Reason.LOST, sentence=sentence)
    controls = emulation.controls(run.trajectory.states)
    return WaveformPrediction(
        run=run,
        final=controls[-1],
        final_error=final_difference(controls[-1], probe),
        follows_until=follows_until(probe, run.trajectory.time, controls),
    )


def final_difference(controls: np.ndarray, probe: Trajectory) -> float:
    """Return the largest difference of controls (m,) from those at the end of the ideal run.

    The reference is the largest control of the ideal run.
    """
    end = control_values(probe.network, probe.final)
    return float(np.abs(controls - end).max() / probe.control_reach)


def follows_until(
    probe: Trajectory, time: np.ndarray, controls: np.ndarray, share: float = NEAR
) -> float:
    """Return the network time from which controls (T, m) leave those of the ideal run.

    The result is the first of the times (T,) at which a control differs by more than the fraction
    ``share`` of the largest control of the ideal run, and infinite if none does.
    """
    wanted = control_values(probe.network, states_of(probe, time))
    away = np.abs(controls - wanted).max(axis=1) > share * probe.control_reach
    return float(time[away.argmax()]) if away.any() else np.inf


def _not_run(instance: CircuitInstance) -> Unpredicted | None:
    """Return the reason for which no emulation can be run, or None."""
    if missing := not_emulated(instance):
        return missing
    sentence, waveforms = "", instance.probe.network.waveforms
    if instance.level.technology.clocked:
        sentence = CLOCKED
    elif waveforms:
        sentence = (
            f"inputs {', '.join(waveforms)} change over time, which the emulation does not support"
        )
    elif (size := instance.emulation.network.size) > LARGEST:
        sentence = f"{size} neurons are more than {LARGEST}"
    return Unpredicted(reason=Reason.LEVEL, sentence=sentence) if sentence else None
