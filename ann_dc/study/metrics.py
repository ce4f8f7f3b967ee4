"""Metrics of studies by name, with unit, definition and function.

Times are in unit time constants (network time s) unless stated otherwise. A metric that is
undefined for a sample raises `StudyError` and is nan in the table.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.predicted_settling import predicted_settling
from ann_dc.backends.decay import decay_rate
from ann_dc.backends.ode import COMPILED, OdeBackend
from ann_dc.backends.overshoot import overshoot
from ann_dc.backends.settling import Settling
from ann_dc.backends.tracking import tracking_error as tracked
from ann_dc.errors import StudyError
from ann_dc.network.network import COORDINATION
from ann_dc.study.records import Value
from ann_dc.study.sample import Sample

TIGHT = OdeBackend(method=COMPILED.tighter(), verify=False)
"""Backend with tight tolerances that verifies settling times."""
TAIL = (1e3, 0.1)
"""Begin and end of the tail of a run, in multiples of the residual tolerance."""
ACTIVE = 1e-6
"""Threshold of an active multiplier, in network units (scale near one) or relative to the largest
multiplier if that exceeds one.
"""
FALLEN = float(np.log(1e3))
"""Time constants in which a mode decays to 0.1 %."""
UNIT_TIME = "unit time constants"


@dataclass(frozen=True, kw_only=True)
class Metric:
    """Quantity that is measured in every case.

    Attributes
    ----------
    definition : str
        Definition in one sentence.
    value : callable
        Function of a sample that returns a number or a boolean. A store identifies a metric by its
        name, so a changed function requires a new folder.
    curves : bool
        True if the metric reads the trajectory.
    """

    name: str
    unit: str = ""
    definition: str = ""
    value: Callable[[Sample], Value]
    curves: bool = False


METRICS: dict[str, Metric] = {}
"""Metrics by name."""


def metric_of(value: Callable[[Sample], Value], unit: str = "", *, curves: bool = False) -> Metric:
    """Return the metric of a function: its name, and its docstring as a noun phrase on one line.

    >>> metric_of(neurons).definition
    'Number of moving neurons.'
    """
    text = " ".join((value.__doc__ or "").split())
    noun = text.removeprefix("Return ").removeprefix("the ")
    definition = noun[:1].upper() + noun[1:]
    return Metric(name=value.__name__, unit=unit, definition=definition, value=value, curves=curves)


def _metric(unit: str = "", *, curves: bool = False) -> Callable[[Any], Any]:
    """Enter the decorated function into `METRICS`; its docstring is the definition."""

    def entered(value: Callable[[Sample], Value]) -> Callable[[Sample], Value]:
        METRICS[value.__name__] = metric_of(value, unit, curves=curves)
        return value

    return entered


@_metric(UNIT_TIME)
def settling_time(sample: Sample) -> float:
    """Return the last exit of the relative KKT residual from the tolerance.

    For a circuit the controls count instead, with 0.1 % of their size, as in
    `control_settling_time`.
    """
    return sample.settling_time


@_metric(UNIT_TIME, curves=True)
def control_settling_time(sample: Sample) -> float:
    """Return the last exit of the controls from 0.1 % of their size around their end.

    The size is the largest final magnitude, but at least 1 % of the largest magnitude of the run.
    """
    return sample.control_settling_time


def _tolerance(sample: Sample) -> float:
    """Return the residual tolerance of the run."""
    return float(sample.setting.get("run.tolerance") or Settling().tolerance)


def _refuse_oracle(sample: Sample) -> None:
    if sample.setting.get("design.form") == "S16":
        raise StudyError("the gain (33) of S16 is not a gain of the network")


@_metric(UNIT_TIME)
def verified_settling_time(sample: Sample) -> float:
    """Return the settling time of the same network at 100 times tighter tolerances."""
    _refuse_oracle(sample)
    backend = replace(TIGHT, settling=Settling(tolerance=_tolerance(sample)))
    return backend.run(sample.network).settling_time


@_metric(UNIT_TIME)
def predicted_settling_time(sample: Sample) -> float:
    """Return the settling time predicted from the final modes and 160 steps to them."""
    _refuse_oracle(sample)
    settled_state = equilibrium(sample.network, sample.state)
    start = sample.network.start_state
    return predicted_settling(sample.network, settled_state, start, _tolerance(sample))


@_metric(UNIT_TIME)
def largest_step(sample: Sample) -> float:
    """Return the largest stable step of a Jacobi recurrence at the final state.

    The step is the least 2a / (a^2 + b^2) over the eigenvalues -a +- ib.
    """
    return sample.spectrum.largest_step


@_metric("tau_min")
def normalised_settling_time(sample: Sample) -> float:
    """Return the settling time times the largest final absolute eigenvalue."""
    return sample.settling_time * sample.spectrum.radius


@_metric("1 / unit time constant", curves=True)
def measured_decay_rate(sample: Sample) -> float:
    """Return the decay rate of the residual in the tail of the run (least squares)."""
    high, low = (share * _tolerance(sample) for share in TAIL)
    return decay_rate(sample.trajectory, high, low)


@_metric("1 / unit time constant")
def predicted_decay_rate(sample: Sample) -> float:
    """Return the distance of the rightmost final eigenvalue from the imaginary axis."""
    return -sample.spectrum.abscissa


@_metric("1 / unit time constant")
def resting_decay_rate(sample: Sample) -> float:
    """Return the decay rate at the equilibrium near the design; negative if unstable.

    The rate is the negative spectral abscissa and does not depend on the end of the run.
    """
    return -sample.equilibrium_spectrum.abscissa


@_metric("relative to the largest control", curves=True)
def control_overshoot(sample: Sample) -> float:
    """Return the excess of controls over their end, relative to the largest end."""
    return overshoot(sample.trajectory)


@_metric("relative to the largest control")
def control_error(sample: Sample) -> float:
    """Return the largest final control error against the ideal network, over the size.

    The size of the controls is the largest magnitude at the ideal end, but at least 1 % of the
    largest magnitude of the run.
    """
    right, size = sample.right_controls
    return float(np.abs(sample.controls - right).max() / size)


@_metric("relative to the largest control", curves=True)
def tracking_error(sample: Sample) -> float:
    """Return the rms control error against the optimum of the moment, over the run's second half.

    The inputs of the network change over time. The optimum is that of the ideal network.
    """
    return tracked(sample.trajectory, ideal=sample.ideal[0]).rms


@_metric("relative to the range")
def accuracy_floor(sample: Sample) -> float:
    """Return the largest component of the Newton step to the optimum, over its range."""
    return sample.certificate.newton_step


@_metric("s", curves=True)
def seconds(sample: Sample) -> float:
    """Return the seconds until the circuit controls stay within 0.1 % of their size.

    The criterion is that of `control_settling_time`. For a network that runs in addition to a
    circuit, the time scaling of the circuit applies.
    """
    return sample.seconds


@_metric("s")
def slowest_mode_seconds(sample: Sample) -> float:
    """Return the seconds in which the slowest mode of the circuit decays to 0.1 %.

    The modes are those of the emulated circuit. The value is infinite if its equilibrium is
    unstable.
    """
    abscissa = sample.spectrum.abscissa
    time = sample.built.circuit.scaling.time
    return FALLEN * time / -abscissa if abscissa < 0 else float("inf")


@_metric("W")
def power(sample: Sample) -> float:
    """Return the power of the op amps and multipliers of the circuit, in watts.

    Raises `StudyError` if the model level does not define the power.
    """
    watts = sample.built.power
    if np.isnan(watts):
        raise StudyError(
            "the level does not state the power of its parts; see circuit.amplifier_power"
        )
    return watts


@_metric("J", curves=True)
def energy(sample: Sample) -> float:
    """Return the energy of a solve in joules: power times seconds."""
    return power(sample) * sample.seconds


@_metric()
def spectral_ratio(sample: Sample) -> float:
    """Return the stiffness ratio: largest absolute eigenvalue over slowest decay rate."""
    modes = sample.spectrum
    return modes.radius / -modes.abscissa if modes.abscissa < 0 else float("inf")


def _theta(sample: Sample) -> np.ndarray:
    """Return Theta (T,) of (19), half of the squared errors of t and beta from their end.

    The result is in squared network units, see paper equation (19).
    """
    if not sample.settled:
        raise StudyError("Theta is the distance to the settled state, and the run did not settle")
    trajectory = sample.trajectory
    coordinating = trajectory.network.of_population(*COORDINATION)
    error = trajectory.states[:, coordinating] - trajectory.final[coordinating]
    return 0.5 * (error**2).sum(axis=1)


@_metric(curves=True)
def theta_growth(sample: Sample) -> float:
    """Return the largest Theta of (19) over its initial value; 1 if it only decreases."""
    theta = _theta(sample)
    return float(theta.max() / theta[0]) if theta[0] > 0 else float("nan")


@_metric(curves=True)
def theta_rising(sample: Sample) -> float:
    """Return the fraction of the fall of log Theta undone by rises; 0 without rises."""
    theta = _theta(sample)
    steps = np.diff(np.log(theta[(theta > 1e-12 * theta[0]) & (theta > 0)]))
    falling = -steps[steps < 0].sum()
    return float(steps[steps > 0].sum() / falling) if falling > 0 else float("nan")


@_metric()
def objective(sample: Sample) -> float:
    """Return the total cost E at the end, in user units."""
    return sample.certificate.objective


@_metric()
def kkt_residual(sample: Sample) -> float:
    """Return the relative KKT residual of the problem at the end, from exact derivatives.

    The residual of `settling_time` is that of the network, which differs with non-idealities.
    """
    return sample.certificate.kkt_residual


@_metric()
def certified(sample: Sample) -> bool:
    """Return True if the run settled at an optimum of first and second order."""
    return sample.settled and sample.certificate.certified


@_metric()
def active_rows(sample: Sample) -> int:
    """Return the number of active inequalities and of controls at a bound at the end."""
    network, state = sample.ideal
    values = network.unpack(state)
    diodes = values[[network.neuron_index[d.neuron] for d in network.cell.inequality_duals]]
    active = int((diodes > ACTIVE * diodes.max(initial=1.0)).sum())
    for row, neuron in enumerate(network.cell.neurons):
        if neuron.population == "u":
            limits = neuron.limiter
            active += int(((values[row] <= limits.low) | (values[row] >= limits.high)).sum())
    return active


@_metric()
def neurons(sample: Sample) -> int:
    """Return the number of moving neurons."""
    return sample.network.size


@_metric()
def steps(sample: Sample) -> Value:
    """Return the number of steps of the integration or recurrence."""
    return sample.end.steps


@_metric()
def settling_steps(sample: Sample) -> Value:
    """Return the number of steps to the last exit of the residual.

    A recurrence is checked every five steps.
    """
    return sample.end.settling_steps


DEFAULT = ("settling_time", "control_error")


def metrics_of(given: Iterable[str | Metric]) -> tuple[Metric, ...]:
    """Return metrics by name; `Metric` objects are passed through.

    Raises `StudyError` for an unknown name, with the nearest and all names.

    >>> [metric.unit for metric in metrics_of(["seconds", "energy"])]
    ['s', 'J']
    """
    metrics = tuple(replace(_known(metric)) for metric in given)
    if not metrics:
        raise StudyError("metrics: expected one or more; METRICS lists all")
    names = [metric.name for metric in metrics]
    if len(set(names)) < len(names):
        raise StudyError(f"metrics: duplicate name in {', '.join(names)}")
    return metrics


def _known(metric: object) -> Metric:
    if isinstance(metric, Metric):
        return metric
    if not isinstance(metric, str):
        raise StudyError(f"metrics: expected names, or a Metric, got {metric!r}")
    if metric not in METRICS:
        near = difflib.get_close_matches(metric, METRICS, n=2, cutoff=0.5)
        hint = f"; did you mean {' or '.join(near)}?" if near else "."
        raise StudyError(f"metrics: unknown metric {metric!r}{hint} There are {', '.join(METRICS)}")
    return METRICS[metric]
