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
    value, low, high : float
        Exponent p and its interval at the level `CONFIDENCE`; nan if there are too few values.
    r_squared : float
        Fraction of the variance of log y explained by the line.
    points : int
        Number of fitted points.
    """

    value: float
    low: float
    high: float
    r_squared: float
    points: int

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.low:.2f} to {self.high:.2f})"


def exponent_of(x: Sequence[float] | np.ndarray, y: Sequence[float] | np.ndarray) -> Exponent:
    """Fit the exponent of a power law by least squares in logarithms.

    Only finite positive values are fitted. The interval follows from Student's t distribution. `x`
    and `y` have equal lengths.

    Examples
    --------
    >>> found = exponent_of([1, 2, 4, 8], [3, 12.1, 47.5, 193])
    >>> round(found.value, 2), found.low < 2 < found.high
    (2.0, True)
    """
    pairs = np.stack([np.asarray(x, float), np.asarray(y, float)])
    pairs = pairs[:, np.isfinite(pairs).all(axis=0) & (pairs > 0).all(axis=0)]
    pairs = np.unique(pairs, axis=1)  # a repeated measurement adds no information
    if len(np.unique(pairs[0])) < FEWEST:
        return Exponent(math.nan, math.nan, math.nan, math.nan, pairs.shape[1])
    fit: Any = stats.linregress(*np.log(pairs))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, pairs.shape[1] - 2) * fit.stderr)
    value = float(fit.slope)
    return Exponent(value, value - half, value + half, float(fit.rvalue**2), pairs.shape[1])
