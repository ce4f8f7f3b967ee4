"""Controls without effect: those of the last stages, where only free states follow them.

Nothing determines such a control: optima are not isolated, and a circuit's integrator drifts. A
stage cost that only such stages have holds it at a value of its own. It is zero there, so that
every optimum of the held problem is one of the problem, at the same cost.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import sympy as sp

from ann_dc.problem.declaration import HOLD, OptimalControlProblem
from ann_dc.problem.scales import natural_scales


def idle_controls(problem: OptimalControlProblem) -> np.ndarray:
    """Return where controls have no effect on any cost, inequality or fixed end.

    Parameters
    ----------
    problem : OptimalControlProblem
        Without several objectives.

    Returns
    -------
    (N, m) array of bool

    Examples
    --------
    >>> x, v, a = sp.symbols("x v a")
    >>> problem = OptimalControlProblem(
    ...     states=(x, v), controls=(a,), dynamics=(v, a), dt=0.1, cost=x**2, horizon=4,
    ...     q_0=(1, 0), bounds={a: (-1, 1)})
    >>> idle_controls(problem).ravel().tolist()
    [False, False, True, True]
    """
    variables, n = (*problem.states, *problem.controls), problem.n
    read = lambda formulas: np.array(  # noqa: E731
        [any(formula.has(variable) for formula in formulas) for variable in variables]
    )
    moved = np.array([read([formula]) for formula in problem.f])  # (n, n+m)
    of_stage = read([problem.l, *(row.expression for row in problem.inequalities)])
    of_end = read([problem.l_N, *(row.expression for row in problem.end_inequalities)])
    idle = np.zeros((problem.horizon, problem.m), bool)
    matters = of_end[:n] | np.array(problem.fixed)
    for stage in reversed(range(problem.horizon)):
        felt = of_stage | moved[matters].any(axis=0)
        idle[stage], matters = ~felt[n:], felt[:n]
    return idle


def held(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return the problem with controls held where they have no effect; itself if there are none.

    Parameters
    ----------
    problem : OptimalControlProblem

    Examples
    --------
    >>> from ann_dc import plants
    >>> car = plants.car()
    >>> held(car) is car
    True
    """
    idle = np.zeros((0, 0)) if problem.objectives else idle_controls(problem)
    if not idle.any():
        return problem
    scales, cost = natural_scales(problem), problem.cost
    inputs: dict[Any, Any] = dict(problem.inputs)
    for control, scale, (low, high), stages in zip(
        problem.controls, scales.controls, problem.control_limits, idle.T
    ):
        if stages.any():
            weight = sp.Symbol(HOLD.format(control))
            value = _inside(low, high, scale.factor)
            cost += weight * (control - value) ** 2 / 2
            inputs[weight] = scales.cost / scale.factor**2 * stages
    return replace(problem, cost=cost, inputs=inputs)


def _inside(low: float, high: float, size: float) -> float:
    """Return a value inside limits, zero if that is one: at a limit it would press or not."""
    if low < 0.0 < high:
        return 0.0
    near = low if np.isfinite(low) else high - 2 * size
    return float((near + (high if np.isfinite(high) else near + 2 * size)) / 2)
