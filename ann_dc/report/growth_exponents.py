"""How a metric grows with a setting: the slope of log(metric) over log(setting), with its interval.

The fit is the line of least squares through all points that have both; its interval is Student's
at 95 %. Other settings that vary count as scatter.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.study.exponents import FEWEST, Exponent, exponent_of

DECADE = 10.0
"""Ratio that a setting has to span."""


class Growth(NamedTuple):
    """metric ~ setting^p.

    Attributes
    ----------
    metric, setting : Column
    exponent : Exponent
    """

    metric: Column
    setting: Column
    exponent: Exponent


def exponents(findings: Findings) -> list[Growth]:
    """Of every metric, and of the wall time, in every setting that spans a decade; clearest first.

    Parameters
    ----------
    findings : Findings
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
    """How a metric grows with a setting; None where it has too few values, or stays the same.

    Parameters
    ----------
    metric, setting : Column
        Of numbers.
    """
    assert metric.numbers is not None
    assert setting.numbers is not None
    if len(metric.distinct) < 2:
        return None
    found = exponent_of(setting.numbers, metric.numbers)
    return None if np.isnan(found.value) else Growth(metric, setting, found)
