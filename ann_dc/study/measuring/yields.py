"""Yield: what share of the samples keeps within a spec, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy.stats import beta

from ann_dc.errors import StudyError
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Index, Share
from ann_dc.study.keeping.rows import OUTCOME, SEED
from ann_dc.study.varying.settings import family_of, is_drawn

SETTLED = "settled"
CONFIDENCE = 0.95

Limit: TypeAlias = float | tuple[float | None, float | None] | list[float | None]
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
    draws : int, optional
        Independent draws that the samples come from; fewer than samples if one draw is used under
        several settings, 0 if nothing is drawn. All samples by default.

    Examples
    --------
    >>> print(Yield(passed=190, count=200, draws=100))  # each draw under two settings
    95.0 % (88.7 to 98.4 %, 190 of 200 from 100 draws)
    >>> print(Yield(passed=2, count=3, draws=0))
    66.7 % (2 of 3, nothing drawn: no interval)
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
        """passed / count; nan of nothing."""
        return self.passed / self.count if self.count else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Lowest and highest share that the draws do not contradict; nan if nothing is drawn.

        Samples of one draw count as one sample with their mean: the interval is exact if they
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
        """Of the interval."""
        return self.interval[0]

    @property
    def high(self) -> float:
        """Of the interval."""
        return self.interval[1]

    def __str__(self) -> str:
        low, high = self.interval
        said, of = f"{100 * self.share:.1f} %", f"{self.passed} of {self.count}"
        if self.draws == 0:
            return f"{said} ({of}, nothing drawn: no interval)"
        few = self.draws is not None and self.draws < self.count
        of += f" from {self.draws} draws" if few else ""
        return f"{said} ({100 * low:.1f} to {100 * high:.1f} %, {of})"


def ends_of(limit: Limit) -> tuple[float, float]:
    """Smallest and largest value that keeps a limit, infinite where there is none.

    Parameters
    ----------
    limit : float or pair

    Raises
    ------
    StudyError
        If it is neither, or empty.

    Examples
    --------
    >>> ends_of(0.05), ends_of((5.0, None))
    ((-inf, 0.05), (5.0, inf))
    """
    pair = tuple(limit) if isinstance(limit, (tuple, list)) else (None, limit)
    if len(pair) != 2 or any(isinstance(end, (str, bool)) for end in pair):
        raise StudyError(f"spec: a limit is a number or (smallest, largest), got {limit!r}")
    low, high = pair
    ends = -math.inf if low is None else float(low), math.inf if high is None else float(high)
    if not ends[0] <= ends[1]:
        raise StudyError(f"spec: the limit {limit!r} is empty; give (smallest, largest)")
    return ends


def within(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> np.ndarray:
    """Which rows settled and keep every limit of a spec; what is nan or missing does not.

    Parameters
    ----------
    columns : mapping of str to (rows,) array
        The outcome, and the metrics of the spec.
    spec : mapping of metric to Limit

    Returns
    -------
    (rows,) array of bool

    Examples
    --------
    >>> columns = {"outcome": np.array(["settled", "diverged"]), "control_error": np.zeros(2)}
    >>> within(columns, {"control_error": 0.02}).tolist()
    [True, False]
    """
    found = np.asarray(columns[OUTCOME] == SETTLED)
    for name, limit in spec.items():
        low, high = ends_of(limit)
        values = columns[name]
        found &= (values >= low) & (values <= high)
    return found


def yield_of(columns: Mapping[str, np.ndarray], spec: Mapping[str, Limit]) -> Yield:
    """The share of rows within a spec.

    Every row counts: one that failed is a chip that does not work.

    Parameters
    ----------
    columns : mapping of str to (rows,) array
    spec : mapping of metric to Limit

    Returns
    -------
    Yield
    """
    passed = within(columns, spec)
    return Yield(passed=int(passed.sum()), count=len(passed), draws=draws_of(columns))


def draws_of(columns: Mapping[str, np.ndarray]) -> int | None:
    """Return the number of independent draws that rows come from; None without seeds.

    All settings share the seeds of their samples, so rows of one seed are one draw. Rows of several
    seeds that are equal in all settings, and in which nothing is drawn, are no draw.

    Parameters
    ----------
    columns : mapping of str to (rows,) array
        Seeds and settings; others are not read.

    Examples
    --------
    >>> columns = {"seed": np.array([5, 6, 5, 6]), "defect.mismatch": np.array([0, 0, 0.1, 0.1])}
    >>> draws_of(columns), draws_of({name: column[:2] for name, column in columns.items()})
    (2, 0)
    """
    if SEED not in columns:
        return None
    names = [name for name in columns if family_of(name) is not None]
    rows = [*zip(*(columns[name].tolist() for name in names))] if names else []
    drawn = {setting: is_drawn(dict(zip(names, setting))) for setting in {*rows}}
    seeds = columns[SEED].tolist()
    still = [seed for seed, setting in zip(seeds, rows) if not drawn[setting]] if rows else seeds
    places = len({*still}) > 1 and len(drawn) - sum(drawn.values()) == len(still)
    found = {seed for seed, setting in zip(seeds, rows) if drawn[setting]}
    return len(found | {*still} if places else found)
