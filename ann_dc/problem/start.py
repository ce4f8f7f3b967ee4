"""Where a network starts: on the straight line from q_0 to q_d, with controls that fit.

A start is given in the user's units; what it does not give (the duals) starts at zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """Initial values: q (n, N+1), u (m, N), and optionally mu and beta (n, N) each."""

    q: np.ndarray
    u: np.ndarray
    mu: np.ndarray | None = None
    beta: np.ndarray | None = None


def line_start(problem: OptimalControlProblem) -> Start:
    """Straight line from q_0 to q_d, free components at their q_0, controls that fit.

    The controls are one Gauss-Newton step from zero towards f(q_k, u_k) = q_{k+1}.

    Examples
    --------
    >>> import ann_dc
    >>> line_start(ann_dc.plants.car()).q[0, :3]
    array([0.        , 0.55555556, 1.11111111])
    """
    first, last = ends(problem)
    share = np.linspace(0.0, 1.0, problem.horizon + 1)
    q = first[:, None] + (last - first)[:, None] * share
    return Start(q=q, u=fitting_controls(problem, q))


def zero_start(problem: OptimalControlProblem) -> Start:
    """Everything at zero; where f has no value there, every state at q_0."""
    q = np.zeros((problem.n, problem.horizon + 1))
    u = np.zeros((problem.m, problem.horizon))
    F, B = problem.functions.map_jacobian(q[:, 1:], u)
    if not (np.isfinite(F).all() and np.isfinite(B).all()):
        q += np.array(problem.q_0)[:, None]
    q[:, 0] = problem.q_0
    return Start(q=q, u=u)


def random_start(problem: OptimalControlProblem, rng: np.random.Generator | int) -> Start:
    """The straight line with normal deviations of a tenth of max(|q_d - q_0|, 1) a component."""
    rng = np.random.default_rng(rng)
    line = line_start(problem)
    first, last = ends(problem)
    spread = 0.1 * np.maximum(np.abs(last - first), 1.0)
    q = line.q + spread[:, None] * rng.standard_normal(line.q.shape)
    q[:, 0] = problem.q_0
    q[:, -1] = np.where(problem.fixed, line.q[:, -1], q[:, -1])
    return Start(q=q, u=line.u + 0.1 * rng.standard_normal(line.u.shape))


def check_start(problem: OptimalControlProblem, start: Start) -> None:
    """Refuse a start at which the map, the cost or one of their slopes has no finite value.

    Raises
    ------
    ProblemError
        Naming the stage, and what to do.
    """
    q, functions = start.q[:, :-1], problem.functions
    for name, parts in (
        ("the map f", (functions.map(q, start.u), *functions.map_jacobian(q, start.u))),
        ("the cost", (functions.cost(q, start.u), *functions.cost_gradient(q, start.u))),
    ):
        bad = np.zeros(problem.horizon, bool)
        for part in parts:
            bad |= ~np.isfinite(part).reshape(-1, problem.horizon).all(axis=0)
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            state = ", ".join(f"{s} = {v:g}" for s, v in zip(problem.states, q[:, k]))
            raise ProblemError(
                f"start: {name} or its slope has no finite value at stage {k} ({state}); q_0, q_d "
                "and the start have to lie inside the domain of every function, in units near 1 "
                "(give start=)"
            )


def fitting_controls(problem: OptimalControlProblem, q: np.ndarray) -> np.ndarray:
    """Controls (m, N) that take q_k to q_{k+1} as nearly as one least-squares step says."""
    u = np.zeros((problem.m, problem.horizon))
    _, B = problem.functions.map_jacobian(q[:, :-1], u)
    gap = q[:, 1:] - problem.functions.map(q[:, :-1], u)
    if not (np.isfinite(B).all() and np.isfinite(gap).all()):
        return u
    return np.stack(
        [np.linalg.pinv(B[:, :, k], rcond=1e-6) @ gap[:, k] for k in range(problem.horizon)],
        axis=1,
    )


def ends(problem: OptimalControlProblem) -> tuple[np.ndarray, np.ndarray]:
    """(q_0, q_d) as arrays (n,), a free component of q_d at its q_0."""
    first = np.array(problem.q_0, float)
    last = np.array([a if d is None else d for a, d in zip(problem.q_0, problem.q_d or ())], float)
    return first, last
