"""The table of a study: a column a setting, a metric, the outcome; a row a point."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ann_dc.errors import PandasMissing, UnknownNameError
from ann_dc.study.records import FAILED, LOST, OUTCOME, TIMED_OUT, Row, Value
from ann_dc.study.store import Store
from ann_dc.study.yield_metrics import yield_of
from ann_dc.validation.checked import checked
from ann_dc.yields import Limit, Yield

NO_RESULT = (FAILED, TIMED_OUT, LOST)
"""Outcomes of points that have no result."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Rows of a study, in the order of its points.

    Attributes
    ----------
    columns : mapping of str to (rows,) array
        Numbers, nan where there is none; or words, empty where there is none.
    spec : mapping of metric to Limit
        Of the study.
    stopped : str
        Why it ended before the last point was done; empty if it did not.

    Examples
    --------
    >>> outcomes = np.array(["settled", "settled", "failed"])
    >>> table = Table(columns={"neurons": np.full(3, 96.0), "outcome": outcomes}, spec={})
    >>> table.outcomes, print(table.yield_of())
    66.7 % (9.4 to 99.2 %, 2 of 3)
    ({'settled': 2, 'failed': 1}, None)
    """

    columns: Mapping[str, Any]
    spec: Mapping[str, Any]
    stopped: str = ""

    @classmethod
    def of(cls, store: Store, *, stopped: str = "") -> Table:
        """All that a store holds.

        Parameters
        ----------
        store : Store
        stopped : str
        """
        values: dict[str, list[Value]] = {name: [] for name in store.columns}
        for row in store.rows():
            for name, held in values.items():
                value = row.get(name)
                held.append(sys.intern(value) if isinstance(value, str) else value)
        columns = {name: _array(values.pop(name)) for name in [*values]}
        return cls(columns=columns, spec=store.identity.get("spec", {}), stopped=stopped)

    def __len__(self) -> int:
        return len(self.columns[OUTCOME])

    def __getitem__(self, column: str) -> np.ndarray:
        """A column; an UnknownNameError if there is none."""
        if column not in self.columns:
            raise UnknownNameError.of("column", column, self.columns)
        return self.columns[column]

    def rows(self) -> Iterator[Row]:
        """Row by row."""
        for values in zip(*(column.tolist() for column in self.columns.values())):
            yield dict(zip(self.columns, values))

    @property
    def outcomes(self) -> dict[str, int]:
        """How many rows ended how, most frequent first."""
        return dict(Counter(self.columns[OUTCOME].tolist()).most_common())

    @property
    def is_complete(self) -> bool:
        """Whether every point has a result, whatever it is."""
        return not self.stopped and not np.isin(self.columns[OUTCOME].astype(str), NO_RESULT).any()

    def chosen(self, rows: np.ndarray) -> Table:
        """Some of its rows.

        Parameters
        ----------
        rows : (rows,) array of bool, or of places
        """
        columns = {name: column[rows] for name, column in self.columns.items()}
        return replace(self, columns=columns)

    def by(self, column: str) -> dict[Any, Table]:
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
        values = self[column]
        return {value: self.chosen(values == value) for value in dict.fromkeys(values.tolist())}

    def yield_of(self, spec: Mapping[str, Any] | None = None) -> Yield:
        """The share of rows that settled and keep a spec, that of the study by default.

        Parameters
        ----------
        spec : mapping of metric to Limit, optional

        Returns
        -------
        Yield

        Raises
        ------
        UnknownNameError, StudyError
            If a metric of the spec was not measured, or a limit is none.
        """
        limits: Mapping[str, Limit] = self.spec if spec is None else spec
        for name in limits:
            self[name]
        return yield_of(self.columns, limits)

    def to_frame(self) -> Any:
        """The table as a data frame of pandas.

        Returns
        -------
        pandas.DataFrame

        Raises
        ------
        PandasMissing
            If pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise PandasMissing(
                "to_frame: a data frame needs pandas: pip install 'ann-dc[study]'"
            ) from error
        return pandas.DataFrame(dict(self.columns))


def _array(values: Iterable[Value]) -> np.ndarray:
    """Whole numbers where all are, numbers where all are, else words."""
    listed = list(values)
    kinds = {type(value) for value in listed}
    if str in kinds:
        return np.array(["" if value is None else str(value) for value in listed], object)
    if kinds == {int}:
        return np.array(listed, np.int64)
    return np.array([np.nan if value is None else value for value in listed], float)
