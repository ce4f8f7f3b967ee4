"""What a circuit will do, before ngspice runs it: stability, error and settling time.

The emulation of a circuit is a network, so its eigenvalues are those of the pole model, its
equilibrium is the circuit's, and its run in continuous time is the circuit's transient.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.backends.ode import BDF, DOP853, OdeBackend
from ann_dc.backends.run import Run
from ann_dc.backends.settling import control_settling
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.specimen import Specimen
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.parts.conditions import NOMINAL
from ann_dc.hardware.parts.levels import Level
from ann_dc.hints.checked import checked

TRANSIENT = OdeBackend(method=DOP853, verify=False, limit=1e6, most_steps=30_000)
"""The emulation's run: its fastest poles are those of multipliers, far from the slowest."""

LARGEST = 3000
"""Neurons of an emulation up to which its transient is run."""

LOST = (Outcome.DIVERGED, Outcome.LEFT_DOMAIN)
"""Ends of a transient that leads nowhere."""

ELSEWHERE = 0.01
"""Distance of controls, over the largest one, from which on a transient has settled elsewhere."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Prediction:
    """What the emulation of a circuit says.

    Attributes
    ----------
    control_error : float
        Of the settled controls against the ideal network's, over the largest one.
    settling_time : float
        Seconds until every control stays within 0.1 %; nan where it never does, where a margin is
        so large that the transient takes too many steps, and above `LARGEST` neurons.
    spectrum : Spectrum
        Eigenvalues of the pole model at the settled point, per unit of network time.
    astray : str
        Where the transient leads instead of the settled point, in a clause; empty where it does
        not, and where it is not run to its end.
    """

    control_error: float
    settling_time: float
    spectrum: Spectrum
    astray: str = ""

    @property
    def stable(self) -> bool:
        """Whether the settled point attracts."""
        return self.spectrum.abscissa < 0


class Reason(enum.Enum):
    """Why there is no prediction."""

    LEVEL = "the level has no emulation"
    NO_EQUILIBRIUM = "the circuit has no equilibrium near the ideal one"
    CLIPPED = "the circuit settles at its rails"


@dataclass(frozen=True, kw_only=True)
class Unpredicted:
    """That there is no prediction, why, and the sentence that says so.

    Attributes
    ----------
    reason : Reason
        For programs.
    sentence : str
        For people: what is the matter with this circuit.
    """

    reason: Reason
    sentence: str

    def __str__(self) -> str:
        return self.sentence

    @property
    def error(self) -> NetworkError:
        """The same as an error; where Newton's method failed, its own."""
        of_newton = self.reason is Reason.NO_EQUILIBRIUM
        return NetworkError(self.sentence if of_newton else f"prediction: {self.sentence}")


CLIPPED = Unpredicted(
    reason=Reason.CLIPPED,
    sentence="parts of the settled circuit stand at their rails; give it more headroom or a "
    "smaller full scale",
)


@checked
def predict(
    circuit: Circuit, level: Level, probe: Trajectory, deviations: Deviations | None = None
) -> Prediction:
    """Predict a circuit's run.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What it is built of.
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.
    deviations : mapping of parameter name to (N,) array, optional
        Which parts are off by how much.

    Returns
    -------
    Prediction

    Raises
    ------
    NetworkError
        If the circuit has no emulation, no equilibrium near the ideal one, or settles clipped.

    Examples
    --------
    >>> from ann_dc.fidelity import predict
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> found = predict(circuit, level, probe)
    >>> found.stable, found.control_error < 1e-3, 1e-5 < found.settling_time < 1e-3
    (True, True, True)
    """
    specimen = Specimen(circuit=circuit, level=level, probe=probe, deviations=deviations or {})
    found = prediction_of(specimen)
    if isinstance(found, Unpredicted):
        raise found.error
    return found


@checked
def prediction_of(specimen: Specimen) -> Prediction | Unpredicted:
    """The same of a specimen, whose emulation and equilibrium serve other questions, too.

    Returns
    -------
    Prediction or Unpredicted
        The latter says why there is none.

    Raises
    ------
    NetworkError
        If a deviation is out of its range.
    """
    missing = not_emulated(specimen)
    if missing is not None:
        return missing
    network, settling, lost = specimen.emulation.network, float("nan"), ""
    try:
        found = spectrum(network, specimen.settled)
    except NetworkError as error:
        return Unpredicted(reason=Reason.NO_EQUILIBRIUM, sentence=str(error))
    if found.abscissa < 0 and network.size <= LARGEST:
        run = transient_of(specimen)
        ended = run.status.outcome not in LOST
        if ended and _clipped(specimen.emulation, run.trajectory.final):
            return CLIPPED
        lost = astray_of(specimen, run)
        if run.status.settled and not lost:
            settling = specimen.circuit.scaling.time * control_settling(run.trajectory)
    return Prediction(
        control_error=specimen.control_error, settling_time=settling, spectrum=found, astray=lost
    )


def transient_of(
    specimen: Specimen,
    most_steps: int = TRANSIENT.most_steps,
    start: np.ndarray | None = None,
) -> Run:
    """The run of a circuit's emulation from reset, or from another start.

    Parameters
    ----------
    specimen : Specimen
    most_steps : int
        After which it is given up.
    start : (n,) array, optional
        State of the emulation; that in which reset switches hold the circuit where none is given.
    """
    backend = replace(_transient(specimen.circuit), most_steps=most_steps)
    network = specimen.emulation.network
    return backend.run(network if start is None else network.with_start(start))


def astray_of(specimen: Specimen, run: Run) -> str:
    """Where a transient leads instead of the circuit's settled point, in a clause.

    Parameters
    ----------
    specimen : Specimen
    run : Run
        Of its emulation.

    Returns
    -------
    str
        Empty where it leads there, and where it ends before that is known.

    Raises
    ------
    NetworkError
        If the circuit has no equilibrium near the ideal one.
    """
    if run.status.outcome in LOST:
        return f"its transient {run.status}"
    emulation = specimen.emulation
    wanted = emulation.controls(specimen.settled)
    off = np.abs(emulation.controls(run.trajectory.final) - wanted).max() / np.abs(wanted).max()
    if run.status.settled and off > ELSEWHERE:
        return f"its transient settles elsewhere, a control off by {off:.2g} of the largest one"
    return ""


def not_emulated(specimen: Specimen) -> Unpredicted | None:
    """Why a specimen's level has no emulation where it stands; None where it has one.

    Parameters
    ----------
    specimen : Specimen
    """
    level = specimen.level
    sentence = f"{level.name} circuits are not emulated"
    if level.emulated and level.transistors and level.conditions != NOMINAL:
        sentence = f"{level.name} circuits are emulated in a room only, at nominal supplies"
    elif level.emulated:
        return None
    return Unpredicted(reason=Reason.LEVEL, sentence=sentence)


def _transient(circuit: Circuit) -> OdeBackend:
    """What runs an emulation: implicitly, where nodes of a grid are far faster than the rest."""
    return replace(TRANSIENT, method=BDF, limit=1e9) if circuit.conductances else TRANSIENT


def is_clipped(specimen: Specimen) -> bool:
    """Whether a part of the settled circuit stands at its rails.

    Parameters
    ----------
    specimen : Specimen
    """
    return _clipped(specimen.emulation, specimen.settled)


def _clipped(emulation: Emulation, x: np.ndarray) -> bool:
    """Whether a part stands at its rails; neurons may stand at theirs."""
    network = emulation.network
    low, high = evaluator(network).tape.limits[network.places[:, 0]].T
    return bool((((x <= low) | (x >= high)) & emulation.clips).any())
