"""Results of a study as records: limits, causes of outcomes, predictions, exponents, outliers.

An exponent is the slope of log(metric) over log(setting), fitted by least squares to all cases with
both values. Its interval is Student's at 95 %. Variation of other settings counts as scatter.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ann_dc.report.study_columns import Column
from ann_dc.study.exponents import FEWEST, Exponent, exponent_of

MOST = 14
"""Largest number of distinguished causes."""
DECADE = 10.0
"""Ratio that the values of a setting must span for an exponent."""
PREDICTED = "predicted_"
"""Prefix of metrics that predict another one."""
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")


class Limit(NamedTuple):
    """One limit of a specification: `low` and `high` of a metric's column, infinite if open."""

    column: Column
    low: float
    high: float

    @property
    def ends(self) -> tuple[float, ...]:
        """Finite limits."""
        return tuple(end for end in (self.low, self.high) if np.isfinite(end))

    @property
    def met(self) -> np.ndarray:
        """Mask (rows,) of records within the limits; nan is outside."""
        numbers = self.column.as_numbers
        return (numbers >= self.low) & (numbers <= self.high)

    @property
    def beyond(self) -> np.ndarray:
        """Excess (rows,) over the limit in the metric's unit.

        Negative inside; nan without a number.
        """
        numbers = self.column.as_numbers
        return np.maximum(self.low - numbers, numbers - self.high)

    def __str__(self) -> str:
        unit = f" {self.column.unit}" if self.column.unit else ""
        if not np.isfinite(self.low):
            return f"{self.column.name} \N{LESS-THAN OR EQUAL TO} {self.high:.6g}{unit}"
        if not np.isfinite(self.high):
            return f"{self.column.name} \N{GREATER-THAN OR EQUAL TO} {self.low:.6g}{unit}"
        return f"{self.column.name} in {self.low:.6g} to {self.high:.6g}{unit}"


class Cause(NamedTuple):
    """Cases with the same outcome for the same reason.

    `points` is the number of cases; `row` and `message` belong to an example.
    """

    outcome: str
    points: int
    row: int
    message: str


class Prediction(NamedTuple):
    """Metric `measured` with the metric `predicted` (``x`` with ``predicted_x``)."""

    measured: Column
    predicted: Column

    @property
    def errors(self) -> np.ndarray:
        """Values of |predicted / measured - 1| of the records that have both."""
        measured, predicted = self.measured.as_numbers, self.predicted.as_numbers
        both = self.measured.finite & self.predicted.finite & (measured != 0)
        return np.abs(predicted[both] / measured[both] - 1)


class Growth(NamedTuple):
    """Power law metric ~ setting^p with its exponent."""

    metric: Column
    setting: Column
    exponent: Exponent


class Outliers(NamedTuple):
    """Title and `rows` of the largest values of a column, or farthest outside a limit."""

    title: str
    column: Column
    rows: np.ndarray


def causes_of(outcomes: Iterable[str], messages: Iterable[str]) -> list[Cause]:
    """Return the outcomes (rows,) by cause, most frequent first.

    Messages that differ only in numbers have one cause. Causes beyond the first ones are merged
    into one with their count.

    Examples
    --------
    >>> [cause] = causes_of(["failed"] * 2, ["no gain at 1.5", "no gain at 2"])
    >>> cause
    Cause(outcome='failed', points=2, row=0, message='no gain at 1.5')
    """
    found: dict[tuple[str, str], Cause] = {}
    for row, (outcome, message) in enumerate(zip(outcomes, messages)):
        key = outcome, _NUMBER.sub("#", message)
        known = found.get(key) or Cause(outcome, 0, row, message)
        found[key] = known._replace(points=known.points + 1)
    ordered = sorted(found.values(), key=lambda cause: -cause.points)
    rest = ordered[MOST:]
    if not rest:
        return ordered
    points = sum(cause.points for cause in rest)
    return [*ordered[:MOST], rest[0]._replace(outcome=f"{len(rest)} further causes", points=points)]


def predictions_of(metrics: Iterable[Column]) -> list[Prediction]:
    """Return the metrics that have predictions with values in common cases."""
    names = {metric.name: metric for metric in metrics if metric.numbers is not None}
    pairs = (
        Prediction(metric, names[PREDICTED + name])
        for name, metric in names.items()
        if PREDICTED + name in names
    )
    return [pair for pair in pairs if (pair.measured.finite & pair.predicted.finite).any()]


def exponents_of(metrics: Iterable[Column], settings: Iterable[Column]) -> list[Growth]:
    """Return the exponents of metrics over settings that span a decade, clearest first."""
    wide = [s for s in settings if s.spans >= DECADE and len(s.distinct) >= FEWEST]
    fits = (fit(metric, setting) for metric in metrics for setting in wide)
    return sorted((one for one in fits if one is not None), key=lambda one: -one.exponent.r_squared)


def fit(metric: Column, setting: Column) -> Growth | None:
    """Fit a metric over a numeric setting; None for too few or constant values."""
    if metric.numbers is None or len(metric.distinct) < 2:
        return None
    found = exponent_of(setting.as_numbers, metric.numbers)
    return None if np.isnan(found.value) else Growth(metric, setting, found)


def outliers_of(title: str, about: Limit | Column, most: int) -> Outliers | None:
    """Return the records of largest excess or value; None if the metric does not vary."""
    column = about.column if isinstance(about, Limit) else about
    values = about.beyond if isinstance(about, Limit) else about.numbers
    if values is None or len(column.distinct) < 2:
        return None
    known = np.flatnonzero(~np.isnan(values))  # what is infinite is worst
    rows = known[np.argsort(-values[known], kind="stable")[:most]]
    return Outliers(title, column, rows) if len(rows) else None
