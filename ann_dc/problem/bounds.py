"""Bounds of states and controls: a lower bound, an upper bound, or none.

A bound of a control limits its neuron. A bound of a state is a row at every stage, and at the end
if the state is free there.

SymPy simplifies formulas with the assumptions of a symbol: sqrt(x**2) becomes x if x is positive. A
network solves for real numbers that vary continuously, so a sign assumption is stored as a bound,
and other assumptions (integer, nonzero, imaginary) are rejected. Inputs have no bounds, so a sign
assumption of an input is rejected too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import sympy as sp
from sympy.core.facts import InconsistentAssumptions

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import is_finite, is_vector
from ann_dc.problem.inequality import Inequality, excess, row_name

ROOM = "room_{}"
"""Input that relaxes a row at stages at which no variable can change the row
(`decomposition.held`).
"""
NO_BOUND = (-math.inf, math.inf)

Bounds: TypeAlias = Mapping[str, Any]
"""Pair (low, high) by name."""

End: TypeAlias = Sequence[float | None] | None


def bounds_of(given: Any, symbols: Sequence[sp.Symbol]) -> dict[str, tuple[float, float]]:
    """Return the checked bounds (low, high) by name, infinite if a bound is missing.

    Raises `ProblemError` if a name is none of the symbols' (states first), or if its bounds are not
    two numbers with the lower one first.
    """
    if not isinstance(given, Mapping):
        raise ProblemError(
            f'bounds: expected a mapping of name to (low, high), such as {{"x": (0, None)}}, got '
            f"{given!r}"
        )
    names = [symbol.name for symbol in symbols]
    checked: dict[str, tuple[float, float]] = {}
    for key, pair in given.items():
        name = key.name if isinstance(key, sp.Symbol) else key
        if name in checked or not isinstance(name, str) or name not in names:
            raise ProblemError(
                f"bounds: {name!r} is specified twice or is none of {', '.join(names)}; only "
                "states and controls have bounds"
            )
        checked[name] = _pair(name, pair)
    return {name: pair for name, pair in checked.items() if pair != NO_BOUND}


def widths(bounds: Bounds, symbols: Sequence[sp.Symbol]) -> np.ndarray:
    """Return the width high - low of each symbol, infinite if a bound is missing."""
    low, high = np.array([bounds.get(symbol.name, NO_BOUND) for symbol in symbols], float).T
    return high - low


def _pair(name: str, given: Any) -> tuple[float, float]:
    if not is_vector(given, 2):
        raise ProblemError(
            f"bounds[{name}]: expected (low, high) with None for no bound, got {given!r}"
        )
    low, high = (_bound(name, value, none) for value, none in zip(given, NO_BOUND))
    if not low < high:
        raise ProblemError(
            f"bounds[{name}]: the lower bound {low:g} is not below the upper bound {high:g}; "
            "use low < high, and declare fixed values as q_0, q_d or numbers"
        )
    return low, high


def _bound(name: str, value: Any, none: float) -> float:
    if value is None or (isinstance(value, (float, sp.Expr)) and value == none):
        return none
    if not is_finite(value):
        raise ProblemError(
            f"bounds[{name}]: expected a finite number or None, got {value!r}; use "
            "constraints= for bounds that vary, and terminal_constraints= if the end is free"
        )
    return float(value)


def rows_of(
    relations: Any,
    bounds: Bounds,
    states: Sequence[sp.Symbol],
    in_states: Callable[[Any], Any] = lambda formula: formula,
    soft: Any = None,
    inputs: Iterable[sp.Symbol] = (),
) -> tuple[Inequality, ...]:
    """Return checked relations, then ``x_low``, ``x_high`` of the given bounded states, as rows.

    Formulas are rewritten by ``in_states`` to contain states, controls and inputs only. Inputs
    named `ROOM` relax their rows.
    """
    named = {symbol.name: symbol for symbol in inputs}
    rows = {name: in_states(excess(relation)) for name, relation in relations.items()}
    for state in states:
        low, high = bounds.get(state.name, NO_BOUND)
        if low > -math.inf:
            rows[row_name(state.name, "low")] = low - state
        if high < math.inf:
            rows[row_name(state.name, "high")] = state - high
    prices = soft or {}
    return tuple(
        Inequality(
            name=name,
            expression=g - named.get(ROOM.format(name), 0),
            soft=prices.get(name),
        )
        for name, g in rows.items()
    )


def limits_of(bounds: Bounds, controls: Sequence[sp.Symbol]) -> np.ndarray:
    """Return the bounds (m, 2) of the controls, infinite if there is none; read-only."""
    limits = np.array([bounds.get(u.name, NO_BOUND) for u in controls], float)
    limits.setflags(write=False)
    return limits


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

    Raises `ProblemError` if an assumption is not a bound or contradicts a bound.
    """
    found = dict(bounds)
    for symbol in symbols:
        low, high = _range(symbol)
        given = found.get(symbol.name, (low, high))
        if given[0] < low or given[1] > high:
            raise ProblemError(
                f"bounds[{symbol}]: {given[0]:g} to {given[1]:g} contradicts "
                f"{_reported(symbol)}; use bounds on one side of zero, or declare it as "
                f"sp.Symbol({symbol.name!r})"
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
                f"inputs[{symbol}]: expected a symbol of any sign, got {_reported(symbol)}, "
                f"which a network does not enforce; declare it as sp.Symbol({symbol.name!r})"
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
            f"{_reported(symbol)}, which a network does not enforce; declare it as "
            f"sp.Symbol({symbol.name!r})"
        )
    return low, high


def _reported(symbol: sp.Symbol) -> str:
    """Return the assumptions that the user gave, without those implied by others."""
    facts = {f: v for f, v in symbol.assumptions0.items() if REAL.get(f) != v}
    for fact, value in sorted(facts.items(), key=lambda item: (not item[1], len(item[0]))):
        implied = sp.Symbol(symbol.name, **{fact: value}).assumptions0
        if facts.items() <= implied.items():
            return f"the assumption {fact}={value}"
    return "the assumptions " + ", ".join(f"{fact}={value}" for fact, value in facts.items())


ROUNDING = 1e-9
"""Rounding tolerance relative to the sum of one and the magnitudes of a row's terms; an end may lie
on the boundary.
"""


def check_ends(
    states: Sequence[sp.Symbol],
    rows: Sequence[Sequence[Inequality]],
    ends: Sequence[Sequence[float | None]],
    inputs: Mapping[sp.Symbol, Any],
    bounds: Bounds,
) -> None:
    """Raise a `ProblemError` for hard rows and bounds that the boundary conditions violate.

    The rows are those of the stages, checked in stage 0, and of the end, checked at q_N, if the end
    fixes all states of the row and the row contains no control.
    """
    soft = {row.name for row in rows[0] if row.soft}
    for name, end in zip(("q_0", "q_d"), ends):
        for state, value in zip(states, end):
            _check_bounds(name, str(state), value, bounds, soft)
    fields, names, stages = ("constraints", "terminal_constraints"), ("q_0", "q_d"), (0, -1)
    for field, group, name, end, stage in zip(fields, rows, names, ends, stages):
        known = {s: value for s, value in zip(states, end) if value is not None}
        data = {s: values[stage] for s, values in inputs.items()}
        for row in group:
            read = row.expression.free_symbols
            if (
                row.soft is None
                and read <= known.keys() | data.keys()
                and (fault := _fault(row, known | data))
            ):
                at = ", ".join(f"{s} = {value:g}" for s, value in known.items() if s in read)
                raise ProblemError(
                    f"{field}[{row.name}]: {name} ({at}) violates it for all controls: "
                    f"{row.expression} <= 0 is required, but {fault}; move {name}, free one of "
                    "its components (None), or change the relation"
                )


def _check_bounds(
    end: str, name: str, value: float | None, bounds: Bounds, soft: Collection[str]
) -> None:
    """Raise a `ProblemError` if q_0 or q_d lies outside the bounds of its state."""
    low, high = bounds.get(name, NO_BOUND)
    below = value is not None and value < low and row_name(name, "low") not in soft
    above = value is not None and value > high and row_name(name, "high") not in soft
    if below or above:
        raise ProblemError(
            f"bounds[{name}]: {end} sets it to {value:g}, outside {low:g} to {high:g}; widen "
            f"the bounds, change {end}, or leave it free there (None)"
        )


def _fault(row: Inequality, known: dict[Any, Any]) -> str:
    """Return a description of a row's violation for known values, empty if satisfied."""
    terms = [term.evalf(subs=known) for term in sp.Add.make_args(row.expression)]
    value = sp.Add(*terms)
    if not (value.is_real and value.is_finite):
        return "it has no finite value there"
    held = value <= ROUNDING * (1 + sp.Add(*map(abs, terms)))
    return "" if held else f"it is {float(value):.4g} there"
