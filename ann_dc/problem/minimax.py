r"""Minimax objectives: the largest of several objectives plus a common cost.

.. math::
    \min\; \sum_k l(q_k, u_k) + l_N(q_N) + \max_i w_i J_i, \qquad J_i = \sum_k l_i(q_k, u_k),

which is (6) of the paper. At an optimum this is the problem with the single cost

.. math:: l + \sum_i \zeta_i w_i l_i, \qquad \zeta_i \ge 0, \qquad \sum_i \zeta_i = 1.

The coefficients zeta are zero for objectives that are not the largest. The cost of a problem
contains them as symbols; the network determines their values, and the problem itself uses equal
ones (`OptimalControlProblem.shares`).

At a temperature T > 0 the maximum is softened to T log sum_i exp(w_i J_i / T), and zeta_i is
proportional to exp(w_i J_i / T). The soft maximum exceeds the maximum by at most T log p, and so
does its optimum.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
import sympy as sp

from ann_dc.errors import ProblemError
from ann_dc.problem.fields import by_name, check_names, is_finite, smooth_expression

Objectives: TypeAlias = Any
"""Expressions by name or in a sequence; by name once they are declared."""
Weights: TypeAlias = Any
"""Numbers by the name of their objective or in its order; by name once they are declared."""

WHOLE = 1e-9
"""Tolerance of the sum of weights, which must be one."""


def objectives_of(given: Any, known: set[sp.Symbol], chosen: set[sp.Symbol]) -> dict[str, sp.Expr]:
    """Return objectives by name, each a smooth stage cost of a state or control (``chosen``).

    Raises `ProblemError` if there is only one, or if one has an invalid name or unknown symbols.
    """
    named = _by_name(given)
    if len(named) == 1:
        raise ProblemError("objectives: expected two or more; declare a single objective as cost")
    symbols = [sp.Symbol(name) for name in named if isinstance(name, str)]
    if len(symbols) < len(named):
        raise ProblemError(f'objectives: expected names such as "effort", got {list(named)!r}')
    check_names(symbols, [])
    taken = {str(symbol) for symbol in known} & {str(share_symbol(name)) for name in named}
    if taken:
        raise ProblemError(
            f"objectives: the name {', '.join(sorted(taken))} is reserved for a weight"
        )
    checked = {}
    for name, expression in named.items():
        checked[name] = smooth_expression(f"objectives[{name}]", expression, known)
        if not checked[name].free_symbols & chosen:
            raise ProblemError(
                f"objectives[{name}]: {expression} has none of "
                f"{', '.join(sorted(map(str, chosen)))} and cannot be influenced; omit it"
            )
    return checked


def weights_of(given: Any, objectives: Any) -> dict[str, float]:
    """Return weights by the name of their objective; empty if none are given.

    Raises `ProblemError` unless there is a non-negative one per objective and their sum is one.
    """
    if given is None or (isinstance(given, Mapping) and not given):
        return {}
    names = list(_by_name(objectives))
    if not names:
        raise ProblemError("weights: the problem has no objectives; add objectives")
    weights = dict(given) if isinstance(given, Mapping) else None
    if isinstance(given, (list, tuple, np.ndarray)) and len(given) == len(names):
        weights = dict(zip(names, given))
    if weights is None or set(weights) != set(names):
        raise ProblemError(
            f"weights: expected one for each of the objectives {', '.join(map(str, names))}, got "
            f"{given!r}"
        )
    for name, weight in weights.items():
        if not (is_finite(weight) and weight >= 0):
            raise ProblemError(f"weights[{name}]: expected zero or a positive number: {weight!r}")
    if not math.isclose(sum(weights.values()), 1.0, abs_tol=WHOLE):
        raise ProblemError(
            f"weights: {', '.join(f'{w:g}' for w in weights.values())} add up to "
            f"{sum(weights.values()):g}; expected a sum of 1"
        )
    return {name: float(weights[name]) for name in names}


def temperature_of(given: Any, objectives: Any) -> float:
    """Return the temperature as a float.

    Raises `ProblemError` if the value is negative or not a number, or without objectives.
    """
    if not (is_finite(given) and given >= 0):
        raise ProblemError(f"temperature: expected zero or a positive number, got {given!r}")
    if given and not objectives:
        raise ProblemError("temperature: the problem has no objectives; add objectives")
    return float(given)


def weight_inputs(weights: Mapping[str, float]) -> dict[sp.Symbol, float]:
    """Return weights as network inputs, which may change without rewiring."""
    return {weight_symbol(name): weight for name, weight in weights.items()}


def _by_name(given: Any) -> dict[Any, Any]:
    return by_name("objectives", given, "J", "expressions, or a mapping of name to expression")


def weight_symbol(name: str) -> sp.Symbol:
    """Return the input w_i of an objective."""
    return sp.Symbol(f"weight_{name}")


def share_symbol(name: str) -> sp.Symbol:
    """Return the coefficient zeta_i of an objective."""
    return sp.Symbol(f"share_{name}")


def weights_among(weights: Any, inputs: Mapping[sp.Symbol, Any]) -> dict[str, Any] | None:
    """Return the weights in the given inputs, or None if there are none."""
    found = {name: np.unique(inputs[weight_symbol(name)]) for name in weights}
    return {name: v.item() if v.size == 1 else v for name, v in found.items()} or None


def normalised(problem: Any, ideal: np.ndarray, nadir: np.ndarray) -> Any:
    """Return a problem normalised to 0 at the ``ideal`` (p,) and 1 at the ``nadir``.

    The objectives have equal weights and zero temperature, so their maximum is minimised.
    """
    objectives = {
        name: (expression - float(low) / problem.horizon) / float(high - low)
        for (name, expression), low, high in zip(problem.objectives.items(), ideal, nadir)
    }
    weights = [1.0 / len(objectives)] * len(objectives)
    return replace(problem, objectives=objectives, weights=weights, temperature=0.0)


def weighed(problem: Any, factors: np.ndarray) -> Any:
    """Return a problem whose cost includes all objectives times ``factors`` (p,)."""
    cost = sp.Add(*(float(w) * e for w, e in zip(factors, problem.objectives.values())))
    whole = problem.cost + cost
    return replace(problem, objectives=(), weights=None, temperature=0.0, cost=whole)
