"""States determined by q_0 alone, and dependences at the stages of these states.

Three random paths agree in the determined states. A derivative that vanishes on all of them, at a
stage with a determined state, vanishes for every choice of the variables.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import straight_line

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

    Attributes
    ----------
    moves : (N, n, n+m) array of bool
        True if a state or control may move a state of the next stage.
    costs : (N, n+m) array of bool
        True if a state or control may change the stage cost or an inequality.
    rooms : dict of str to (N,) array
        Relaxation of each hard row that touches its limit, at stages at which no variable changes
        the row.
    """

    moves: np.ndarray
    costs: np.ndarray
    rooms: dict[str, np.ndarray]


@lru_cache(maxsize=8)
def determined(problem: OptimalControlProblem) -> Determined:
    """Return the map entries and rows that q_0 alone determines.

    Examples
    --------
    >>> from ann_dc import plants
    >>> determined(plants.double_integrator(N=5)).rooms
    {}
    """
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
