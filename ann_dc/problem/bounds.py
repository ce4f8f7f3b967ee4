"""Bounds of states and controls: a lower bound, an upper bound, or none.

A bound of a control limits its neuron. A bound of a state is a row at every stage, and at the end
if the state is free there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import sympy as sp

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

    The symbols that may have bounds are given with the states first. Raises `ProblemError` if a
    name is not among them, or if its bounds are not two numbers with the lower one first.
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
                f"bounds: {name!r} is given twice or is none of {', '.join(names)}; only states "
                "and controls have bounds"
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
            f"bounds[{name}]: expected (low, high), None where there is none, got {given!r}"
        )
    low, high = (_bound(name, value, none) for value, none in zip(given, NO_BOUND))
    if not low < high:
        raise ProblemError(
            f"bounds[{name}]: the lower bound {low:g} is not below the upper bound {high:g}; give "
            "low < high, and what is fixed as q_0, as q_d or as a number"
        )
    return low, high


def _bound(name: str, value: Any, none: float) -> float:
    if value is None or (isinstance(value, (float, sp.Expr)) and value == none):
        return none
    if not is_finite(value):
        raise ProblemError(
            f"bounds[{name}]: {value!r} is no finite number; give one, or None where there is none"
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
    """Return checked relations, then ``x_low``, ``x_high`` of bounded states, as rows.

    Parameters
    ----------
    states : sequence of Symbol
        States whose bounds become rows.
    in_states : function, optional
        Rewrites a formula in states, controls and inputs only.
    soft : mapping of str to Soft, optional
        Rows that may be violated, by name.
    inputs : iterable of Symbol
        Inputs; those named `ROOM` relax their rows.
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
