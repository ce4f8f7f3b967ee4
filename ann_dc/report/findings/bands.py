"""Medians and bands: what a metric does where a setting has a value, or lies between two.

A setting of few values has a group a value. One of many values is cut into groups of as many
points each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.report.findings.columns import Column

FEW = 40
"""Different values of a setting that are a group each."""
REPEATED = 5
"""Points a group from which on it has a band."""
IN_A_GROUP = 50
"""Points in a group that is cut out of many values."""
MOST_GROUPS = 30
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


class Band(NamedTuple):
    """Quantiles of a metric by groups of rows.

    Attributes
    ----------
    at : array (groups,)
        The setting: the value, or the median of the group.
    quantiles : array (5, groups)
        Of the metric, at 5, 25, 50, 75 and 95 %.
    counts : array (groups,) of int
    """

    at: np.ndarray
    quantiles: np.ndarray
    counts: np.ndarray


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
    at = _quantiles(setting.numbers, group, known)
    return Band(at.quantiles[2], *_quantiles(metric.numbers, group, known)[1:])


def boxes(setting: Column, metric: Column) -> Band:
    """What a metric does where a setting has each of its words; `Band.at` has their codes.

    Parameters
    ----------
    setting, metric : Column
    """
    assert setting.codes is not None
    return _quantiles(metric.numbers, setting.codes, metric.finite)


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


def _quantiles(values, group: np.ndarray, known: np.ndarray) -> Band:
    """Quantiles of the known values in every group that has any."""
    order = np.argsort(group[known], kind="stable")
    ordered, codes = values[known][order], group[known][order]
    names, starts = np.unique(codes, return_index=True)
    parts = np.split(ordered, starts[1:])
    found = np.array([np.quantile(part, QUANTILES) for part in parts]).T
    return Band(names, found.reshape(5, len(names)), np.array([len(part) for part in parts]))
