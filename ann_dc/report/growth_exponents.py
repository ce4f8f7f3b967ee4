"""Growth of metrics with settings: slope of log(metric) over log(setting).

The slope is fitted by least squares to all cases with both values. Its interval is Student's at 95
%. Variation of other settings counts as scatter.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.study.exponents import FEWEST, Exponent, exponent_of

DECADE = 10.0
"""Ratio that the values of a setting must span."""


class Growth(NamedTuple):
    """Power law metric ~ setting^p."""

    metric: Column
    setting: Column
    exponent: Exponent


def exponents(findings: Findings) -> list[Growth]:
    """Return the exponents of metrics and wall time over settings, clearest first.

    Settings must span a decade.
    """
    seconds = () if findings.seconds is None else (findings.seconds,)
    metrics = [metric for metric in (*findings.metrics, *seconds) if metric.numbers is not None]
    wide = [s for s in findings.varied if s.spans >= DECADE and len(s.distinct) >= FEWEST]
    return sorted(_fits(metrics, wide), key=lambda one: -one.exponent.told)


def _fits(metrics: Iterable[Column], settings: Iterable[Column]) -> Iterable[Growth]:
    settings = list(settings)
    for metric in metrics:
        for setting in settings:
            found = fit(metric, setting)
            if found is not None:
                yield found


def fit(metric: Column, setting: Column) -> Growth | None:
    """Fit a metric over a numeric setting; None for too few or constant values."""
    assert metric.numbers is not None
    assert setting.numbers is not None
    if len(metric.distinct) < 2:
        return None
    found = exponent_of(setting.numbers, metric.numbers)
    return None if np.isnan(found.value) else Growth(metric, setting, found)
