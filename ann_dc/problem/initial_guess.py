"""Where a network starts: on the straight line from q_0 to q_d, with controls that fit.

A start is given in the user's units; what it does not give (the duals) starts at zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.domain import culprit, terms
from ann_dc.problem.scales import straight_line
from ann_dc.validation.checked import checked
from ann_dc.validation.values import Index, Shape, such_as

SPREAD = 0.1
"""Deviation of a random start from the straight line, over the distance of the ends."""
LEAST_SPREAD = 0.01
"""The same in scales, for controls and for states whose ends are nearer; they stray that far."""


@such_as("ann_dc.line_start(problem)")
@checked
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

    q: Annotated[np.ndarray, Shape("n", "N+1")]
    u: Annotated[np.ndarray, Shape("m", "N")]
    mu: Annotated[np.ndarray, Shape("n", "N")] | None = None
    beta: Annotated[np.ndarray, Shape("n", "N")] | None = None


@checked
def line_start(problem: OptimalControlProblem) -> Start:
    """Straight line from q_0 to q_d, free components at their other end, controls that fit.

    A component that is free at both ends starts at zero, or at the offset of a scale set by hand.
    The controls are one Gauss-Newton step, from those that cost least, towards
    f(q_k, u_k) = q_{k+1}.

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
    line = straight_line(problem)
    return Start(q=line.q.copy(), u=line.u.copy())


@checked
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
    first, _ = problem.ends
    if not (np.isfinite(F).all() and np.isfinite(B).all()):
        q += first[:, None]
    q[:, 0] = first
    return Start(q=q, u=u)


@checked
def random_start(problem: OptimalControlProblem, rng: np.random.Generator | Index) -> Start:
    """The straight line, disturbed, between the same ends.

    States deviate by a tenth of |q_d - q_0|, or a hundredth of their scale where that is more,
    controls by a hundredth of their scale; the deviations are normal.

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
    line = straight_line(problem)
    span = np.abs(line.q[:, -1] - line.q[:, 0])
    spread = np.maximum(SPREAD * span, LEAST_SPREAD * line.scales.state_factors)
    q = line.q + spread[:, None] * rng.standard_normal(line.q.shape)
    q[:, 0] = np.where(problem.fixed_start, line.q[:, 0], q[:, 0])
    q[:, -1] = np.where(problem.fixed, line.q[:, -1], q[:, -1])
    push = LEAST_SPREAD * line.scales.control_factors[:, None]
    return Start(q=q, u=line.u + push * rng.standard_normal(line.u.shape))


def check_start(problem: OptimalControlProblem, start: Start) -> None:
    """Refuse a start at which map, cost, an inequality or one of their slopes has no finite value.

    Parameters
    ----------
    problem : OptimalControlProblem
    start : Start

    Raises
    ------
    ProblemError
        Naming the stage, and what to do; or where it is a start of a problem of another size.
    """
    expected = (problem.n, problem.horizon + 1), (problem.m, problem.horizon)
    if (start.q.shape, start.u.shape) != expected:
        raise ProblemError(
            f"start: expected q and u of shapes {expected[0]} and {expected[1]}, got "
            f"{start.q.shape} and {start.u.shape}; line_start(problem) makes one"
        )
    q = start.q[:, :-1]
    for name, expressions, good in terms(problem, q, start.u):
        if good.all():
            continue
        k = int(np.flatnonzero(~good)[0])
        symbols = (*problem.states, *problem.controls)
        values = dict(zip(symbols, map(float, (*q[:, k], *start.u[:, k]))))
        at = ", ".join(f"{symbol} = {value:g}" for symbol, value in values.items())
        given = {symbol: float(np.asarray(rows)[k]) for symbol, rows in problem.inputs.items()}
        found = culprit(expressions, values | given)
        raise ProblemError(
            f"start: {name} or its slope has no finite value at stage {k} ({at})"
            f"{f', because of {found}' if found else ''}; q_0, q_d and the start have to lie "
            "inside the domain of every function (give start=)"
        )
