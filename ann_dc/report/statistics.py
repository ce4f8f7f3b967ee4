"""Data of a study page with all statistics, each computed at most once.

An exponent is the slope of log(metric) over log(setting), fitted by least squares to all cases with
both values. Its interval is Student's at 95 %. Variation of other settings counts as scatter.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ann_dc.report.study_columns import Column, column_of
from ann_dc.study.exponents import FEWEST, Exponent, exponent_of
from ann_dc.study.records import HEAD, MESSAGE, OUTCOME, POINT, SECONDS, TAIL
from ann_dc.study.store import Store
from ann_dc.study.yield_metrics import SETTLED, draws_of
from ann_dc.yields import Yield, ends_of

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


def _causes_of(outcomes: Iterable[str], messages: Iterable[str]) -> list[Cause]:
    """Return the outcomes (rows,) by cause, most frequent first.

    Messages that differ only in numbers have one cause. Causes beyond the first ones are merged
    into one with their count.

    Examples
    --------
    >>> [cause] = _causes_of(["failed"] * 2, ["no gain at 1.5", "no gain at 2"])
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


def _predictions_of(metrics: Iterable[Column]) -> list[Prediction]:
    """Return the metrics that have predictions with values in common cases."""
    names = {metric.name: metric for metric in metrics if metric.numbers is not None}
    pairs = (
        Prediction(metric, names[PREDICTED + name])
        for name, metric in names.items()
        if PREDICTED + name in names
    )
    return [pair for pair in pairs if (pair.measured.finite & pair.predicted.finite).any()]


def _exponents_of(metrics: Iterable[Column], settings: Iterable[Column]) -> list[Growth]:
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


KEPT = 60
"""Cases whose trajectories a page shows."""
LOOKED_AT = 2000
"""Largest number of cases that are searched for trajectories."""
WORST_FOR = 6
"""Number of metrics with a list of worst cases."""
MOST_LISTED = 20
"""Largest number of values of a setting with one yield each."""
STANDING_OUT = 8
"""Number of cases listed as slowest, or as worst for a metric."""

SAYS = {
    "point": ("", "Number of the case, in the order of the design."),
    "seed": ("", "Seed of all random numbers of the case."),
    "outcome": ("", "Outcome of the run."),
    "message": ("", "Status message with names and numbers."),
    "wall_time": ("s", "Execution time of the case."),
    "worker": ("", "Process that ran the case."),
    "host": ("", "Machine that ran the case."),
    "versions": ("", "Software versions of the run."),
}
"""Unit and meaning of the columns that every study has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """Data of a study for its page.

    `identity` is the declaration: title, subject, vary, fixed, metrics, settings, spec, seed. The
    pandas `frame` has one row per case, and `curves` has trajectories (m,) of some cases by name.
    """

    place: str
    identity: Mapping[str, Any]
    frame: Any
    curves: Mapping[int, Mapping[str, np.ndarray]] = field(default_factory=dict)

    @classmethod
    def of(cls, store: Store) -> Findings:
        """Return the data of a store; raise `PandasMissing` if pandas is not installed."""
        frame = store.to_frame()
        curves = _some_curves(store, frame[POINT]) if store.identity.get("curves") else {}
        place = str(store.folder)
        return cls(place=place, identity=store.identity, frame=frame, curves=curves)

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def title(self) -> str:
        """Title of the study."""
        return str(self.identity.get("title") or "Study")

    @cached_property
    def columns(self) -> Mapping[str, Column]:
        """Columns by name."""
        reported = dict(self.identity.get("settings") or {}) | dict(
            self.identity.get("metrics") or {}
        )
        found = {}
        for name in self.frame.columns:
            unit, says = SAYS.get(name, ("", ""))
            words = reported.get(name) or {}
            unit = str(words.get("unit") or unit)
            says = str(words.get("definition") or words.get("says") or says)
            found[name] = column_of(name, self.frame[name], unit=unit, says=says)
        return found

    @cached_property
    def metrics(self) -> tuple[Column, ...]:
        """Measured columns, in the order of the study."""
        asked = self.identity.get("metrics") or {}
        return tuple(self.columns[name] for name in asked if name in self.columns)

    @cached_property
    def varied(self) -> tuple[Column, ...]:
        """Settings that differ between cases."""
        others = {*HEAD, *TAIL, *(metric.name for metric in self.metrics)}
        settings = (column for name, column in self.columns.items() if name not in others)
        return tuple(column for column in settings if len(column.distinct) > 1)

    @property
    def seconds(self) -> Column | None:
        """Wall time of the cases, in seconds."""
        return self.columns.get(SECONDS)

    @cached_property
    def points(self) -> np.ndarray:
        """Case number of each record."""
        return self.frame[POINT].to_numpy()

    @property
    def command(self) -> str:
        """Command that runs this study, without a case number."""
        return f"ann-dc study {shlex.quote(self.place)}"

    @property
    def retrying(self) -> str:
        """Command that runs the cases without a result again."""
        return f"ann-dc study FILE.toml --output {shlex.quote(self.place)} --retry"

    def repeating(self, row: int) -> str:
        """Return the command that repeats the case of a record."""
        return f"{self.command} --point {self.points[row]}"

    @cached_property
    def limits(self) -> tuple[Limit, ...]:
        """Limits of the specification whose metrics were measured."""
        spec = (self.identity.get("spec") or {}).items()
        known = self.columns
        return tuple(Limit(known[name], *ends_of(limit)) for name, limit in spec if name in known)

    def limit_of(self, metric: Column) -> Limit | None:
        """Return the limit of a metric in the specification."""
        return next((limit for limit in self.limits if limit.column is metric), None)

    @cached_property
    def settled(self) -> np.ndarray:
        """Mask (rows,) of settled cases."""
        outcome = self.columns.get(OUTCOME)
        if outcome is None or outcome.codes is None:
            return np.zeros(len(self), bool)
        return np.array([word == SETTLED for word in outcome.words], bool)[outcome.codes]

    @cached_property
    def within(self) -> np.ndarray:
        """Mask (rows,) of settled cases that satisfy every limit."""
        return np.logical_and.reduce([self.settled, *(limit.met for limit in self.limits)])

    @cached_property
    def yields(self) -> list[tuple[str, Yield]]:
        """Yields of settled cases, of each limit and of all; empty without limits."""
        if not self.limits:
            return []
        masks = [("settled", self.settled)]
        masks += [(f"settled, {limit}", self.settled & limit.met) for limit in self.limits]
        masks += [("total", self.within)] if len(self.limits) > 1 else []
        draws = draws_of(self._cells)
        return [(name, _yield_of(good, draws)) for name, good in masks]

    @cached_property
    def yields_by_value(self) -> list[tuple[str, Yield]]:
        """Yields of every value of each listed setting; empty without limits or lists."""
        lists = self.identity.get("vary") or {}
        columns = (c for c in self.varied if isinstance(lists.get(c.name), (list, tuple)))
        listed = (c for c in columns if self.limits and len(c.distinct) <= MOST_LISTED)
        return [
            (f"{one.name} = {value}", self.yield_among(rows))
            for one in listed
            for value, rows in one.by_value()
        ]

    def yield_among(self, rows: np.ndarray) -> Yield:
        """Return the yield of selected records with its confidence interval."""
        draws = draws_of({name: cells[rows] for name, cells in self._cells.items()})
        return _yield_of(self.within[rows], draws)

    @cached_property
    def _cells(self) -> dict[str, np.ndarray]:
        return {name: self.frame[name].to_numpy() for name in self.frame.columns}

    @cached_property
    def causes(self) -> list[Cause]:
        """Outcomes by cause, most frequent first."""
        return _causes_of(*(self._texts(name) for name in (OUTCOME, MESSAGE)))

    def _texts(self, name: str) -> Iterable[str]:
        if name not in self.frame.columns:
            return [""] * len(self)
        return self.frame[name].astype(object).fillna("").astype(str).tolist()

    @cached_property
    def predictions(self) -> list[Prediction]:
        """Metrics that have predictions."""
        return _predictions_of(self.metrics)

    @cached_property
    def exponents(self) -> list[Growth]:
        """Exponents of metrics over settings, clearest first."""
        return _exponents_of(self.metrics, self.varied)

    @cached_property
    def outliers(self) -> list[Outliers]:
        """Slowest cases, and the worst ones by limit or else by metric."""
        limited = [limit.column for limit in self.limits]
        about = [(f"Farthest outside, or nearest to, {limit}", limit) for limit in self.limits]
        about += [(f"Largest {m.name}", m) for m in self.metrics if m not in limited]
        about = about[:WORST_FOR]
        about = [*([("Slowest", self.seconds)] if self.seconds else []), *about]
        found = (outliers_of(title, one, STANDING_OUT) for title, one in about)
        return [one for one in found if one is not None]


def _yield_of(good: np.ndarray, draws: int | None) -> Yield:
    return Yield(passed=int(good.sum()), count=len(good), draws=draws)


def _some_curves(store: Store, points: Iterable[int]) -> dict[int, Mapping[str, np.ndarray]]:
    """Return trajectories of some cases, spread over those with stored ones."""
    numbers = np.asarray(points)
    spread = np.random.default_rng(0).permutation(len(numbers))[:LOOKED_AT]
    found: dict[int, Mapping[str, np.ndarray]] = {}
    for row in spread:
        kept = store.curves(int(numbers[row]))
        if kept:
            found[int(numbers[row])] = kept
        if len(found) == KEPT:
            break
    return dict(sorted(found.items()))
