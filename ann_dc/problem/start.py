"""Where a network starts: on the straight line from q_0 to q_d, with controls that fit.

A start is given in the user's units; what it does not give (the duals) starts at zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ann_dc.problem.declaration import OptimalControlProblem


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """Initial values: q (n, N+1), u (m, N), and optionally mu and beta (n, N) each."""

    q: np.ndarray
    u: np.ndarray
    mu: np.ndarray | None = None
    beta: np.ndarray | None = None


def line_start(problem: OptimalControlProblem) -> Start:
    """Straight line from q_0 to q_d, free components at their q_0, controls at zero.

    Examples
    --------
    >>> import ann_dc
    >>> line_start(ann_dc.plants.car()).q[0, :3]
    array([0.        , 0.55555556, 1.11111111])
    """
    first, last = ends(problem)
    share = np.linspace(0.0, 1.0, problem.horizon + 1)
    return _within_domain(problem, first[:, None] + (last - first)[:, None] * share)


def zero_start(problem: OptimalControlProblem) -> Start:
    """Every state at q_0, controls at zero."""
    first, _ = ends(problem)
    return _within_domain(problem, np.repeat(first[:, None], problem.horizon + 1, axis=1))


def random_start(problem: OptimalControlProblem, rng: np.random.Generator | int) -> Start:
    """The straight line with normal deviations of a fifth of max(|q_d - q_0|, 0.5)."""
    rng = np.random.default_rng(rng)
    line = line_start(problem)
    first, last = ends(problem)
    spread = 0.2 * np.maximum(np.abs(last - first), 0.5)
    q = line.q + spread[:, None] * rng.standard_normal(line.q.shape)
    q[:, 0] = line.q[:, 0]
    q[:, -1] = np.where(problem.fixed, line.q[:, -1], q[:, -1])
    start = _within_domain(problem, q)
    return Start(q=start.q, u=start.u + 0.1 * rng.standard_normal(start.u.shape))


def ends(problem: OptimalControlProblem) -> tuple[np.ndarray, np.ndarray]:
    """(q_0, q_d) as arrays (n,), a free component of q_d at its q_0."""
    first = np.array(problem.q_0, float)
    last = np.array([a if d is None else d for a, d in zip(problem.q_0, problem.q_d)], float)
    return first, last


def _within_domain(problem: OptimalControlProblem, q: np.ndarray) -> Start:
    u = np.zeros((problem.m, problem.horizon))
    return Start(q=q, u=u)
