"""Cases of a study: all combinations of listed values, with samples of the ranges.

A sample has one seed and one position in the ranges. Both are equal at every combination of listed
values, so combinations are compared on the same draws.
"""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from ann_dc.errors import StudyError
from ann_dc.study.records import SEED, Point, Value

LONG = 10_000
"""Length from which the values of a list are not checked for repetition."""
MOST = 10_000_000
"""Largest number of cases in a study."""


class Span(NamedTuple):
    """Range of numbers that is sampled uniformly, or log-uniformly if `is_log`."""

    low: float
    high: float
    is_log: bool = False

    def at(self, share: float) -> float:
        """Return the number at a fraction of the range.

        >>> Span(1e-3, 1e-1, is_log=True).at(0.5)
        0.01
        """
        if not self.is_log:
            return self.low + share * (self.high - self.low)
        low, high = math.log10(self.low), math.log10(self.high)
        return float(10 ** (low + share * (high - low)))


class Sampling(enum.Enum):
    """Sampling method of the ranges; the value is its name in a file."""

    RANDOM = "random"
    LATIN_HYPERCUBE = "latin-hypercube"
    SOBOL = "sobol"

    def shares(self, count: int, ranges: int, seed: int) -> np.ndarray:
        """Return sample positions (count, ranges) in the unit cube.

        References
        ----------
        .. [1] M. D. McKay, R. J. Beckman, W. J. Conover, A comparison of three methods for
           selecting values of input variables, Technometrics 21, 1979, 239-245.
        .. [2] A. B. Owen, Scrambling Sobol' and Niederreiter-Xing points, Journal of Complexity 14,
           1998, 466-489.
        """
        rng = np.random.default_rng(seed)
        if ranges == 0:
            return np.zeros((count, 0))
        if self is Sampling.RANDOM:
            return rng.random((count, ranges))
        if self is Sampling.LATIN_HYPERCUBE:
            return qmc.LatinHypercube(ranges, rng=rng).random(count)
        whole = 1 << max(count - 1, 0).bit_length()
        return qmc.Sobol(ranges, rng=rng).random(whole)[:count]


class Plan(NamedTuple):
    """Cases of a study, generated on demand: every combination of `listed`, with samples."""

    listed: dict[str, Sequence[Value]]
    spans: dict[str, Span]
    samples: int
    sampling: Sampling
    seed: int
    fixed: Mapping[str, Value]

    def __len__(self) -> int:  # type: ignore[override]
        return math.prod(len(values) for values in self.listed.values()) * self.samples

    def points(self) -> Iterator[Point]:
        """Yield all cases: combinations (last setting fastest), samples within each."""
        shares = self.sampling.shares(self.samples, len(self.spans), self.seed)
        seeds = _seeds_of(self.seed, self.samples)
        drawn = [
            {name: span.at(float(share)) for (name, span), share in zip(self.spans.items(), row)}
            for row in shares
        ]
        number = itertools.count()
        for values in itertools.product(*self.listed.values()):
            given = {**self.fixed, **dict(zip(self.listed, values))}
            for sample, seed in zip(drawn, seeds):
                setting = given | sample
                own = setting.pop(SEED, None)
                yield Point(next(number), setting, seed if own is None else int(own))  # type: ignore


def _seeds_of(seed: int, count: int) -> list[int]:
    """Return the seeds of samples; the first seeds do not depend on the count.

    >>> _seeds_of(1, 3) == _seeds_of(1, 5)[:3]
    True
    """
    words = np.random.SeedSequence(seed).generate_state(count, np.uint64)
    return (words >> np.uint64(11)).tolist()  # 53 bits, which any number can hold


def plan_of(
    vary: Mapping[str, object],
    *,
    fixed: Mapping[str, Value],
    samples: int,
    sampling: Sampling,
    seed: int,
) -> Plan:
    """Return the plan of the cases that a user requests.

    In `vary`, a pair (low, high) is a range. Raises `StudyError` if a list or range is empty, a
    setting is both varied and fixed, or there are too many cases.

    >>> vary = {"problem.N": [9, 18], "nonideal.mismatch": (0.0, 0.02)}
    >>> plan = plan_of(vary, fixed={}, samples=3, sampling=Sampling.SOBOL, seed=0)
    >>> len(plan), [point.setting["problem.N"] for point in plan.points()]
    (6, [9, 9, 9, 18, 18, 18])
    """
    listed: dict[str, Sequence[Value]] = {}
    spans: dict[str, Span] = {}
    for name, given in vary.items():
        if isinstance(given, tuple):
            spans[name] = _span(name, given)
        else:
            listed[name] = _listed(name, given)
    both = sorted({*vary} & {*fixed})
    if both:
        raise StudyError(f"fixed: {both[0]} is varied as well; remove it from one of them")
    plan = Plan(listed, spans, samples, sampling, seed, dict(fixed))
    if len(plan) > MOST:
        raise StudyError(f"vary: {len(plan)} points are more than {MOST}; list fewer values")
    return plan


def _span(name: str, given: tuple) -> Span:
    if not isinstance(given, Span) and len(given) != 2:
        raise StudyError(
            f"vary: {name}: a range is (low, high), or Span(low, high, is_log=True); a list has "
            f"values; got {given!r}"
        )
    try:
        span = given if isinstance(given, Span) else Span(given[0], given[1])
        low, high = float(span.low), float(span.high)
    except (TypeError, ValueError):
        raise StudyError(f"vary: {name}: a range is (low, high), got {given!r}") from None
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise StudyError(f"vary: {name}: the range {low:g} to {high:g} is empty or not finite")
    if span.is_log and low <= 0:
        raise StudyError(f"vary: {name}: a logarithmic range begins above zero, not at {low:g}")
    return span._replace(low=low, high=high)


def _listed(name: str, given: object) -> list[Value]:
    if isinstance(given, (str, bytes)) or not hasattr(given, "__iter__"):
        given = [given]
    values = given.tolist() if isinstance(given, np.ndarray) else list(given)  # type: ignore
    values = [value.item() if isinstance(value, np.generic) else value for value in values]
    if not values:
        raise StudyError(f"vary: {name}: expected one value or more, got none")
    twice = [value for i, value in enumerate(values) if i and value in values[:i]]
    if twice and len(values) < LONG:
        raise StudyError(f"vary: {name}: {twice[0]!r} is listed twice; use samples for repetitions")
    return values
