"""Domain of a problem: paths with finite slopes of map, cost and inequalities.

For example, ``log(c)`` and its slope are not finite at c = 0, and ``sqrt(a**2 + b**2)`` has no
slope at a = b = 0. An initial guess outside the domain is moved into the domain.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import sympy as sp

SIZES = (1.0, 0.1, 10.0, 0.01, 100.0)
"""Trial sizes of controls, used if the cheapest controls lie outside the domain."""
HALVINGS = 20
"""Maximum number of halvings of a step that leads out of the domain."""


def terms(problem: Any, q: np.ndarray, u: np.ndarray) -> list[tuple[str, Any, np.ndarray]]:
    """Return map, cost and inequalities on a path: name, expressions and defined stages (N,).

    A stage is defined if value and slope are finite. States (n, N) exclude the end.
    """
    functions = problem.functions
    rows = zip(problem.inequalities, *functions.rows(q, u))
    parts = [
        ("the map f", problem.f, (functions.map(q, u), *functions.map_jacobian(q, u))),
        ("the cost", (problem.l,), (functions.cost(q, u), *functions.cost_gradient(q, u))),
    ]
    parts += [(f"the inequality {r.name}", (r.expression,), reported) for r, *reported in rows]
    return [
        (name, expressions, _finite(reported, u.shape[1])) for name, expressions, reported in parts
    ]


def _finite(parts: Iterable[np.ndarray], stages: int) -> np.ndarray:
    good = np.ones(stages, bool)
    for part in parts:
        good &= np.isfinite(part).reshape(-1, stages).all(axis=0)
    return good


def defined(problem: Any, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return (N,) booleans: True if all values and slopes of a stage are finite.

    States q (n, N), without the end, and controls u (m, N) are in the user's units.
    """
    with np.errstate(all="ignore"):
        return np.all([good for _, _, good in terms(problem, q, u)], axis=0)


def into_domain(problem: Any, q: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return controls (m, N), moved into the domain at stages that lie outside.

    A control moves to the middle of its limits, or otherwise to a value of `SIZES`, with equal or
    alternating signs. The first value with all stages defined is used, or otherwise the one with
    most. States (n, N) exclude the end.
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
    """Return ``u + step``, with the step halved at stages that leave the domain.

    The controls u (m, N) lie in the domain. After `HALVINGS` halvings the step of a stage is zero.
    """
    share, bad = np.ones(u.shape[1]), np.zeros(u.shape[1], bool)
    for _ in range(HALVINGS):
        bad = ~defined(problem, q, u + share * step)
        if not bad.any():
            return u + share * step
        share = np.where(bad, share / 2, share)
    return u + np.where(bad, 0.0, share) * step


def culprit(expressions: Iterable[Any], values: dict[Any, float]) -> str:
    """Return the first function that is not finite with its slope, as text, such as "log(c)".

    The values of states, controls and inputs are given by symbol.
    """
    for expression in expressions:
        for atom in sorted(expression.atoms(sp.Function, sp.Pow), key=sp.default_sort_key):
            argument = sp.Dummy("argument")
            outer = atom.func(argument, *atom.args[1:])
            at = atom.args[0].subs(values)
            reported = (outer.subs(argument, at), outer.diff(argument).subs(argument, at))
            if not all(value.is_finite for value in reported):
                return str(atom)
    return ""
