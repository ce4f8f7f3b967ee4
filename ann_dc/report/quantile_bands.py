"""Medians and quantile bands of a metric over the values or ranges of a setting.

A setting with few values has one group per value. A setting with many values is divided into groups
of equal size.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ann_dc.report.study_columns import Column

FEW = 40
"""Largest number of different values with one group each."""
REPEATED = 5
"""Cases per group required for a band."""
IN_A_GROUP = 50
"""Smallest number of cases per group of a divided setting."""
MOST_GROUPS = 30
SMALLEST_CLUSTER = 0.2
"""Smallest fraction of the cases of a group in a cluster."""
GAP = 0.25
"""Gap between clusters, as a fraction of the range of the group."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


class Combination(NamedTuple):
    """Records of one combination of the other settings.

    Attributes
    ----------
    label : str
        Values of these settings; empty without settings.
    is_whole : bool
        True if no other setting varies within the combination.
    """

    label: str
    rows: np.ndarray
    is_whole: bool


class Band(NamedTuple):
    """Quantiles of a metric by groups of records.

    Attributes
    ----------
    at : array (groups,)
        Value of the setting, or median of the group.
    quantiles : array (5, groups)
        Quantiles of the metric at 5, 25, 50, 75 and 95 %.
    clustered : array (groups,) of bool
        True for a group of two clusters, whose median may not be close to any case.
    """

    at: np.ndarray
    quantiles: np.ndarray
    counts: np.ndarray
    clustered: np.ndarray


def groups(setting: Column) -> np.ndarray | None:
    """Return the group (rows,) of every record, from 0; None for too few records.

    The group is -1 if the setting has no number.
    """
    assert setting.numbers is not None
    count = len(setting.values)
    if len(setting.distinct) <= FEW:
        if count < REPEATED * len(setting.distinct):
            return None
        found = np.searchsorted(setting.distinct, setting.numbers)
    else:
        number = min(MOST_GROUPS, count // IN_A_GROUP)
        if number < 4:
            return None
        edges = np.quantile(setting.values, np.linspace(0, 1, number + 1)[1:-1])
        found = np.searchsorted(np.unique(edges), setting.numbers, side="right")
    return np.where(setting.finite, found, -1)


def band(setting: Column, metric: Column) -> Band | None:
    """Return the band of a metric over a numeric setting; None for too few cases."""
    assert metric.numbers is not None
    group = groups(setting)
    if group is None:
        return None
    known = metric.finite & (group >= 0)
    if not known.any():
        return None
    at = _quantiles(setting, group, known)
    return Band(at.quantiles[2], *_quantiles(metric, group, known)[1:])


def combinations(
    settings: Sequence[Column], rows: np.ndarray, most: int
) -> list[Combination] | None:
    """Split records by combinations of settings; None for more than `most` of text.

    All text settings split the records. Numeric settings split them as long as there are not too
    many combinations. A median over several combinations may not be close to any case.
    """
    codes = np.zeros((len(rows), 0), int)
    chosen: list[Column] = []
    for one in sorted(settings, key=lambda one: (one.numbers is not None, len(one.distinct))):
        wider = np.column_stack([codes, _codes(one)[rows]])
        if len(np.unique(wider, axis=0)) <= most:
            codes, chosen = wider, [*chosen, one]
        elif one.numbers is None:
            return None
    _, firsts, place = np.unique(codes, axis=0, return_index=True, return_inverse=True)
    return [
        Combination(
            ", ".join(_valued(one, int(rows[first])) for one in chosen),
            rows[place.ravel() == number],
            len(chosen) == len(settings),
        )
        for number, first in enumerate(firsts)
    ]


def _codes(setting: Column) -> np.ndarray:
    """Return the index (rows,) of each record's value among the distinct values."""
    if setting.numbers is not None:
        return np.searchsorted(setting.distinct, setting.numbers)
    assert setting.codes is not None
    return setting.codes


def _valued(setting: Column, row: int) -> str:
    if setting.numbers is not None:
        return f"{setting.name} {setting.numbers[row]:.4g}"
    assert setting.codes is not None
    return setting.words[setting.codes[row]] or f"no {setting.name}"


def boxes(setting: Column, metric: Column) -> Band:
    """Return quantiles of a metric for each value of a text setting.

    `Band.at` contains the codes of the values.
    """
    assert setting.codes is not None
    return _quantiles(metric, setting.codes, metric.finite)


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
    """Return the fraction of a metric's rank variance explained by groups, 0 to 1."""
    from scipy.stats import rankdata

    assert metric.numbers is not None
    group = setting.codes if setting.numbers is None else groups(setting)
    if group is None:
        group = _quarters(setting)
    known = metric.finite & (group >= 0)
    ranks = rankdata(metric.numbers[known])
    if len(ranks) < 2 or np.ptp(ranks) == 0:
        return 0.0
    _, where = np.unique(group[known], return_inverse=True)
    means = np.bincount(where, ranks) / np.bincount(where)
    return float(np.var(means[where]) / np.var(ranks))


def _quarters(setting: Column) -> np.ndarray:
    """Return four groups of a setting with few records."""
    assert setting.numbers is not None
    ranks = np.searchsorted(setting.distinct, setting.numbers)
    return np.where(setting.finite, ranks * 4 // len(setting.distinct), -1)


def _quantiles(column: Column, group: np.ndarray, known: np.ndarray) -> Band:
    """Return the quantiles of the known values in every non-empty group."""
    values = column.as_numbers
    order = np.argsort(group[known], kind="stable")
    ordered, codes = values[known][order], group[known][order]
    names, starts = np.unique(codes, return_index=True)
    parts = np.split(ordered, starts[1:])
    found = np.array([np.quantile(part, QUANTILES) for part in parts]).T
    return Band(
        names,
        found.reshape(5, len(names)),
        np.array([len(part) for part in parts]),
        np.array([is_clustered(np.log(part) if column.is_wide else part) for part in parts], bool),
    )
