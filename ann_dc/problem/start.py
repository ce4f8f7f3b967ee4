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
    """Initial values of a network, in the user's units.

    Attributes
    ----------
    q : (n, N+1) array
        States, with the end.
    u : (m, N) array
        Controls.
    mu, beta : (n, N) array, optional
        Multipliers of the map and of the coupling; zero where none are given.

    Examples
    --------
    Half the straight line's controls:

    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> line = line_start(problem)
    >>> start = Start(q=line.q, u=line.u / 2)
    >>> ann_dc.solve(problem, start=start).certified
    True
    """

    q: np.ndarray
    u: np.ndarray
    mu: np.ndarray | None = None
    beta: np.ndarray | None = None


def line_start(problem: OptimalControlProblem) -> Start:
    """Straight line from q_0 to q_d, free components at their q_0, controls that fit.

    The controls are one Gauss-Newton step from zero towards f(q_k, u_k) = q_{k+1}.

    Parameters
    ----------
    problem : OptimalControlProblem

    Returns
    -------
    Start

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
    """Everything at zero but q_0; where f has no value there, every state at q_0.

    Parameters
    ----------
    problem : OptimalControlProblem

    Returns
    -------
    Start

    Examples
    --------
    >>> import ann_dc
    >>> zero_start(ann_dc.plants.double_integrator(N=3, q_0=(2, 0))).q
    array([[2., 0., 0., 0.],
           [0., 0., 0., 0.]])
    """
    q = np.zeros((problem.n, problem.horizon + 1))
    u = np.zeros((problem.m, problem.horizon))
    F, B = problem.functions.map_jacobian(q[:, 1:], u)
    if not (np.isfinite(F).all() and np.isfinite(B).all()):
        q += np.array(problem.q_0)[:, None]
    q[:, 0] = problem.q_0
    return Start(q=q, u=u)


def random_start(problem: OptimalControlProblem, rng: np.random.Generator | int) -> Start:
    """The straight line, disturbed, between the same ends.

    States deviate by a tenth of max(|q_d - q_0|, 1), component by component, controls by a tenth;
    the deviations are normal.

    Parameters
    ----------
    problem : OptimalControlProblem
    rng : numpy.random.Generator or int
        A generator, or the seed of a new one.

    Returns
    -------
    Start

    Examples
    --------
    >>> import ann_dc
    >>> start = random_start(ann_dc.plants.double_integrator(N=5), 0)
    >>> start.q[:, [0, -1]].T.tolist()
    [[0.0, 0.0], [1.0, 0.0]]
    """
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

    Parameters
    ----------
    problem : OptimalControlProblem
    start : Start

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
    """Controls that take q_k to q_{k+1} as nearly as one least-squares step says.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end.

    Returns
    -------
    (m, N) array
        Zero where the map has no finite value or slope.
    """
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
    """(q_0, q_d) as arrays (n,), a free component of q_d at its q_0.

    Parameters
    ----------
    problem : OptimalControlProblem
    """
    first = np.array(problem.q_0, float)
    last = np.array([a if d is None else d for a, d in zip(problem.q_0, problem.q_d or ())], float)
    return first, last
