"""Bounds of states and controls: a number below, a number above, or none.

A bound of a control limits its neuron. A bound of a state is a row, at every stage and at the end
where that is free.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.constraints.inequality import Inequality
from ann_dc.problem.fields import is_finite, is_vector

NO_BOUND = (-math.inf, math.inf)

Bounds: TypeAlias = Mapping[str, tuple[float, float]]


def bounds_of(given: Any, names: Sequence[str]) -> dict[str, tuple[float, float]]:
    """(low, high) by name, infinite where there is none.

    Parameters
    ----------
    given : mapping of str or Symbol to (low, high)
    names : sequence of str
        What may have bounds.

    Raises
    ------
    ProblemError
        If a name is none of these, or its bounds are no two numbers, the lower one first.
    """
    if not isinstance(given, Mapping):
        raise ProblemError(
            f'bounds: expected a mapping of name to (low, high), such as {{"x": (0, None)}}, got '
            f"{given!r}"
        )
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
    if value is None or (isinstance(value, float) and value == none):
        return none
    if not is_finite(value):
        raise ProblemError(
            f"bounds[{name}]: {value!r} is no finite number; give one, or None where there is none"
        )
    return float(value)


def check_ends(
    bounds: Bounds,
    states: Sequence[sp.Symbol],
    q_0: Sequence[float | None],
    q_d: Sequence[float | None],
) -> None:
    """A ProblemError where q_0 or q_d lies outside the bounds of its state."""
    for end, values in (("q_0", q_0), ("q_d", q_d)):
        for state, value in zip(states, values):
            low, high = bounds.get(str(state), NO_BOUND)
            if value is not None and not low <= value <= high:
                raise ProblemError(
                    f"bounds[{state}]: {end} sets it to {value:g}, outside {low:g} to {high:g}; "
                    f"widen the bounds, change {end}, or leave it free there (None)"
                )


def rows_of(bounds: Bounds, states: Sequence[sp.Symbol]) -> tuple[Inequality, ...]:
    """Rows ``x_low`` and ``x_high`` of those of the states that are bounded."""
    rows = []
    for state in states:
        low, high = bounds.get(str(state), NO_BOUND)
        if low > -math.inf:
            rows.append(Inequality(name=f"{state}_low", expression=low - state))
        if high < math.inf:
            rows.append(Inequality(name=f"{state}_high", expression=state - high))
    return tuple(rows)


def limits_of(bounds: Bounds, controls: Sequence[sp.Symbol]) -> np.ndarray:
    """Bounds (m, 2) of the controls, infinite where there is none; read-only."""
    limits = np.array([bounds.get(str(u), NO_BOUND) for u in controls], float)
    limits.setflags(write=False)
    return limits
