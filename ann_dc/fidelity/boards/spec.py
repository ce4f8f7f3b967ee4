"""What is asked of every circuit: an error of its controls, a settling time, or that it settles.

A spec is written as text, ``error<1%, settle<50us``, and read term by term.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ann_dc.errors import NetworkError
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Positive

TERM = re.compile(r"(error|settle)\s*<=?\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(%|[munµμ]?s|)")
"""A limit: what, how much, in which unit."""

UNITS = {
    "error": {"": 1.0, "%": 1e-2},
    "settle": {"s": 1.0, "ms": 1e-3, **dict.fromkeys(("us", "µs", "μs"), 1e-6), "ns": 1e-9},
}
"""What a unit stands for: shares of the largest control, seconds."""

STABLE = "stable"
"""A term that asks for no more than that a circuit settles, as every spec does."""


@checked
@dataclass(frozen=True, kw_only=True)
class Spec:
    """Limits that a circuit keeps, or not; one that does not settle keeps none.

    Attributes
    ----------
    error : float
        Of the settled controls, over the largest one.
    settling_time : float
        Seconds until every control stays within 0.1 %.

    Examples
    --------
    >>> print(Spec(error=0.01, settling_time=5e-5))
    error<1%, settle<50us
    """

    error: Positive = math.inf
    settling_time: Positive = math.inf

    @property
    def limits(self) -> dict[str, float]:
        """The finite ones, by name."""
        given = {"error": self.error, "settling_time": self.settling_time}
        return {name: limit for name, limit in given.items() if math.isfinite(limit)}

    def excess(self, error: float, settling_time: float) -> float:
        """How many times the limit the worse of two figures is; 1 at most within the spec.

        Parameters
        ----------
        error, settling_time : float

        Returns
        -------
        float
            Infinite where a figure that counts is nan; zero where nothing has a limit.
        """
        figures = {"error": error, "settling_time": settling_time}
        shares = [figures[name] / limit for name, limit in self.limits.items()]
        return max((math.inf if math.isnan(share) else share for share in shares), default=0.0)

    def __str__(self) -> str:
        words = [f"error<{100 * self.error:g}%"] if math.isfinite(self.error) else []
        if math.isfinite(self.settling_time):
            words.append(f"settle<{1e6 * self.settling_time:g}us")
        return ", ".join(words) or STABLE


@checked
def spec_of(text: str) -> Spec:
    """Read a spec.

    Parameters
    ----------
    text : str
        Terms with commas: ``error<1%`` or ``error<0.01``, ``settle<50us`` (s, ms, us, ns),
        ``stable``.

    Returns
    -------
    Spec

    Raises
    ------
    NetworkError
        If a term is none, stands there twice, or its limit is not positive.

    Examples
    --------
    >>> spec_of("error < 0.5%, settle<2s").limits
    {'error': 0.005, 'settling_time': 2.0}
    """
    found: dict[str, float] = {}
    for term in text.lower().split(","):
        word = term.strip()
        if word == STABLE:
            continue
        match = TERM.fullmatch(word)
        what, number, unit = match.groups() if match else ("", "", "")
        _check_unit(what, number, unit, word)
        limit = _limit(number) * UNITS.get(what, {}).get(unit, math.nan)
        name = "error" if what == "error" else "settling_time"
        if not 0 < limit < math.inf or name in found:
            raise NetworkError(
                "spec: expected terms with commas, each once, with < and a number above 0, such "
                f"as error<1%, settle<50us or stable; got {term.strip()!r} in {text!r}"
            )
        found[name] = limit
    return Spec(**found)


def _check_unit(what: str, number: str, unit: str, word: str) -> None:
    """Refuse a number that stands for another one than was meant, most likely."""
    if what == "settle" and not unit:
        raise NetworkError(f"spec: {word!r} needs ns, us, ms or s, such as settle<50us")
    if what == "error" and not unit and 1 <= _limit(number) < math.inf:
        raise NetworkError(
            f"spec: {word!r} is {100 * _limit(number):g} % of the largest control; write "
            f"error<{number}% if that is meant, or a share below 1"
        )


def _limit(number: str) -> float:
    try:
        return float(number)
    except ValueError:
        return math.nan
