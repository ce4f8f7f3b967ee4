"""SymPy assumptions of declared symbols: stored as bounds, or rejected.

SymPy simplifies formulas with the assumptions of a symbol: sqrt(x**2) becomes x if x is positive. A
network solves for real numbers that vary continuously, so other assumptions (integer, nonzero,
imaginary) would be violated. A sign assumption is valid only as a bound. Inputs have no bounds, so
a sign assumption of an input is rejected.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

import sympy as sp
from sympy.core.facts import InconsistentAssumptions

from ann_dc.errors import ProblemError
from ann_dc.problem.bounds import NO_BOUND

REAL: dict[str, bool] = sp.Symbol("x", real=True).assumptions0
"""Assumptions that every real number fulfils."""
SIGNS = {
    f"{extended}{sign}"
    for extended in ("", "extended_")
    for sign in ("positive", "negative", "nonnegative", "nonpositive", "zero", "nonzero")
}
"""Assumptions about the sign of a symbol."""


def bounds_assumed(
    bounds: Mapping[str, tuple[float, float]], symbols: Sequence[sp.Symbol]
) -> dict[str, tuple[float, float]]:
    """Return the bounds of states and controls, with those implied by assumptions.

    Raises `ProblemError` with the name of the symbol if an assumption is not a bound or contradicts
    a bound.

    Examples
    --------
    >>> bounds_assumed({}, [sp.Symbol("a", positive=True), sp.Symbol("b")])
    {'a': (0.0, inf)}
    """
    found = dict(bounds)
    for symbol in symbols:
        low, high = _range(symbol)
        given = found.get(symbol.name, (low, high))
        if given[0] < low or given[1] > high:
            raise ProblemError(
                f"bounds[{symbol}]: {given[0]:g} to {given[1]:g} contradicts {_told(symbol)}; give "
                f"bounds on one side of zero, or declare it as sp.Symbol({symbol.name!r})"
            )
        if given != NO_BOUND:
            found[symbol.name] = given
    return found


def check_inputs(inputs: Iterable[sp.Symbol]) -> None:
    """Raise a `ProblemError` if an input has a sign assumption.

    A network accepts any value of its inputs.
    """
    for symbol in inputs:
        if _range(symbol) != NO_BOUND:
            raise ProblemError(
                f"inputs[{symbol}]: expected a symbol that may have either sign, got "
                f"{_told(symbol)}, which a network does not keep; declare it as "
                f"sp.Symbol({symbol.name!r})"
            )


def _range(symbol: sp.Symbol) -> tuple[float, float]:
    """Return the interval of real numbers that a symbol's assumptions allow."""
    signs = {fact: value for fact, value in symbol.assumptions0.items() if fact in SIGNS}
    try:
        signed = sp.Symbol(symbol.name, real=True, **signs)
    except InconsistentAssumptions:
        signed = sp.Symbol(symbol.name, zero=True)
    low = 0.0 if signed.is_nonnegative else -math.inf
    high = 0.0 if signed.is_nonpositive else math.inf
    is_kept = symbol.assumptions0.items() <= signed.assumptions0.items()
    if not is_kept or signed.is_zero or (signed.is_nonzero and (low, high) == NO_BOUND):
        raise ProblemError(
            f"{symbol}: expected a real number that varies continuously, got a symbol with "
            f"{_told(symbol)}, which a network does not keep; declare it as "
            f"sp.Symbol({symbol.name!r})"
        )
    return low, high


def _told(symbol: sp.Symbol) -> str:
    """Return the assumptions that the user gave, without those implied by others."""
    facts = {f: v for f, v in symbol.assumptions0.items() if REAL.get(f) != v}
    for fact, value in sorted(facts.items(), key=lambda item: (not item[1], len(item[0]))):
        implied = sp.Symbol(symbol.name, **{fact: value}).assumptions0
        if facts.items() <= implied.items():
            return f"the assumption {fact}={value}"
    return "the assumptions " + ", ".join(f"{fact}={value}" for fact, value in facts.items())
