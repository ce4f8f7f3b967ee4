"""The metrics of studies by name: unit, definition, function; and a user's own.

Times are in unit time constants of the network where nothing else is said. What has no meaning at
a point raises a `StudyError`, and is nan in the table.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.predicted_settling import predicted_settling
from ann_dc.backends.decay import decay_rate
from ann_dc.backends.ode import COMPILED, OdeBackend
from ann_dc.backends.overshoot import overshoot
from ann_dc.backends.settling import Settling
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import StudyError
from ann_dc.network.network import COORDINATION
from ann_dc.study.records import Value
from ann_dc.study.sample import Sample

# ---- what is measured at the points of a study, one function each; its first sentence defines it

TIGHT = OdeBackend(method=COMPILED.tighter(), verify=False)
"""Runs by which settling times are verified."""
TAIL = (1e3, 0.1)
"""Begin and end of the tail of a run, in tolerances."""
ACTIVE = 1e-6
"""Multiplier above which one counts: in network units, where it is near one, or of the largest."""
FALLEN = float(np.log(1e3))
"""Time constants in which a mode falls to 0.1 %."""


def settling_time(sample: Sample) -> float:
    """Last exit of the relative KKT residual from above the tolerance (of a circuit: of the
    controls from 0.1 % of their size, as `control_settling_time`)."""
    return sample.settling_time


def settling_in_fastest(sample: Sample) -> float:
    """The settling time times the largest absolute eigenvalue at the end."""
    return sample.settling_time * sample.spectrum.radius


def control_settling_time(sample: Sample) -> float:
    """Last exit of the controls from 0.1 % of their size around their end, which is the largest
    magnitude there, and at least 1 % of the largest on the way."""
    return sample.control_settling_time


def verified_settling_time(sample: Sample) -> float:
    """The settling time in a run of the same network at 100 times tighter tolerances."""
    _refuse_oracle(sample)
    backend = replace(TIGHT, settling=Settling(tolerance=_tolerance(sample)))
    return backend.run(sample.network).settling_time


def predicted_settling_time(sample: Sample) -> float:
    """The settling time that the modes where it ended tell, with 160 steps of the way there."""
    _refuse_oracle(sample)
    rest = equilibrium(sample.network, sample.state)
    return predicted_settling(sample.network, rest, sample.start, _tolerance(sample))


def _tolerance(sample: Sample) -> float:
    """On the residual of the run."""
    return float(sample.setting.get("run.tolerance") or Settling().tolerance)


def _refuse_oracle(sample: Sample) -> None:
    if sample.setting.get("design.form") == "S16":
        raise StudyError("the gain (33) of S16 is none of the network's, which this looks at")


def measured_decay_rate(sample: Sample) -> float:
    """Rate at which the residual falls in the tail of the run, by least squares."""
    high, low = (share * _tolerance(sample) for share in TAIL)
    return decay_rate(sample.trajectory, high, low)


def predicted_decay_rate(sample: Sample) -> float:
    """Distance of the rightmost eigenvalue at the end from the imaginary axis."""
    return -sample.spectrum.abscissa


def resting_decay_rate(sample: Sample) -> float:
    """The same at the equilibrium near the designed point, whether or not the run came there:
    negative where the optimum repels."""
    return -sample.resting.abscissa


def spectral_ratio(sample: Sample) -> float:
    """Largest absolute eigenvalue over the slowest decay: stiffness of the settled network."""
    found = sample.spectrum
    return found.radius / -found.abscissa if found.abscissa < 0 else float("inf")


def largest_step(sample: Sample) -> float:
    """Largest stable step of a recurrence, all neurons at once, where it ended: the least 2a /
    (a^2 + b^2) over the eigenvalues -a +- ib."""
    return sample.spectrum.largest_step


def control_overshoot(sample: Sample) -> float:
    """Return the excess of controls over their end, over the largest of their ends."""
    return overshoot(sample.trajectory)


def theta_over_time(trajectory: Trajectory) -> np.ndarray:
    r"""Theta of (19) along a run: half of the squared errors of t and beta from their end.

    Parameters
    ----------
    trajectory : Trajectory
        Of a network with a coordination level.

    Returns
    -------
    (T,) array
        In squared network units.

    References
    ----------
    Paper equation (19).
    """
    told = trajectory.network.of_population(*COORDINATION)
    error = trajectory.states[:, told] - trajectory.final[told]
    return 0.5 * (error**2).sum(axis=1)


def _theta(sample: Sample) -> np.ndarray:
    if not sample.settled:
        raise StudyError("Theta is the distance from where it settles, and it did not")
    return theta_over_time(sample.trajectory)


def theta_growth(sample: Sample) -> float:
    """Largest Theta of (19) on the way over Theta at the start; 1 where it only falls."""
    theta = _theta(sample)
    return float(theta.max() / theta[0]) if theta[0] > 0 else float("nan")


def theta_rising(sample: Sample) -> float:
    """Share of the fall of log Theta that its rises take back; 0 where it only falls."""
    theta = _theta(sample)
    steps = np.diff(np.log(theta[(theta > 1e-12 * theta[0]) & (theta > 0)]))
    falling = -steps[steps < 0].sum()
    return float(steps[steps > 0].sum() / falling) if falling > 0 else float("nan")


def control_error(sample: Sample) -> float:
    """Largest error of a control at the end against the ideal network's, over their size: the
    largest magnitude at that end, and at least 1 % of the largest on the way."""
    right, size = sample.right_controls
    return float(np.abs(sample.controls - right).max() / size)


def accuracy_floor(sample: Sample) -> float:
    """Largest component of the Newton step from the end to the optimum, over its range."""
    return sample.certificate.newton_step


def objective(sample: Sample) -> float:
    """Total cost E at the end, in the user's units."""
    return sample.certificate.objective


def kkt_residual(sample: Sample) -> float:
    """Relative first-order residual at the end, from the problem's exact derivatives."""
    return sample.certificate.kkt_residual


def certified(sample: Sample) -> bool:
    """Tell if a run settled at an optimum of both orders."""
    return sample.settled and sample.certificate.certified


def active_rows(sample: Sample) -> int:
    """Inequalities with a multiplier, and controls at a bound, at the end."""
    network, state = sample.ideal
    values = network.unpack(state)
    diodes = values[[network.neuron_index[d.neuron] for d in network.cell.diodes]]
    active = int((diodes > ACTIVE * diodes.max(initial=1.0)).sum())
    for row, neuron in enumerate(network.cell.neurons):
        if neuron.population == "u":
            limits = neuron.limiter
            active += int(((values[row] <= limits.low) | (values[row] >= limits.high)).sum())
    return active


def neurons(sample: Sample) -> int:
    """Neurons that move."""
    return sample.network.size


def steps(sample: Sample) -> Value:
    """Steps of the integration, or of the recurrence."""
    return sample.steps


def settling_steps(sample: Sample) -> Value:
    """Those of them up to the last exit of the residual; a recurrence is looked at every five."""
    return sample.settling_steps


def seconds(sample: Sample) -> float:
    """Seconds until the controls stay within 0.1 % of their size (`control_settling_time`), in the
    circuit; of a network that runs beside one, in its scaling of time."""
    return sample.seconds


def slowest_mode_seconds(sample: Sample) -> float:
    """Seconds in which the slowest mode of the emulated circuit falls to 0.1 %; infinite where its
    settled point repels."""
    abscissa = sample.spectrum.abscissa
    time = sample.built.circuit.scaling.time
    return FALLEN * time / -abscissa if abscissa < 0 else float("inf")


def power(sample: Sample) -> float:
    """Watts of the op amps and multipliers of the circuit.

    Raises
    ------
    StudyError
        If the level does not say.
    """
    found = sample.built.power
    if np.isnan(found):
        raise StudyError("the level does not say what its parts draw; see circuit.amplifier_power")
    return found


def energy(sample: Sample) -> float:
    """Joules of a solve: power times seconds."""
    return power(sample) * sample.seconds


# ---- the metrics of studies by name: unit, definition, function; and a user's own

UNIT_TIME = "unit time constants"


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A number that is measured at every point.

    Attributes
    ----------
    name : str
    unit : str
    definition : str
        In a sentence.
    value : callable
        Of a sample; a number, or True and False. A store knows a metric by its name: where the
        function changes, begin a new folder.
    curves : bool
        Whether it reads what happened over time.
    """

    name: str
    unit: str = ""
    definition: str = ""
    value: Callable[[Sample], Value]
    curves: bool = False


_CURVES = (
    control_settling_time,
    measured_decay_rate,
    control_overshoot,
    theta_growth,
    theta_rising,
    seconds,
    energy,
)
_UNITS: dict[str, tuple[Callable[[Sample], Value], ...]] = {
    UNIT_TIME: (
        settling_time,
        control_settling_time,
        verified_settling_time,
        predicted_settling_time,
        largest_step,
    ),
    "fastest time constants": (settling_in_fastest,),
    "1 / unit time constant": (
        measured_decay_rate,
        predicted_decay_rate,
        resting_decay_rate,
    ),
    "share of the size of the controls": (control_overshoot, control_error),
    "share of a range": (accuracy_floor,),
    "s": (seconds, slowest_mode_seconds),
    "W": (power,),
    "J": (energy,),
    "": (
        spectral_ratio,
        theta_growth,
        theta_rising,
        objective,
        kkt_residual,
        certified,
        active_rows,
        neurons,
        steps,
        settling_steps,
    ),
}
METRICS: dict[str, Metric] = {
    value.__name__: Metric(
        name=value.__name__,
        unit=unit,
        definition=" ".join((value.__doc__ or "").split("\n\n")[0].split()),
        value=value,
        curves=value in _CURVES,
    )
    for unit, values in _UNITS.items()
    for value in values
}
"""Every metric by its name."""
DEFAULT = ("settling_time", "control_error")


def metrics_of(given: Iterable[str | Metric]) -> tuple[Metric, ...]:
    """Metrics by their names, or a user's own.

    Parameters
    ----------
    given : iterable of str or Metric

    Returns
    -------
    tuple of Metric

    Raises
    ------
    StudyError
        If there is none of that name; with the nearest ones, and all.

    Examples
    --------
    >>> [metric.unit for metric in metrics_of(["seconds", "energy"])]
    ['s', 'J']
    """
    found = []
    for metric in given:
        if isinstance(metric, Metric):
            found.append(metric)
            continue
        if not isinstance(metric, str):
            raise StudyError(f"metrics: expected names, or a Metric of your own, got {metric!r}")
        if metric not in METRICS:
            near = difflib.get_close_matches(metric, METRICS, n=2, cutoff=0.5)
            hint = f"; did you mean {' or '.join(near)}?" if near else "."
            raise StudyError(
                f"metrics: there is no {metric!r}{hint} There are {', '.join(METRICS)}"
            )
        found.append(METRICS[metric])
    if not found:
        raise StudyError("metrics: name one at least; METRICS has all")
    names = [metric.name for metric in found]
    if len(set(names)) < len(names):
        raise StudyError(f"metrics: one is named twice in {', '.join(names)}")
    return tuple(replace(metric) for metric in found)
