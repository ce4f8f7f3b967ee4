"""Data of a study page: declaration, table and selected trajectories, with all statistics.

Every statistic is computed at most once, when it is first read.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ann_dc.report.study_columns import Column, column_of
from ann_dc.report.study_results import (
    Cause,
    Growth,
    Limit,
    Outliers,
    Prediction,
    causes_of,
    exponents_of,
    outliers_of,
    predictions_of,
)
from ann_dc.study.records import HEAD, MESSAGE, OUTCOME, POINT, SECONDS, TAIL
from ann_dc.study.store import Store
from ann_dc.study.yield_metrics import SETTLED, draws_of
from ann_dc.yields import Yield, ends_of

KEPT = 24
"""Cases whose trajectories a page shows."""
LOOKED_AT = 2000
"""Largest number of cases that are searched for trajectories."""
WORST_FOR = 6
"""Number of metrics with a list of worst cases."""
STANDING_OUT = 8
"""Number of cases listed as slowest, or as worst for a metric."""

SAYS = {
    "point": ("", "Number of the point, in the order of the design."),
    "seed": ("", "Of all that was drawn there."),
    "outcome": ("", "How it ended."),
    "message": ("", "How it ended, in a sentence with names and numbers."),
    "wall_time": ("s", "Time that the point took on the machine that ran it."),
    "worker": ("", "Which process ran it."),
    "host": ("", "Which machine ran it."),
    "versions": ("", "What it was run with."),
}
"""Unit and meaning of the columns that every study has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """Data of a study for its page.

    Attributes
    ----------
    place : str
        Folder of the store, as named in a command.
    identity : mapping
        Declaration: title, subject, vary, fixed, metrics, settings, spec, seed.
    frame : pandas.DataFrame
        One row per case.
    curves : mapping of int to mapping of str to array (m,)
        Trajectories of some cases by name.
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
        told = dict(self.identity.get("settings") or {}) | dict(self.identity.get("metrics") or {})
        found = {}
        for name in self.frame.columns:
            unit, says = SAYS.get(name, ("", ""))
            words = told.get(name) or {}
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
        return f"ann-dc study FILE.toml --out {shlex.quote(self.place)} --retry"

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
        masks += [("all of it", self.within)] if len(self.limits) > 1 else []
        return [(name, self._yield_of(good, self._draws)) for name, good in masks]

    def yield_among(self, rows: np.ndarray) -> Yield:
        """Return the yield of selected records with its confidence interval."""
        draws = draws_of({name: cells[rows] for name, cells in self._cells.items()})
        return self._yield_of(self.within[rows], draws)

    def _yield_of(self, good: np.ndarray, draws: int | None) -> Yield:
        return Yield(passed=int(good.sum()), count=len(good), draws=draws)

    @cached_property
    def _cells(self) -> dict[str, np.ndarray]:
        return {name: self.frame[name].to_numpy() for name in self.frame.columns}

    @cached_property
    def _draws(self) -> int | None:
        return draws_of(self._cells)

    @cached_property
    def causes(self) -> list[Cause]:
        """Outcomes by cause, most frequent first."""
        return causes_of(*(self._texts(name) for name in (OUTCOME, MESSAGE)))

    def _texts(self, name: str) -> Iterable[str]:
        if name not in self.frame.columns:
            return [""] * len(self)
        return self.frame[name].astype(object).fillna("").astype(str).tolist()

    @cached_property
    def predictions(self) -> list[Prediction]:
        """Metrics that have predictions."""
        return predictions_of(self.metrics)

    @cached_property
    def exponents(self) -> list[Growth]:
        """Exponents of metrics and wall time over settings, clearest first."""
        seconds = () if self.seconds is None else (self.seconds,)
        return exponents_of((*self.metrics, *seconds), self.varied)

    @cached_property
    def outliers(self) -> list[Outliers]:
        """Slowest cases, and the worst ones by limit or else by metric."""
        limited = [limit.column for limit in self.limits]
        about = [(f"Furthest out of, or nearest to, {limit}", limit) for limit in self.limits]
        about += [(f"Largest {m.name}", m) for m in self.metrics if m not in limited]
        about = about[:WORST_FOR]
        about = [*([("Slowest", self.seconds)] if self.seconds else []), *about]
        found = (outliers_of(title, one, STANDING_OUT) for title, one in about)
        return [one for one in found if one is not None]


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
