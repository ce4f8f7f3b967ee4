"""Table of a study: a record per case, a column per setting, metric and outcome."""

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
from ann_dc.validation import checked
from ann_dc.yields import Limit, Yield

NO_RESULT = (FAILED, TIMED_OUT, LOST)
"""Outcomes of cases without a result."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Records of a study in the order of its cases.

    Attributes
    ----------
    columns : mapping of str to (rows,) array
        Numbers, nan if missing; or text, empty if missing.
    spec : mapping of metric to Limit
        Specification of the study.
    stopped : str
        Reason of an early end; empty if the last case was run.

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
        """Return the table with the complete content of an open store."""
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
        """Return a column; raise `UnknownNameError` if the name does not exist."""
        if column not in self.columns:
            raise UnknownNameError.of("column", column, self.columns)
        return self.columns[column]

    def rows(self) -> Iterator[Row]:
        """Return an iterator over the records."""
        for values in zip(*(column.tolist() for column in self.columns.values())):
            yield dict(zip(self.columns, values))

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of records by outcome, most frequent first."""
        return dict(Counter(self.columns[OUTCOME].tolist()).most_common())

    @property
    def is_complete(self) -> bool:
        """True if every case has a result of any outcome."""
        return not self.stopped and not np.isin(self.columns[OUTCOME].astype(str), NO_RESULT).any()

    def chosen(self, rows: np.ndarray) -> Table:
        """Return the table of the records selected by a mask (rows,) or by indices."""
        columns = {name: column[rows] for name, column in self.columns.items()}
        return replace(self, columns=columns)

    def by(self, column: str) -> dict[Any, Table]:
        """Group the records by the value of a column, in order of first occurrence."""
        values = self[column]
        return {value: self.chosen(values == value) for value in dict.fromkeys(values.tolist())}

    def yield_of(self, spec: Mapping[str, Any] | None = None) -> Yield:
        """Return the fraction of records that settled and satisfy a specification.

        By default the limits are those of the study. Raises `UnknownNameError` if a metric of the
        specification was not measured, and `StudyError` if a limit is invalid.
        """
        limits: Mapping[str, Limit] = self.spec if spec is None else spec
        for name in limits:
            self[name]
        return yield_of(self.columns, limits)

    def to_frame(self) -> Any:
        """Convert the table to a pandas data frame; raise `PandasMissing` without pandas."""
        try:
            import pandas
        except ImportError as error:
            raise PandasMissing(
                "to_frame: a data frame needs pandas: pip install 'ann-dc[study]'"
            ) from error
        return pandas.DataFrame(dict(self.columns))


def _array(values: Iterable[Value]) -> np.ndarray:
    """Return an array of integers, else of numbers, else of text."""
    listed = list(values)
    kinds = {type(value) for value in listed}
    if str in kinds:
        return np.array(["" if value is None else str(value) for value in listed], object)
    if kinds == {int}:
        return np.array(listed, np.int64)
    return np.array([np.nan if value is None else value for value in listed], float)
