"""Data of a study page: study declaration, table and selected trajectories."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ann_dc.errors import PandasMissing
from ann_dc.report.study_columns import Column, column_of
from ann_dc.study.records import HEAD, POINT, SECONDS, TAIL
from ann_dc.study.store import Store

KEPT = 24
"""Cases whose trajectories a page shows."""
LOOKED_AT = 2000
"""Largest number of cases that are searched for trajectories."""

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
        Declaration: title, subject, over, fixed, metrics, settings, spec, seed.
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
        try:
            import pandas  # noqa: F401
        except ImportError as error:
            raise PandasMissing(
                "the page of a study needs pandas: pip install 'ann-dc[study]'"
            ) from error
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
    def settings(self) -> tuple[Column, ...]:
        """Columns of settings."""
        others = {*HEAD, *TAIL, *(metric.name for metric in self.metrics)}
        return tuple(column for name, column in self.columns.items() if name not in others)

    @cached_property
    def varied(self) -> tuple[Column, ...]:
        """Settings that differ between cases."""
        return tuple(column for column in self.settings if len(column.distinct) > 1)

    @property
    def seconds(self) -> Column | None:
        """Wall time of the cases, in seconds."""
        return self.columns.get(SECONDS)

    @cached_property
    def points(self) -> np.ndarray:
        """Case number of each record."""
        return self.frame[POINT].to_numpy()

    def repeating(self, row: int) -> str:
        """Return the command that repeats the case of a record."""
        return f"{self.command} --point {self.points[row]}"

    @property
    def command(self) -> str:
        """Command that runs this study, without a case number."""
        return f"ann-dc study {shlex.quote(self.place)}"


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
