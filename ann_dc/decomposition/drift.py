"""Splitting of the map as in the paper: q, drift without controls, and dt B(q) u."""

from __future__ import annotations

from typing import Any

import sympy as sp

from ann_dc.errors import FormError
from ann_dc.problem.declaration import OptimalControlProblem


def at_rest(problem: OptimalControlProblem) -> dict[Any, Any]:
    """Return a substitution that sets every control to zero."""
    return {u: sp.Integer(0) for u in problem.controls}


def drift_and_drive(problem: OptimalControlProblem) -> list[tuple[sp.Expr, sp.Expr]]:
    """Return f(q, 0) - q and f(q, u) - f(q, 0) for every state.

    Raises `FormError` if the map has no value without controls.

    Examples
    --------
    >>> from ann_dc import plants
    >>> drift_and_drive(plants.car())[0]
    (-0.01*x, 0.1*nu*cos(phi))
    """
    parts = []
    for q, f in zip(problem.states, problem.f):
        still = f.subs(at_rest(problem))
        drift, driven = sp.expand(still - q), sp.expand(f - still)
        if drift.has(sp.nan, sp.zoo):
            raise FormError(
                "S4, S6, S17: the map has no value at u = 0, so drift and control part "
                "cannot be told apart; leave these switches off"
            )
        parts.append((drift, driven))
    return parts
