"""The metrics of studies by name: unit, definition, function; and a user's own."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from ann_dc.errors import StudyError
from ann_dc.study.keeping.rows import Value
from ann_dc.study.measuring.definitions import (
    accuracy_floor,
    active_rows,
    certified,
    control_error,
    control_overshoot,
    control_settling_time,
    energy,
    kkt_residual,
    largest_step,
    measured_decay_rate,
    neurons,
    objective,
    power,
    predicted_decay_rate,
    predicted_settling_time,
    resting_decay_rate,
    seconds,
    settling_in_fastest,
    settling_steps,
    settling_time,
    slowest_mode_seconds,
    spectral_ratio,
    steps,
    theta_growth,
    theta_rising,
    verified_settling_time,
)
from ann_dc.study.measuring.sample import Sample

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
