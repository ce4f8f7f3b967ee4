"""Ineffective controls and rows, at last stages and at stages determined by q_0.

A control of the last stages is undetermined if it only moves free states. A control is also
undetermined if it is multiplied by a state that is zero. Optima are then not isolated, and a
circuit's integrator drifts. An additional stage cost, present at such stages only, fixes the
control at a chosen value. The added cost is zero at the optimum, so every optimum of the modified
problem is an optimum of the problem at the same cost.

The multiplier of a row is undetermined if the row touches its limit at states that follow from q_0
alone. An example is the speed one step after a start at rest. The row is relaxed at such stages.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import sympy as sp

from ann_dc.decomposition.determined import determined
from ann_dc.problem.bounds import ROOM
from ann_dc.problem.declaration import HOLD, OptimalControlProblem
from ann_dc.problem.scales import natural_scales


def idle_controls(problem: OptimalControlProblem, *, any_start: bool = False) -> np.ndarray:
    """Return (N, m) booleans: True if no cost, row or fixed end depends on a control.

    Problems with several objectives are not supported. With ``any_start`` the result is valid for
    every q_0.

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
    known = determined(problem)
    idle = np.zeros((problem.horizon, problem.m), bool)
    matters = of_end[:n] | np.array(problem.fixed)
    for stage in reversed(range(problem.horizon)):
        by_map = (moved & (known.moves[stage] | any_start))[matters].any(axis=0)
        felt = (of_stage & (known.costs[stage] | any_start)) | by_map
        idle[stage], matters = ~felt[n:], felt[:n]
    return idle


def held(problem: OptimalControlProblem, *, any_start: bool = False) -> OptimalControlProblem:
    """Return the problem with ineffective controls held and ineffective rows relaxed.

    The problem itself is returned if there are none, or if it has several objectives. With
    ``any_start``, for a varying q_0, only controls that are ineffective for every q_0 are held.

    Examples
    --------
    >>> from ann_dc import plants
    >>> car = plants.car()
    >>> held(car) is car
    True
    """
    if problem.objectives:
        return problem
    idle = idle_controls(problem, any_start=any_start)
    rooms = {} if any_start else determined(problem).rooms
    if not (idle.any() or rooms):
        return problem
    scales, cost = natural_scales(problem), problem.cost
    inputs = {sp.Symbol(ROOM.format(name)): room for name, room in rooms.items()}
    for control, scale, (low, high), stages in zip(
        problem.controls, scales.controls, problem.control_limits, idle.T
    ):
        if stages.any():
            weight = sp.Symbol(HOLD.format(control))
            value = _inside(low, high, scale.factor)
            cost += weight * (control - value) ** 2 / 2
            inputs[weight] = scales.cost / scale.factor**2 * stages
    return replace(problem, cost=cost, inputs={**problem.inputs, **inputs})


def _inside(low: float, high: float, size: float) -> float:
    """Return a value strictly inside limits, zero if possible.

    At a limit it would be undetermined if the limit is active.
    """
    if low < 0.0 < high:
        return 0.0
    near = low if np.isfinite(low) else high - 2 * size
    return float((near + (high if np.isfinite(high) else near + 2 * size)) / 2)
