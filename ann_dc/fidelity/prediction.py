"""Prediction of a circuit by emulation: stability, error and settling time.

The emulation of a circuit is a network: its eigenvalues are those of the pole model, its
equilibrium is that of the circuit, and its run in continuous time is the transient.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.run import Run
from ann_dc.backends.status import DAMPING, Outcome
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.circuit_instance import CircuitInstance, settling_of, transient_of
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.parts.conditions import NOMINAL
from ann_dc.hardware.parts.levels import Level
from ann_dc.si_prefixes import engineering
from ann_dc.validation import checked

LARGEST = 6000
"""Largest number of emulation neurons for which the transient is run."""

NAMED = 3
"""Largest number of clipping parts that are named."""

LOST = (Outcome.DIVERGED, Outcome.LEFT_DOMAIN)
"""Outcomes of a transient that does not reach an equilibrium."""

ELSEWHERE = 0.01
"""Relative distance of the controls from which a transient counts as another equilibrium."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """Prediction of a circuit by its emulation.

    Attributes
    ----------
    final : (m,) array
        Settled controls, or all settled states of a network without controls, in network units.
    control_error : float
        Error of the settled controls against the ideal network's, relative to the largest control.
    settling_time : float
        Time in seconds until every control stays within 0.1 %; nan if ``unknown`` gives a reason.
    spectrum : Spectrum
        Eigenvalues of the pole model at the settled point, per unit of network time. For a clocked
        circuit, those of its recurrence, as rates.
    other_equilibrium : str
        Other equilibrium to which the transient leads, or that it does not settle, as a clause.
        Empty if it reaches the settled point or is not run.
    unknown : str
        Reason for a missing settling time, as a clause; otherwise empty.
    """

    final: np.ndarray
    control_error: float
    settling_time: float
    spectrum: Spectrum
    other_equilibrium: str = ""
    unknown: str = ""

    @property
    def stable(self) -> bool:
        """True if the settled point is stable."""
        return self.spectrum.abscissa < 0


REPELS = "its equilibrium is unstable"
"""Reason for which a circuit that oscillates has no predicted settling time."""

CLOCKED = "it is not a network in continuous time; use the recurrent layer"
"""Reason for which a clocked circuit has no predicted settling time."""


class Reason(enum.Enum):
    """Reason for a missing prediction."""

    LEVEL = "the level has no emulation"
    NO_EQUILIBRIUM = "the circuit has no equilibrium near the ideal one"
    CLIPPED = "the circuit settles at its output limits"
    LOST = "the emulation cannot be run for the duration"


@dataclass(frozen=True, kw_only=True)
class Unpredicted:
    """Missing prediction: a machine-readable reason and a message for the user."""

    reason: Reason
    sentence: str

    def __str__(self) -> str:
        return self.sentence

    @property
    def error(self) -> NetworkError:
        """Reason as an exception; that of Newton's method if the method failed."""
        of_newton = self.reason is Reason.NO_EQUILIBRIUM
        return NetworkError(self.sentence if of_newton else f"prediction: {self.sentence}")


@checked
def predict(
    circuit: Circuit, level: Level, probe: Trajectory, deviations: Deviations | None = None
) -> Prediction:
    """Predict stability, error and settling time of a circuit.

    Parameters
    ----------
    circuit : Circuit
        Circuit with nominal components.
    level : Level
        Level of the parts.
    probe : Trajectory
        Run of the ideal network by which the circuit was scaled.
    deviations : mapping of parameter name to (N,) array, optional
        Deviations of the parts. Default: none.

    Raises
    ------
    NetworkError
        If the circuit has no emulation, no equilibrium near the ideal one, or settles clipped.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import predict
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> found = predict(circuit, level, probe)
    >>> found.stable, found.control_error < 1e-3, 1e-5 < found.settling_time < 1e-3
    (True, True, True)
    """
    instance = CircuitInstance(
        circuit=circuit, level=level, probe=probe, deviations=deviations or {}
    )
    found = prediction_of(instance)
    if isinstance(found, Unpredicted):
        raise found.error
    return found


@checked
def prediction_of(instance: CircuitInstance) -> Prediction | Unpredicted:
    """Predict a circuit instance, reusing its emulation and equilibrium.

    The result is `Unpredicted` with the reason if there is no prediction. Raises `NetworkError` if
    a deviation is out of its range.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import CircuitInstance, prediction_of
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> prediction_of(CircuitInstance(circuit=circuit, level=level, probe=probe)).stable
    True
    """
    missing = not_emulated(instance)
    if missing is not None:
        return missing
    try:
        off, modes = instance.control_error, instance.modes
    except NetworkError as error:
        return Unpredicted(reason=Reason.NO_EQUILIBRIUM, sentence=str(error))
    reported = Prediction(
        final=instance.settled_controls,
        control_error=off,
        settling_time=float("nan"),
        spectrum=modes,
    )
    if why := untimed(instance):
        return replace(reported, unknown=why)
    if not reported.stable:
        return replace(reported, unknown=REPELS)
    return _timed(reported, instance, transient_of(instance))


def _timed(reported: Prediction, instance: CircuitInstance, run: Run) -> Prediction | Unpredicted:
    """Return a prediction completed with the result of its transient."""
    if run.status.outcome not in LOST and clipped_at(instance.moving, run.trajectory.final).any():
        return clipping_of(instance, instance.moving, run.trajectory.final)
    if lost := other_equilibrium_of(instance, run):
        return replace(reported, other_equilibrium=lost, unknown=lost)
    if not run.status.settled:
        open_end = slew_limited(instance) or f"its transient {_told(run)}"
        return replace(reported, other_equilibrium=open_end, unknown=open_end)
    return replace(reported, settling_time=settling_of(instance, run))


def other_equilibrium_of(instance: CircuitInstance, run: Run) -> str:
    """Return, as a clause, the other equilibrium to which a transient leads.

    The clause is empty if the run reaches the settled point, or ends before this is known.
    """
    if run.status.outcome in LOST:
        return f"its transient {run.status}"
    wanted = instance.emulation.controls(instance.settled)
    found = instance.moving.controls(run.trajectory.final)
    off = np.abs(found - wanted).max() / size_of(wanted, instance.probe.control_reach)
    if run.status.settled and off > ELSEWHERE:
        size = instance.probe.size_in_words
        return (
            f"its transient settles at another equilibrium, with a control error of {off:.2g} "
            f"of {size}"
        )
    return ""


def not_emulated(instance: CircuitInstance) -> Unpredicted | None:
    """Return the reason for which a circuit instance has no emulation, or None."""
    level = instance.level
    sentence = f"{level.name} circuits are not emulated"
    if level.emulated and level.transistors and level.conditions != NOMINAL:
        sentence = (
            f"{level.name} circuits are emulated at room temperature and nominal supplies only"
        )
    elif level.emulated or level.technology.clocked:
        return None
    return Unpredicted(reason=Reason.LEVEL, sentence=sentence)


def require_emulation(instance: CircuitInstance, topic: str) -> None:
    """Raise `NetworkError`, beginning with the topic, if a circuit has no emulation."""
    if missing := not_emulated(instance):
        raise NetworkError(f"{topic}: {missing}")


def untimed(instance: CircuitInstance) -> str:
    """Return the reason, as a clause, for which no transient is run, or ""."""
    if instance.level.technology.clocked:
        return CLOCKED
    size = instance.emulation.network.size
    return f"{size} neurons are more than {LARGEST}" if size > LARGEST else ""


def clipped_at(emulation: Emulation, x: np.ndarray) -> np.ndarray:
    """Return booleans (n,) that mark clipped parts; saturated neurons do not count."""
    low, high = _output_limits(emulation)
    return ((x <= low) | (x >= high)) & emulation.clips


def clipping_of(instance: CircuitInstance, emulation: Emulation, x: np.ndarray) -> Unpredicted:
    """Return a message on the clipped parts of a circuit, with the required headroom.

    `x` (n,) is a state of the emulation, settled with clipped parts.
    """
    network, clipped = emulation.network, np.flatnonzero(clipped_at(emulation, x))
    rails = _output_limits(emulation)[1]
    limits = {
        (network.cell.neurons[row].name, int(stage)): rails[i]
        for i in clipped
        for row, stage in [network.places[i]]
    }
    names = ", ".join(f"{name} of cell {stage}" for name, stage in [*limits][:NAMED])
    more = f" and {len(limits) - NAMED} more" if len(limits) > NAMED else ""
    sentence = f"parts of the settled circuit are at their output limits: {names}{more}; "
    return Unpredicted(reason=Reason.CLIPPED, sentence=sentence + _cure(instance, limits))


def _cure(instance: CircuitInstance, limits: Mapping[tuple[str, int], float]) -> str:
    """Return advice for clipped parts, from a transient without output limits."""
    level = instance.level
    endless = replace(level.datasheet, output_swing=np.inf, multiplier_output_swing=np.inf)
    free = replace(instance, level=replace(level, datasheet=endless))
    run = transient_of(free)
    if not run.status.settled:
        if slow := slew_limited(free):
            return f"without output limits, {slow}"
        return f"more headroom does not help: without output limits, its transient {_told(run)}"
    network, final = free.moving.network, free.moving.network.unpack(run.trajectory.final)
    share = max(
        abs(final[network.neuron_index[name], stage]) / rail
        for (name, stage), rail in limits.items()
    )
    if share <= 1:
        return (
            "without output limits it settles within them: the limits act during the "
            "transient; use another initial guess"
        )
    return (
        f"use more headroom or a smaller full scale: {1.1 * share:.2g} times the headroom is "
        "sufficient"
    )


def _told(run: Run) -> str:
    """Return the status without advice on the weights, which a designed network determines."""
    return str(run.status).removesuffix(f"; {DAMPING}")


def slew_limited(instance: CircuitInstance) -> str:
    """Return the slew rate as the cause of a transient that does not settle, with a remedy.

    The clause is empty if the transient does not settle without slew limits either.
    """
    level, scaling = instance.level, instance.circuit.scaling
    slew = level.datasheet.slew
    if not np.isfinite(slew):
        return ""
    endless = replace(level, datasheet=replace(level.datasheet, slew=np.inf))
    if not transient_of(replace(instance, level=endless)).status.settled:
        return ""
    return (
        f"the slew rate of {engineering(slew, 'V/s', 3)} prevents it from settling (without slew "
        f"limits it settles); raise the bandwidth margin above {scaling.bandwidth_margin:.3g} "
        "(--bandwidth-margin), reduce the full scale, or use op amps with a higher slew rate"
    )


def _output_limits(emulation: Emulation) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest values of the state components, (n,) each."""
    network = emulation.network
    low, high = evaluator(network).tape.limits[network.places[:, 0]].T
    return low, high
