"""Fitted power laws y = c x^p with the confidence interval of p."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import stats

from ann_dc.yields import CONFIDENCE

FEWEST = 3
"""Smallest number of different x values for a fit."""


class Exponent(NamedTuple):
    """Fitted power law y = c x^p.

    Attributes
    ----------
    value : float
        Exponent p; nan if there are too few values.
    low, high : float
        Interval of p at the level `CONFIDENCE`.
    told : float
        Fraction of the variance of log y explained by the line, R^2.
    points : int
        Number of fitted points.
    """

    value: float
    low: float
    high: float
    told: float
    points: int

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


def exponent_of(x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray) -> Exponent:
    """Fit the exponent of a power law by least squares in logarithms.

    Only finite positive values are fitted. The interval follows from Student's t distribution.

    Parameters
    ----------
    x, y : sequence of float
        Values of equal length.

    Returns
    -------
    Exponent

    Examples
    --------
    >>> found = exponent_of([1, 2, 4, 8], [3, 12.1, 47.5, 193])
    >>> round(found.value, 2), found.low < 2 < found.high
    (2.0, True)
    """
    pairs = np.stack([np.asarray(x, float), np.asarray(y, float)])
    pairs = pairs[:, np.isfinite(pairs).all(axis=0) & (pairs > 0).all(axis=0)]
    pairs = np.unique(pairs, axis=1)  # what is measured again without a difference tells no more
    if len(np.unique(pairs[0])) < FEWEST:
        return Exponent(math.nan, math.nan, math.nan, math.nan, pairs.shape[1])
    fit: Any = stats.linregress(*np.log(pairs))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, pairs.shape[1] - 2) * fit.stderr)
    value = float(fit.slope)
    return Exponent(value, value - half, value + half, float(fit.rvalue**2), pairs.shape[1])
