"""Domain of a problem: paths at which map, cost and inequalities have finite slopes.

``log(c)`` and its slope are not finite at c = 0, ``sqrt(a**2 + b**2)`` has no slope where a and b
are zero. A start there is moved into the domain.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import sympy as sp

SIZES = (1.0, 0.1, 10.0, 0.01, 100.0)
"""Controls that are tried where the cheapest ones lie outside the domain."""
HALVINGS = 20
"""Halvings of a step that leads out of the domain, at most."""


def terms(problem: Any, q: np.ndarray, u: np.ndarray) -> list[tuple[str, Any, np.ndarray]]:
    """Return map, cost and inequalities at a path: name, expression, and where they are defined.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N) array
        States without the end, in the user's units.
    u : (m, N) array

    Returns
    -------
    list of (str, sympy expressions, (N,) array of bool)
        True where value and slope are finite.
    """
    functions = problem.functions
    rows = zip(problem.inequalities, *functions.rows(q, u))
    parts = [
        ("the map f", problem.f, (functions.map(q, u), *functions.map_jacobian(q, u))),
        ("the cost", (problem.l,), (functions.cost(q, u), *functions.cost_gradient(q, u))),
    ]
    parts += [(f"the inequality {r.name}", (r.expression,), told) for r, *told in rows]
    return [(name, expressions, _finite(told, u.shape[1])) for name, expressions, told in parts]


def _finite(parts: Iterable[np.ndarray], stages: int) -> np.ndarray:
    good = np.ones(stages, bool)
    for part in parts:
        good &= np.isfinite(part).reshape(-1, stages).all(axis=0)
    return good


def defined(problem: Any, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return the stages (N,) at which all values and slopes are finite, as booleans.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N) array
        States without the end, in the user's units.
    u : (m, N) array
    """
    with np.errstate(all="ignore"):
        return np.all([good for _, _, good in terms(problem, q, u)], axis=0)


def into_domain(problem: Any, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return controls that are moved into the domain at the stages that are not in it.

    To the middle of their limits, or else to the first of `SIZES`, with equal or alternating signs,
    at which the most stages are defined.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N) array
        States without the end, in the user's units.
    u : (m, N) array
    """
    bad = ~defined(problem, q, u)
    if not bad.any():
        return u
    low, high = problem.control_limits.T
    middle = np.where(np.isfinite(low + high), 0.5 * (low + high), np.nan)
    signs = np.ones(len(u)), -np.ones(len(u)), (-1.0) ** np.arange(len(u))
    best, most = u, (~bad).sum()
    for size in SIZES:
        for sign in signs:
            way = np.clip(np.where(np.isnan(middle), size * sign, middle), low, high)
            moved = np.where(bad, way[:, None], u)
            count = defined(problem, q, moved).sum()
            if count > most:
                best, most = moved, count
            if most == u.shape[1]:
                return best
    return best


def within_domain(problem: Any, q: np.ndarray, u: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return ``u + step``, with the step halved at stages at which it leads out of the domain.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N) array
        States without the end, in the user's units.
    u, step : (m, N) arrays
        Controls in the domain, and what is added to them.
    """
    share, bad = np.ones(u.shape[1]), np.zeros(u.shape[1], bool)
    for _ in range(HALVINGS):
        bad = ~defined(problem, q, u + share * step)
        if not bad.any():
            return u + share * step
        share = np.where(bad, share / 2, share)
    return u + np.where(bad, 0.0, share) * step


def culprit(expressions: Iterable[Any], values: dict[Any, float]) -> str:
    """Return the first function in some expressions that is not finite with its slope, as text.

    Parameters
    ----------
    expressions : iterable of sympy.Expr
    values : dict of symbol to float
        States, controls and inputs.

    Examples
    --------
    >>> c, k = sp.symbols("c k")
    >>> culprit([k - sp.log(c)], {c: 0.0, k: 10.0})
    'log(c)'
    """
    for expression in expressions:
        for atom in sorted(expression.atoms(sp.Function, sp.Pow), key=sp.default_sort_key):
            argument = sp.Dummy("argument")
            outer = atom.func(argument, *atom.args[1:])
            at = atom.args[0].subs(values)
            told = (outer.subs(argument, at), outer.diff(argument).subs(argument, at))
            if not all(value.is_finite for value in told):
                return str(atom)
    return ""
