"""Inequalities that q_0 or q_d breaks already: nothing that a network chooses could make them hold.

A row of the stages is looked at in stage 0, one of the end in q_N, each where the end fixes all
states that it names and no control stands in it. Soft rows may be broken.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.bounds import NO_BOUND, Bounds
from ann_dc.problem.inequality import Inequality, row_name

ROUNDING = 1e-9
"""Of the terms of a row, and of one: an end may lie on the boundary, to rounding."""


def check_ends(
    states: Sequence[sp.Symbol],
    rows: Sequence[Sequence[Inequality]],
    ends: Sequence[Sequence[float | None]],
    inputs: Mapping[sp.Symbol, Any],
    bounds: Bounds,
) -> None:
    """Refuse rows and bounds that the ends break, whatever is chosen, unless they are soft.

    Parameters
    ----------
    states : sequence of n symbols
    rows : two sequences of Inequality
        Those of the stages, and those of the end.
    ends : two sequences of n floats or None
        q_0 and q_d.
    inputs : mapping of Symbol to (N,) array
    bounds : mapping of str to (low, high)

    Raises
    ------
    ProblemError
        With the name of the row, its value and the states that it reads.

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
    """A ProblemError where q_0 or q_d lies outside the bounds of its state."""
    low, high = bounds.get(name, NO_BOUND)
    below = value is not None and value < low and row_name(name, "low") not in soft
    above = value is not None and value > high and row_name(name, "high") not in soft
    if below or above:
        raise ProblemError(
            f"bounds[{name}]: {end} sets it to {value:g}, outside {low:g} to {high:g}; widen "
            f"the bounds, change {end}, or leave it free there (None)"
        )


def _fault(row: Inequality, known: dict[Any, Any]) -> str:
    """What is wrong with a row where all that it reads is known; empty where it holds."""
    terms = [term.evalf(subs=known) for term in sp.Add.make_args(row.expression)]
    value = sp.Add(*terms)
    if not (value.is_real and value.is_finite):
        return "it has no finite value there"
    held = value <= ROUNDING * (1 + sp.Add(*map(abs, terms)))
    return "" if held else f"it is {float(value):.4g} there"
