"""Yield: what share of the samples keeps within a spec, and how sure that is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from scipy.stats import binomtest

from ann_dc.errors import StudyError
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Index, Share
from ann_dc.study.keeping.rows import OUTCOME, Row

SETTLED = "settled"
CONFIDENCE = 0.95

Limit: TypeAlias = float | tuple[float | None, float | None]
"""A largest value, or the smallest and the largest, None for none."""


@checked
@dataclass(frozen=True, kw_only=True)
class Yield:
    r"""A share with its interval.

    Attributes
    ----------
    passed, count : int
        Samples within the spec, and all that count.
    confidence : float
        Of the interval.

    Examples
    --------
    >>> print(Yield(passed=95, count=100))
    95.0 % (88.7 to 98.4 %, 95 of 100)
    >>> Yield(passed=0, count=100).high < 0.04  # the rule of three
    True
    """

    passed: Index
    count: Index
    confidence: Share = CONFIDENCE

    def __post_init__(self) -> None:
        if not 0 <= self.passed <= self.count:
            raise StudyError(f"passed: expected 0 to {self.count}, got {self.passed}")

    @property
    def share(self) -> float:
        """passed / count; nan of nothing."""
        return self.passed / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lowest and highest share that the samples do not contradict.

        References
        ----------
        .. [1] C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits illustrated in
           the case of the binomial, Biometrika 26, 1934, 404-413.
        """
        if not self.count:
            return 0.0, 1.0
        found = binomtest(self.passed, self.count).proportion_ci(self.confidence, method="exact")
        return float(found.low), float(found.high)

    @property
    def low(self) -> float:
        """Of the interval."""
        return self.interval[0]

    @property
    def high(self) -> float:
        """Of the interval."""
        return self.interval[1]

    def __str__(self) -> str:
        low, high = self.interval
        return (
            f"{100 * self.share:.1f} % ({100 * low:.1f} to {100 * high:.1f} %, "
            f"{self.passed} of {self.count})"
        )


def is_within(row: Row, spec: Mapping[str, Limit]) -> bool:
    """Whether a row settled and keeps every limit of a spec; what is nan or missing does not.

    Parameters
    ----------
    row : Row
    spec : mapping of metric to Limit

    Examples
    --------
    >>> row = {"outcome": "settled", "control_error": 0.01}
    >>> is_within(row, {"control_error": 0.02}), is_within(row, {"settling_time": 50.0})
    (True, False)
    """
    if row.get(OUTCOME) != SETTLED:
        return False
    return all(_keeps(row.get(name), limit) for name, limit in spec.items())


def _keeps(value: object, limit: Limit) -> bool:
    low, high = limit if isinstance(limit, (tuple, list)) else (None, limit)
    if not isinstance(value, (int, float)):
        return False
    return (low is None or value >= low) and (high is None or value <= high)


def yield_of(rows: Iterable[Row], spec: Mapping[str, Limit]) -> Yield:
    """The share of rows within a spec.

    Every row counts: one that failed is a chip that does not work.

    Parameters
    ----------
    rows : iterable of Row
    spec : mapping of metric to Limit

    Returns
    -------
    Yield
    """
    passed = [is_within(row, spec) for row in rows]
    return Yield(passed=sum(passed), count=len(passed))
