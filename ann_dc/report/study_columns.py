"""Column of a study table as arrays: numbers, or text with a code per record.

Statistics are computed by groups of records. A column with few values has one group per value. A
column with many numbers is divided into groups of equal size.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

LARGEST_WHOLE = 2**53
"""Limit from which integers are not exact as floating-point numbers and remain text."""
WIDE = 50.0
"""Ratio of largest to smallest value from which an axis may be logarithmic."""
BULK = 20.0
"""Ratio of the 95 % to the 5 % quantile from which an axis is logarithmic; 19 for a uniform
distribution.
"""
FEW = 40
"""Largest number of different numbers with one group each."""
REPEATED = 5
"""Cases per group required on average."""
IN_A_GROUP = 50
"""Smallest number of cases per group of a divided column."""
FEWEST_GROUPS, MOST_GROUPS = 4, 30
"""Number of groups of a divided column."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """One column of the table.

    Attributes
    ----------
    unit : str
        Unit of measure; may be empty.
    says : str
        Meaning in one sentence; may be empty.
    numbers : array (rows,) of float, or None
        Values, nan if missing; None for text.
    codes : array (rows,) of int, or None
        Index into `words` for text.
    """

    name: str
    unit: str = ""
    says: str = ""
    numbers: np.ndarray | None = None
    codes: np.ndarray | None = None
    words: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Axis label: name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def cell(self, row: int) -> float | str:
        """Return the value of one record."""
        if self.numbers is not None:
            return float(self.numbers[row])
        return self.words[self.places[row]]

    def at(self, rows: np.ndarray) -> Column:
        """Return the column of selected records."""
        numbers, codes = (None if a is None else a[rows] for a in (self.numbers, self.codes))
        return replace(self, numbers=numbers, codes=codes)

    @cached_property
    def finite(self) -> np.ndarray:
        """Records with a finite number; none for text."""
        if self.numbers is None:
            return np.zeros(len(self.places), bool)
        return np.isfinite(self.numbers)

    @cached_property
    def values(self) -> np.ndarray:
        """Finite numbers."""
        return self.as_numbers[self.finite]

    @cached_property
    def as_numbers(self) -> np.ndarray:
        """Numbers (rows,); for text 1 for true, 0 for false, and nan otherwise."""
        if self.numbers is not None:
            return self.numbers
        worth = [{"true": 1.0, "false": 0.0}.get(word, np.nan) for word in self.words]
        return np.array(worth)[self.codes]

    @cached_property
    def distinct(self) -> np.ndarray:
        """Distinct values: numbers in order, or text."""
        if self.numbers is None:
            return np.array([word for word in self.words if word], dtype=object)
        return np.unique(self.values)

    @cached_property
    def places(self) -> np.ndarray:
        """Index (rows,) among the distinct numbers, or codes of text."""
        if self.numbers is not None:
            return np.searchsorted(self.distinct, self.numbers)
        return np.zeros(0, int) if self.codes is None else self.codes

    @cached_property
    def groups(self) -> np.ndarray | None:
        """Group (rows,) of every record, -1 for missing numbers; None for too few records."""
        if self.numbers is None:
            return self.places
        if len(self.distinct) <= FEW:
            is_large = len(self.values) >= REPEATED * len(self.distinct)
            return np.where(self.finite, self.places, -1) if is_large else None
        number = min(MOST_GROUPS, len(self.values) // IN_A_GROUP)
        if number < FEWEST_GROUPS:
            return None
        edges = np.unique(np.quantile(self.values, np.linspace(0, 1, number + 1)[1:-1]))
        return np.where(self.finite, np.searchsorted(edges, self.numbers, side="right"), -1)

    @cached_property
    def spans(self) -> float:
        """Ratio of the largest to the smallest value; 1 if a value is not positive."""
        low = self.values.min(initial=np.inf)
        return float(self.values.max() / low) if 0 < low < np.inf else 1.0

    @cached_property
    def is_wide(self) -> bool:
        """True if a logarithmic axis suits the values: more than a few are small."""
        if self.spans <= WIDE:
            return False
        low, high = np.quantile(self.values, (0.05, 0.95))
        return bool(high > BULK * low)

    def scaled(self, values: Any) -> np.ndarray:
        """Return values as an axis of this column places them: logarithms if it is wide."""
        return np.log(values) if self.is_wide else np.asarray(values)


def column_of(name: str, cells: Any, *, unit: str = "", says: str = "") -> Column:
    """Return a column as arrays from a pandas series of numbers, booleans or text.

    Missing values are None or nan.

    Examples
    --------
    >>> import pandas
    >>> column_of("N", pandas.Series([9, 100, None]), unit="cells").numbers
    array([  9., 100.,  nan])
    >>> column_of("closed", pandas.Series([True, False, None])).words
    ('true', 'false', '')
    """
    import pandas

    kinds = {type(cell) for cell in cells.dropna()}
    is_text = any(not issubclass(kind, (int, float, np.number)) for kind in kinds)
    if not is_text and bool not in kinds and cells.dtype.kind != "b":
        numbers = cells.to_numpy(dtype=float, na_value=np.nan)
        has_whole = any(issubclass(kind, (int, np.integer)) for kind in kinds)
        largest = np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0)
        if not has_whole or largest < LARGEST_WHOLE:
            return Column(name=name, unit=unit, says=says, numbers=numbers)
    codes, words = pandas.factorize(cells.map(_word).fillna("").to_numpy(dtype=object))
    return Column(name=name, unit=unit, says=says, codes=codes, words=tuple(words))


def _word(cell: Any) -> str:
    if cell is None or cell != cell:
        return ""
    return str(cell).lower() if isinstance(cell, (bool, np.bool_)) else str(cell)
