"""Medians and bands: what a metric does where a setting has a value, or lies between two.

A setting of few values has a group a value. One of many values is cut into groups of as many
points each.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ann_dc.report.study_columns import Column

FEW = 40
"""Different values of a setting that are a group each."""
REPEATED = 5
"""Points a group from which on it has a band."""
IN_A_GROUP = 50
"""Points in a group that is cut out of many values."""
MOST_GROUPS = 30
SMALLEST_CLUSTER = 0.2
"""Share of the points of a group that a cluster has at least."""
GAP = 0.25
"""Share of the range of a group between its clusters."""
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


class Combination(NamedTuple):
    """Rows of one combination of the other settings.

    Attributes
    ----------
    label : str
        Values of these settings; empty if there are none.
    rows : array of int
    is_whole : bool
        True if no other setting varies within it.
    """

    label: str
    rows: np.ndarray
    is_whole: bool


class Band(NamedTuple):
    """Quantiles of a metric by groups of rows.

    Attributes
    ----------
    at : array (groups,)
        The setting: the value, or the median of the group.
    quantiles : array (5, groups)
        Of the metric, at 5, 25, 50, 75 and 95 %.
    counts : array (groups,) of int
    clustered : array (groups,) of bool
        True for a group of two clusters, whose median lies where there may be no point.
    """

    at: np.ndarray
    quantiles: np.ndarray
    counts: np.ndarray
    clustered: np.ndarray


def groups(setting: Column) -> np.ndarray | None:
    """The group (rows,) of every row, from 0 on, -1 where it has no number; None for too few rows.

    Parameters
    ----------
    setting : Column
        Of numbers.
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
    """What a metric does over a setting of numbers; None where there are too few points.

    Parameters
    ----------
    setting, metric : Column
    """
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
    """Split rows by the combinations of settings; None if words have more than ``most`` of them.

    All settings of words split the rows, and those of numbers as long as there are not too many
    combinations: a median over several of them may lie where there is no point.

    Parameters
    ----------
    settings : sequence of Column
    rows : array of int
    most : int
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
    """Return the number (rows,) of each row's value among the distinct ones, or of its word."""
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
    """What a metric does where a setting has each of its words; `Band.at` has their codes.

    Parameters
    ----------
    setting, metric : Column
    """
    assert setting.codes is not None
    return _quantiles(metric, setting.codes, metric.finite)


def is_clustered(values: np.ndarray) -> bool:
    """Return True if values form two clusters, each of a fifth of them at least.

    The gap between the clusters is a quarter of the range, and larger than 1.5 (1 + ln n) / n of
    the range; the largest gap of n evenly distributed values is about ln(n) / n.

    Parameters
    ----------
    values : array (n,)

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
    """The share of the variance of a metric's ranks that its groups tell, from 0 to 1.

    Parameters
    ----------
    setting, metric : Column
    """
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
    """Four groups of a setting that has few rows."""
    assert setting.numbers is not None
    ranks = np.searchsorted(setting.distinct, setting.numbers)
    return np.where(setting.finite, ranks * 4 // len(setting.distinct), -1)


def _quantiles(column: Column, group: np.ndarray, known: np.ndarray) -> Band:
    """Quantiles of the known values in every group that has any."""
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
