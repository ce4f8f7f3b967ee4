"""Ineffective controls and rows, at last stages and at stages determined by q_0.

A control of the last stages is undetermined if it only moves free states. A control is also
undetermined if it is multiplied by a state that is zero. Optima are then not isolated, and a
circuit's integrator drifts. An additional stage cost, present at such stages only, fixes the
control at a chosen value. The added cost is zero at the optimum, so every optimum of the modified
problem is an optimum of the problem at the same cost.

The multiplier of a row is undetermined if the row touches its limit at states that follow from q_0
alone. An example is the speed one step after a start at rest. The row is relaxed at such stages.

Three random paths agree in the states that q_0 determines. A derivative that vanishes on all of
them, at a stage with a determined state, vanishes for every choice of the variables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import sympy as sp

from ann_dc.problem.bounds import ROOM
from ann_dc.problem.declaration import HOLD, OptimalControlProblem
from ann_dc.problem.scales import natural_scales, straight_line

PATHS = 3
ROUNDING = 1e-12
"""Relative difference below which values are equal."""
TOUCHING = 1e-9
"""Distance of a row from its limit, relative to its largest value, below which the row touches its
limit.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Determined:
    """Map entries and rows that q_0 alone determines at the stages of a problem.

    `moves` (N, n, n+m) is True if a state or control may move a state of the next stage. `costs`
    (N, n+m) is True if a state or control may change the stage cost or an inequality. `rooms` (N,)
    relax each hard row that touches its limit at stages at which no variable changes the row.
    """

    moves: np.ndarray
    costs: np.ndarray
    rooms: dict[str, np.ndarray]


@lru_cache(maxsize=8)
def determined(problem: OptimalControlProblem) -> Determined:
    """Return the map entries and rows that q_0 alone determines."""
    functions, size = problem.functions, (problem.horizon, problem.n, problem.n + problem.m)
    try:
        with np.errstate(all="ignore"):
            paths = _paths(problem)
            at = [functions.derivatives(q, u, np.zeros_like(q)) for q, u in paths]
            rows = [functions.rows(q, u) for q, u in paths]
    except TypeError:  # a function that NumPy lacks has no block either: synthesis will say so
        return Determined(moves=np.ones(size, bool), costs=np.ones(size[::2], bool), rooms={})
    free = ~_agree([q for q, _ in paths]).any(axis=0)  # stages without a determined state
    jacobian = np.array([own.jacobian for own in at])
    slopes = [np.vstack([own.gradient[None], r.jacobian]) for own, r in zip(at, rows)]
    return Determined(
        moves=np.moveaxis((jacobian != 0).any(axis=0) | free, -1, 0),
        costs=((np.array(slopes) != 0).any(axis=(0, 1)) | free).T,
        rooms=_rooms(problem, np.array([r.value for r in rows])),
    )


def _agree(values: list[np.ndarray] | np.ndarray) -> np.ndarray:
    """Return True for values that are equal on all paths."""
    low, high = np.min(values, axis=0), np.max(values, axis=0)
    return high - low <= ROUNDING * np.maximum(np.abs(low), np.abs(high))


def _paths(problem: OptimalControlProblem) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return random paths, q (n, N) and u (m, N), with the states that q_0 determines."""
    rng, line, limits = np.random.default_rng(0), straight_line(problem), problem.control_limits
    paths, fixed = [], np.array(problem.fixed_start)
    for _ in range(PATHS):
        away = [rng.uniform(-1, 1, path.shape) for path in (line.q, line.u)]
        q = line.q + line.scales.state_factors[:, None] * away[0]
        u = line.u + line.scales.control_factors[:, None] * away[1]
        q[:, 0] = np.where(fixed, line.q[:, 0], q[:, 0])
        paths.append((q[:, :-1], np.clip(u, *limits.T[:, :, None])))
    for stage in range(problem.horizon - 1):
        images = [problem.functions.map(q, u)[:, stage] for q, u in paths]
        follows = _agree(images)
        if not follows.any():
            break
        for (q, _), image in zip(paths, images):
            q[follows, stage + 1] = image[follows]
    return paths


def _rooms(problem: OptimalControlProblem, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return the relaxation of hard rows with values (paths, r, N)."""
    rooms = {}
    for row, value in zip(problem.inequalities, np.moveaxis(values, 1, 0)):
        size = float(np.abs(value[np.isfinite(value)]).max(initial=0.0))
        touching = _agree(value) & (np.abs(value[0]) <= TOUCHING * size)
        if touching.any() and not row.soft and size > 0.0:
            rooms[row.name] = size * touching
    return rooms


def idle_controls(problem: OptimalControlProblem, *, any_start: bool = False) -> np.ndarray:
    """Return (N, m) booleans: True if no cost, row or fixed end depends on a control.

    Problems with several objectives are not supported. With ``any_start`` the result is valid for
    every q_0.
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
