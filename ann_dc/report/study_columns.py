"""A column of a study's table as arrays: numbers, or words with a code for each row."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

LARGEST_WHOLE = 2**53
"""Whole numbers from it on are no floating-point numbers, and stay text."""
WIDE = 50.0
"""Ratio of the largest to the smallest value from which on an axis may be logarithmic."""
BULK = 20.0
"""Ratio of the 95 % to the 5 % quantile from which on it is; that of evenly spread values is 19."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """One column of the table.

    Attributes
    ----------
    name : str
    unit : str
        Empty where there is none.
    says : str
        What it means, in a sentence; empty where nobody said.
    numbers : array (rows,) of float, or None
        nan where a row has none; None where the column holds words.
    codes : array (rows,) of int, or None
        Of words: which one of `words` a row has.
    words : tuple of str
    """

    name: str
    unit: str = ""
    says: str = ""
    numbers: np.ndarray | None = None
    codes: np.ndarray | None = None
    words: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name with unit, as an axis has it."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def at(self, rows: np.ndarray) -> Column:
        """Return the column of chosen rows.

        Parameters
        ----------
        rows : array of int
        """
        numbers, codes = (None if a is None else a[rows] for a in (self.numbers, self.codes))
        return replace(self, numbers=numbers, codes=codes)

    @cached_property
    def finite(self) -> np.ndarray:
        """Rows that have a finite number; none of words."""
        if self.numbers is None:
            return np.zeros(0 if self.codes is None else len(self.codes), bool)
        return np.isfinite(self.numbers)

    @cached_property
    def values(self) -> np.ndarray:
        """The finite numbers."""
        return np.zeros(0) if self.numbers is None else self.numbers[self.finite]

    @cached_property
    def as_numbers(self) -> np.ndarray:
        """Numbers (rows,): of words, 1 for true, 0 for false, and nan for all others."""
        if self.numbers is not None:
            return self.numbers
        worth = [{"true": 1.0, "false": 0.0}.get(word, np.nan) for word in self.words]
        return np.array(worth)[self.codes]

    @cached_property
    def distinct(self) -> np.ndarray:
        """Values that occur, each once: numbers in order, or words."""
        if self.numbers is None:
            return np.array([word for word in self.words if word], dtype=object)
        return np.unique(self.values)

    @cached_property
    def spans(self) -> float:
        """Ratio of the largest to the smallest value; 1 where one is not positive."""
        low = self.values.min(initial=np.inf)
        return float(self.values.max() / low) if 0 < low < np.inf else 1.0

    @cached_property
    def is_wide(self) -> bool:
        """Whether it belongs on a logarithmic axis: not just a few values are small."""
        if self.spans <= WIDE:
            return False
        low, high = np.quantile(self.values, (0.05, 0.95))
        return bool(high > BULK * low)


def column_of(name: str, cells: Any, *, unit: str = "", says: str = "") -> Column:
    """A column as arrays.

    Parameters
    ----------
    name : str
    cells : pandas.Series
        Numbers, booleans, words, or some of each; None and nan where there is none.
    unit, says : str

    Examples
    --------
    >>> import pandas
    >>> column_of("N", pandas.Series([9, 100, None]), unit="cells").numbers
    array([  9., 100.,  nan])
    >>> column_of("closed", pandas.Series([True, False, None])).words
    ('true', 'false', '')
    """
    numbers = _numbers(cells)
    if numbers is not None:
        return Column(name=name, unit=unit, says=says, numbers=numbers)
    import pandas

    codes, words = pandas.factorize(cells.map(_word).fillna("").to_numpy(dtype=object))
    return Column(name=name, unit=unit, says=says, codes=codes, words=tuple(words))


def _numbers(cells: Any) -> np.ndarray | None:
    """The cells as numbers; None where one of them is none."""
    from pandas.api import types

    if types.is_bool_dtype(cells):
        return None
    if not types.is_numeric_dtype(cells):
        kinds = {type(cell) for cell in cells.dropna()}
        if not all(issubclass(kind, (int, float, np.number)) for kind in kinds - {bool}):
            return None
        if bool in kinds:
            return None
    numbers = cells.to_numpy(dtype=float, na_value=np.nan)
    whole = np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0) >= LARGEST_WHOLE
    return None if whole and _holds_whole_numbers(cells) else numbers


def _holds_whole_numbers(cells: Any) -> bool:
    from pandas.api import types

    return types.is_integer_dtype(cells) or any(isinstance(cell, int) for cell in cells)


def _word(cell: Any) -> str:
    if cell is None or cell != cell:
        return ""
    return str(cell).lower() if isinstance(cell, (bool, np.bool_)) else str(cell)
