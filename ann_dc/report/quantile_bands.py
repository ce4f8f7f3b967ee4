"""Medians and quantile bands of a metric over the groups of a setting."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ann_dc.report.study_columns import Column

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
    """Quantiles of a metric by groups of records.

    Attributes
    ----------
    at : array (groups,)
        Median of the setting in each group; code of a text setting.
    quantiles : array (5, groups)
        Quantiles of the metric at 5, 25, 50, 75 and 95 %.
    counts : array (groups,) of int
        Cases in each group.
    clustered : array (groups,) of bool
        True for a group of two clusters, whose median may not be close to any case.
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
