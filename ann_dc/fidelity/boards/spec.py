"""Specification of a circuit: limits of error and settling time, or stability."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ann_dc.errors import NetworkError
from ann_dc.validation import Positive, checked

TERM = re.compile(r"(error|settle)\s*<=?\s*([0-9.]+(?:e[+-]?[0-9]+)?)\s*(%|[munµμ]?s|)")
"""Pattern of a limit: quantity, value and unit."""

UNITS = {
    "error": {"": 1.0, "%": 1e-2},
    "settle": {"s": 1.0, "ms": 1e-3, **dict.fromkeys(("us", "µs", "μs"), 1e-6), "ns": 1e-9},
}
"""Factors of the units: fractions of the largest control, and seconds."""

STABLE = "stable"
"""Term that requires only that a circuit settles, as every specification does."""


@checked
@dataclass(frozen=True, kw_only=True)
class Spec:
    """Limits of a circuit; a circuit that does not settle fails all limits.

    ``error`` limits the error of the settled controls, relative to the largest control, and
    ``settling_time`` the seconds until every control stays within 0.1 %.
    """

    error: Positive = math.inf
    settling_time: Positive = math.inf

    @property
    def limits(self) -> dict[str, float]:
        """Finite limits, by name."""
        given = {"error": self.error, "settling_time": self.settling_time}
        return {name: limit for name, limit in given.items() if math.isfinite(limit)}

    def excess(self, error: float, settling_time: float) -> float:
        """Return the larger ratio of the two figures to their limits; 1 is still met.

        The ratio is infinite if a limited figure is nan, and zero if no figure is limited.
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
    """Parse a specification, ``error<1%, settle<50us``, term by term.

    The terms are ``error<1%`` or ``error<0.01``, ``settle<50us`` (s, ms, us, ns) and ``stable``.
    Raises `NetworkError` if a term is invalid or repeated, or if its limit is not positive.

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
    """Raise `NetworkError` if number and unit are probably a mistake."""
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
