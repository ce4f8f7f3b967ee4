"""Shares with their intervals: how many of the points meet the spec.

A share k/n has the Clopper-Pearson interval at 95 %: it holds the true share in at least 95 of 100
studies, whatever that share is.

References
----------
.. [1] C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits illustrated in the
   case of the binomial, Biometrika 26, 1934, 404-413.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ann_dc.report.findings.columns import Column
from ann_dc.report.findings.findings import Findings

TAIL = 0.025
"""Probability beyond either end of an interval."""


class Share(NamedTuple):
    """So many of so many.

    Attributes
    ----------
    hits : int
    of : int
    """

    hits: int
    of: int

    @property
    def value(self) -> float:
        """The share; nan of nothing."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper-Pearson interval at 95 %.

        Examples
        --------
        >>> low, high = Share(0, 10).interval
        >>> low, round(high, 4)
        (0.0, 0.3085)
        """
        from scipy.stats import beta

        missed = self.of - self.hits
        low = beta.ppf(TAIL, self.hits, missed + 1) if self.hits else 0.0
        high = beta.isf(TAIL, self.hits + 1, missed) if missed else 1.0
        return float(low), float(high)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{_percent(self.value)} % ({_percent(low)} to {_percent(high)} %)"


class Limit(NamedTuple):
    """One item of a spec.

    Attributes
    ----------
    column : Column
        The metric that has to keep it.
    low, high : float
        The ends of what is good; infinite where there is none.
    """

    column: Column
    low: float
    high: float

    @property
    def ends(self) -> tuple[float, ...]:
        """The finite ends."""
        return tuple(end for end in (self.low, self.high) if np.isfinite(end))

    @property
    def met(self) -> np.ndarray:
        """Rows (rows,) that keep it; a row without a number does not."""
        numbers = self.column.numbers
        if numbers is None:
            return np.zeros(len(self.column.finite), bool)
        return (numbers >= self.low) & (numbers <= self.high)

    @property
    def beyond(self) -> np.ndarray:
        """How far (rows,) outside, in the metric's unit; negative inside, nan without a number."""
        numbers = self.column.numbers
        if numbers is None:
            return np.full(len(self.column.finite), np.nan)
        return np.maximum(self.low - numbers, numbers - self.high)

    def __str__(self) -> str:
        unit = f" {self.column.unit}" if self.column.unit else ""
        if not np.isfinite(self.low):
            return f"{self.column.name} \N{LESS-THAN OR EQUAL TO} {self.high:.6g}{unit}"
        if not np.isfinite(self.high):
            return f"{self.column.name} \N{GREATER-THAN OR EQUAL TO} {self.low:.6g}{unit}"
        return f"{self.column.name} in {self.low:.6g} to {self.high:.6g}{unit}"


def limits(findings: Findings) -> tuple[Limit, ...]:
    """The items of a study's spec whose metrics were measured.

    Parameters
    ----------
    findings : Findings
        Its spec has a limit a metric: a number that is not to be exceeded, or [low, high].
    """
    spec: Mapping = findings.identity.get("spec") or {}
    found = []
    for name, limit in spec.items():
        if name in findings.columns:
            low, high = limit if isinstance(limit, (list, tuple)) else (None, limit)
            low = -np.inf if low is None else float(low)
            high = np.inf if high is None else float(high)
            found.append(Limit(findings.columns[name], low, high))
    return tuple(found)


def within(spec: tuple[Limit, ...]) -> np.ndarray:
    """Rows (rows,) that keep every item of a spec.

    Parameters
    ----------
    spec : tuple of Limit
        At least one.
    """
    return np.logical_and.reduce([limit.met for limit in spec])


def share_of(rows: np.ndarray) -> Share:
    """How many of these rows.

    Parameters
    ----------
    rows : array of bool
    """
    return Share(int(rows.sum()), len(rows))


def _percent(share: float) -> str:
    """A share in percent, with digits that tell 99.99 from 100."""
    digits = 1 if 0.01 < share < 0.99 else 2
    return f"{100 * share:.{digits}f}"
