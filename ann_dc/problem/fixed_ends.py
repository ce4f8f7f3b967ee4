"""Inequalities that q_0 or q_d already violates and that no solution can satisfy.

A stage row is checked in stage 0 and an end row at q_N, if the end fixes all states of the row and
the row contains no control. Soft rows may be violated.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.bounds import NO_BOUND, Bounds
from ann_dc.problem.inequality import Inequality, row_name

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
    """Raise an error for hard rows and bounds that the boundary conditions violate.

    The rows are those of the stages and those of the end; the ends are q_0 and q_d, with None for a
    free component. Raises `ProblemError` with the name of the row, its value and the states in it.
    Soft rows are not checked.

    Examples
    --------
    >>> x = sp.Symbol("x")
    >>> disc = Inequality(name="disc", expression=1 - x**2)
    >>> check_ends((x,), ((disc,), ()), ((2.0,), (None,)), {}, {})
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
                    f"{field}[{row.name}]: {name} ({at}) breaks it, whatever is chosen: "
                    f"{row.expression} <= 0 is asked, and {fault}; move {name}, free one of its "
                    "components (None), or change the relation"
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
