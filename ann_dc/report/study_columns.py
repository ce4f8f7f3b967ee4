"""Columns of a study table, with medians and quantile bands of a metric over a setting.

Statistics are computed by groups of records. A column with few values has one group per value. A
column with many numbers is divided into groups of equal size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

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
    """One column of the table: `numbers` (rows,), nan if missing; or text.

    The `codes` (rows,) of a text are indices into `words`. `says` is the meaning in one sentence.
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

    def by_value(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield every distinct value as text, and the indices of its records."""
        for value in self.distinct:
            if self.numbers is not None:
                yield f"{value:.6g}", np.flatnonzero(self.numbers == value)
            else:
                yield value, np.flatnonzero(self.places == self.words.index(value))

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


SMALLEST_CLUSTER = 0.2
"""Smallest fraction of the cases of a group in a cluster."""
GAP = 0.25
"""Gap between clusters, as a fraction of the range of the group."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


class Combination(NamedTuple):
    """Records `rows` of one combination of the other settings.

    The label has the values of these settings. `is_whole` is True if no other setting varies.
    """

    label: str
    rows: np.ndarray
    is_whole: bool


class Band(NamedTuple):
    """Quantiles (5, groups) of a metric at 5, 25, 50, 75 and 95 %, by groups of records.

    `at` (groups,) is the median of the setting in each group, or the code of a text. A group of two
    clusters is `clustered`: its median may not be close to any case.
    """

    at: np.ndarray
    quantiles: np.ndarray
    counts: np.ndarray
    clustered: np.ndarray


def band(setting: Column, metric: Column) -> Band | None:
    """Return the band of a metric over a setting; None for too few cases."""
    if setting.groups is None:
        return None
    known = np.flatnonzero(metric.finite & (setting.groups >= 0))
    if not len(known):
        return None
    known = known[np.argsort(setting.groups[known], kind="stable")]
    codes, starts = np.unique(setting.groups[known], return_index=True)
    parts, of_setting = (
        np.split(column.as_numbers[known], starts[1:]) for column in (metric, setting)
    )
    is_text = setting.numbers is None
    return Band(
        codes if is_text else np.array([np.quantile(part, 0.5) for part in of_setting]),
        np.array([np.quantile(part, QUANTILES) for part in parts]).T,
        np.array([len(part) for part in parts]),
        np.array([is_clustered(metric.scaled(part)) for part in parts]),
    )


def combinations(
    settings: Sequence[Column], rows: np.ndarray, most: int
) -> list[Combination] | None:
    """Split records by combinations of settings; None for more than `most` of text.

    All text settings split the records. Numeric settings split them as long as there are not too
    many combinations. A median over several combinations may not be close to any case.
    """
    codes, count = np.zeros(len(rows), int), 1
    chosen: list[Column] = []
    for one in sorted(settings, key=lambda one: (one.numbers is not None, len(one.distinct))):
        local = one.places[rows]
        names, wider = np.unique(codes * (local.max() + 1) + local, return_inverse=True)
        if len(names) <= most:
            codes, count, chosen = wider, len(names), [*chosen, one]
        elif one.numbers is None:
            return None
    parts = (rows[codes == number] for number in range(count))
    return [
        Combination(
            ", ".join(_valued(one, int(part[0])) for one in chosen),
            part,
            len(chosen) == len(settings),
        )
        for part in parts
    ]


def _valued(setting: Column, row: int) -> str:
    value = setting.cell(row)
    if isinstance(value, str):
        return value or f"no {setting.name}"
    return f"{setting.name} {value:.4g}"


def is_clustered(values: np.ndarray) -> bool:
    """Return True if values form two clusters, each with at least a fifth of them.

    The gap between the clusters exceeds a quarter of the range and 1.5 (1 + ln n) / n of the range.
    The largest gap of n uniformly distributed values is about ln(n) / n.

    Examples
    --------
    >>> is_clustered(np.array([1.0, 1.1, 1.2, 9.0, 9.1])), is_clustered(np.arange(5.0))
    (True, False)
    """
    ordered, count = np.sort(values), len(values)
    least = max(2, int(np.ceil(SMALLEST_CLUSTER * count)))
    gaps = np.diff(ordered)[least - 1 : count - least]
    if count < 2 * least or not ordered[-1] > ordered[0]:
        return False
    needed = max(GAP, 1.5 * (1 + np.log(count)) / count)
    return bool(gaps.max(initial=0.0) > needed * (ordered[-1] - ordered[0]))


def strength(setting: Column, metric: Column) -> float:
    """Return the fraction of a metric's rank variance explained by groups, 0 to 1.

    A setting with few records has four groups.
    """
    from scipy.stats import rankdata

    group = setting.groups
    if group is None:
        group = np.where(setting.finite, setting.places * 4 // len(setting.distinct), -1)
    known = metric.finite & (group >= 0)
    ranks, group = rankdata(metric.as_numbers[known]), group[known]
    if len(ranks) < 2 or np.ptp(ranks) == 0:
        return 0.0
    means = np.bincount(group, ranks) / np.maximum(np.bincount(group), 1)
    return float(np.var(means[group]) / np.var(ranks))
