"""The table of a study: a row a point, with its setting, its outcome and what was measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ann_dc.errors import UnknownNameError
from ann_dc.hints.checked import checked
from ann_dc.study.keeping.rows import FAILED, LOST, OUTCOME, TIMED_OUT, Row, Value
from ann_dc.study.keeping.store import Store
from ann_dc.study.measuring.yields import Limit, Yield, yield_of

NO_RESULT = (FAILED, TIMED_OUT, LOST)
"""Outcomes of points that have no result."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Rows of a study, in the order of its points.

    Attributes
    ----------
    columns : tuple of str
    rows : tuple of dict of str to Value
    spec : mapping of metric to Limit
        Of the study.
    """

    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    spec: Mapping[str, Any]

    @classmethod
    def of(cls, store: Store) -> Table:
        """All that a store holds.

        Parameters
        ----------
        store : Store
        """
        spec = store.identity.get("spec", {})
        return cls(columns=tuple(store.columns), rows=tuple(store.rows()), spec=spec)

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, column: str) -> np.ndarray:
        """A column: numbers, nan where there is none, or words."""
        self._check(column)
        values = [row.get(column) for row in self.rows]
        if any(isinstance(value, str) for value in values):
            return np.array(["" if value is None else str(value) for value in values])
        return np.array([np.nan if value is None else value for value in values], float)

    def _check(self, column: str) -> None:
        if column not in self.columns:
            raise UnknownNameError.of("column", column, self.columns)

    @property
    def outcomes(self) -> dict[str, int]:
        """How many rows ended how, most frequent first."""
        return dict(Counter(str(row.get(OUTCOME)) for row in self.rows).most_common())

    @property
    def is_complete(self) -> bool:
        """Whether every point has a result, whatever it is."""
        return not any(row.get(OUTCOME) in NO_RESULT for row in self.rows)

    def by(self, column: str) -> dict[Value, Table]:
        """Its rows by what a column says, in the order in which that is met.

        Parameters
        ----------
        column : str

        Returns
        -------
        dict of Value to Table

        Raises
        ------
        UnknownNameError
            If there is no such column.
        """
        self._check(column)
        found: dict[Value, list[Row]] = {}
        for row in self.rows:
            found.setdefault(row.get(column), []).append(row)
        return {value: replace(self, rows=tuple(rows)) for value, rows in found.items()}

    def yield_of(self, spec: Mapping[str, Any] | None = None) -> Yield:
        """The share of rows that settled and keep a spec, that of the study by default.

        Parameters
        ----------
        spec : mapping of metric to Limit, optional

        Returns
        -------
        Yield
        """
        limits: Mapping[str, Limit] = self.spec if spec is None else spec
        return yield_of(self.rows, limits)
