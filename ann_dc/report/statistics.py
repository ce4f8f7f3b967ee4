"""What a study found, as its page needs it: what was asked, the table, and some curves."""

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
"""Points whose curves a page shows."""
LOOKED_AT = 2000
"""Points that are asked for curves at most."""

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
    """What a study found.

    Attributes
    ----------
    place : str
        The folder of its store, as a command names it.
    identity : mapping
        What was asked: title, subject, over, fixed, metrics, settings, spec, seed.
    frame : pandas.DataFrame
        A row a point.
    curves : mapping of int to mapping of str to array (m,)
        Of some points: values over time, by name.
    """

    place: str
    identity: Mapping[str, Any]
    frame: Any
    curves: Mapping[int, Mapping[str, np.ndarray]] = field(default_factory=dict)

    @classmethod
    def of(cls, store: Store) -> Findings:
        """What a store holds.

        Parameters
        ----------
        store : Store

        Raises
        ------
        PandasMissing
            If pandas is not installed.
        """
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
        """What the study is called."""
        return str(self.identity.get("title") or "Study")

    @cached_property
    def columns(self) -> Mapping[str, Column]:
        """All columns, by name."""
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
        """Columns that were measured, in the order of the study."""
        asked = self.identity.get("metrics") or {}
        return tuple(self.columns[name] for name in asked if name in self.columns)

    @cached_property
    def settings(self) -> tuple[Column, ...]:
        """Columns that were set."""
        others = {*HEAD, *TAIL, *(metric.name for metric in self.metrics)}
        return tuple(column for name, column in self.columns.items() if name not in others)

    @cached_property
    def varied(self) -> tuple[Column, ...]:
        """Settings that are not the same at all points."""
        return tuple(column for column in self.settings if len(column.distinct) > 1)

    @property
    def seconds(self) -> Column | None:
        """What the points took."""
        return self.columns.get(SECONDS)

    @cached_property
    def points(self) -> np.ndarray:
        """Numbers of the points, a row each."""
        return self.frame[POINT].to_numpy()

    def repeating(self, row: int) -> str:
        """The command that repeats the point of a row.

        Parameters
        ----------
        row : int
        """
        return f"{self.command} --point {self.points[row]}"

    @property
    def command(self) -> str:
        """The command that runs this study, without a point."""
        return f"ann-dc study {shlex.quote(self.place)}"


def _some_curves(store: Store, points: Iterable[int]) -> dict[int, Mapping[str, np.ndarray]]:
    """Curves of some points, spread over those that keep any."""
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
