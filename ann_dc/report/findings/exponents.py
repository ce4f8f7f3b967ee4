"""How a metric grows with a setting: the slope of log(metric) over log(setting), with its interval.

The fit is the line of least squares through all points that have both; its interval is Student's
at 95 %. Other settings that vary count as scatter.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ann_dc.report.findings.columns import Column
from ann_dc.report.findings.findings import Findings

DECADE = 10.0
"""Ratio that a setting has to span."""
FEWEST = 3
"""Different values that a setting has to have."""


class Exponent(NamedTuple):
    """metric ~ setting^slope.

    Attributes
    ----------
    metric, setting : Column
    slope : float
    low, high : float
        Interval at 95 %.
    told : float
        Share of the variance of log(metric) that the line tells, R^2.
    points : int
        That were fitted.
    """

    metric: Column
    setting: Column
    slope: float
    low: float
    high: float
    told: float
    points: int


def exponents(findings: Findings) -> list[Exponent]:
    """Of every metric, and of the wall time, in every setting that spans a decade; clearest first.

    Parameters
    ----------
    findings : Findings
    """
    seconds = () if findings.seconds is None else (findings.seconds,)
    metrics = [metric for metric in (*findings.metrics, *seconds) if metric.numbers is not None]
    wide = [s for s in findings.varied if s.spans >= DECADE and len(s.distinct) >= FEWEST]
    return sorted(_fits(metrics, wide), key=lambda one: -one.told)


def _fits(metrics: Iterable[Column], settings: Iterable[Column]) -> Iterable[Exponent]:
    settings = list(settings)
    for metric in metrics:
        for setting in settings:
            found = fit(metric, setting)
            if found is not None:
                yield found


def fit(metric: Column, setting: Column) -> Exponent | None:
    """The exponent of a metric in a setting; None where it has too few values, or none positive.

    Parameters
    ----------
    metric, setting : Column
        Of numbers.
    """
    from scipy.stats import t

    assert metric.numbers is not None
    assert setting.numbers is not None
    with np.errstate(invalid="ignore"):
        both = (metric.numbers > 0) & (setting.numbers > 0) & metric.finite & setting.finite
    x, y = np.log(setting.numbers[both]), np.log(metric.numbers[both])
    if len(np.unique(x)) < FEWEST or np.ptp(y) == 0:
        return None
    x, y = x - x.mean(), y - y.mean()
    slope = float(x @ y / (x @ x))
    rest = float(np.sum((y - slope * x) ** 2))
    wide = float(t.ppf(0.975, len(x) - 2)) * np.sqrt(rest / (len(x) - 2) / (x @ x))
    told = 1 - rest / float(y @ y)
    return Exponent(metric, setting, slope, slope - wide, slope + wide, told, len(x))
