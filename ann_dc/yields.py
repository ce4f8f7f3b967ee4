"""Yield: fraction of samples that meet a specification, with its interval."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.stats import beta

from ann_dc.errors import StudyError
from ann_dc.validation import Index, Share, checked

CONFIDENCE = 0.95

Limit: TypeAlias = float | tuple[float | None, float | None] | list[float | None]
"""Largest value, or smallest and largest value; None for no limit."""


@checked
@dataclass(frozen=True, kw_only=True)
class Yield:
    """Fraction of passed samples with its confidence interval.

    Attributes
    ----------
    passed, count : int
        Number of samples within the specification, and of all samples that count.
    confidence : float
        Confidence level of the interval. Default 0.95.
    draws : int, optional
        Number of independent draws behind the samples: fewer than samples if one draw is used under
        several settings, 0 if nothing is drawn. Default: the number of samples.

    Examples
    --------
    >>> print(Yield(passed=190, count=200, draws=100))  # each draw under two settings
    95.0 % (88.7 to 98.4 %, 190 of 200 from 100 draws)
    >>> print(Yield(passed=2, count=3, draws=0))
    66.7 % (2 of 3, no random settings: no interval)
    >>> print(Yield(passed=95, count=100))
    95.0 % (88.7 to 98.4 %, 95 of 100)
    >>> Yield(passed=0, count=100).high < 0.04  # the rule of three
    True
    """

    passed: Index
    count: Index
    confidence: Share = CONFIDENCE
    draws: Index | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.passed <= self.count:
            raise StudyError(f"passed: expected 0 to {self.count}, got {self.passed}")

    @property
    def share(self) -> float:
        """Fraction passed / count; nan without samples."""
        return self.passed / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper-Pearson interval of the fraction; nan if nothing is drawn.

        Samples of one draw count as one sample with their mean. The interval is exact if they
        agree, and too wide if they do not.

        References
        ----------
        .. [1] C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits illustrated in
           the case of the binomial, Biometrika 26, 1934, 404-413.
        """
        if not self.count:
            return 0.0, 1.0
        number = self.count if self.draws is None else self.draws
        if not number:
            return math.nan, math.nan
        good, tail = self.share * number, (1 - self.confidence) / 2
        low = beta.ppf(tail, good, number - good + 1) if self.passed else 0.0
        high = beta.isf(tail, good + 1, number - good) if self.passed < self.count else 1.0
        return float(low), float(high)

    @property
    def low(self) -> float:
        """Lower end of the interval."""
        return self.interval[0]

    @property
    def high(self) -> float:
        """Upper end of the interval."""
        return self.interval[1]

    def __str__(self) -> str:
        low, high = self.interval
        said, of = f"{100 * self.share:.1f} %", f"{self.passed} of {self.count}"
        if self.draws == 0:
            return f"{said} ({of}, no random settings: no interval)"
        few = self.draws is not None and self.draws < self.count
        of += f" from {self.draws} draws" if few else ""
        return f"{said} ({100 * low:.1f} to {100 * high:.1f} %, {of})"


def ends_of(limit: Limit) -> tuple[float, float]:
    """Return the smallest and largest allowed value of a limit, infinite if unlimited.

    Raises `StudyError` if the limit is neither a number nor a pair, or is empty.
    """
    pair = tuple(limit) if isinstance(limit, (tuple, list)) else (None, limit)
    if len(pair) != 2 or any(isinstance(end, (str, bool)) for end in pair):
        raise StudyError(f"spec: a limit is a number or (smallest, largest), got {limit!r}")
    low, high = pair
    ends = -math.inf if low is None else float(low), math.inf if high is None else float(high)
    if not ends[0] <= ends[1]:
        raise StudyError(f"spec: the limit {limit!r} is empty; use (smallest, largest)")
    return ends


def within(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> np.ndarray:
    """Return booleans (rows,), True for rows that meet every limit; nan meets none.

    `columns` contains at least the metrics of the specification, each (rows,). The specification
    must not be empty.
    """
    ends = {name: ends_of(limit) for name, limit in spec.items()}
    kept = [(columns[name] >= low) & (columns[name] <= high) for name, (low, high) in ends.items()]
    return np.logical_and.reduce(kept)
