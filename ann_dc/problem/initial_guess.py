"""Initial guess of a network: straight line from q_0 to q_d with fitted controls.

An initial guess is in the user's units. Values that are not given (the multipliers) start at zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, TypeAlias

import numpy as np

from ann_dc.conversion import declare_words, of_word
from ann_dc.errors import ProblemError, UnknownNameError, such_as
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.domain import culprit, terms
from ann_dc.problem.scales import straight_line
from ann_dc.validation import Index, Shape, checked

SPREAD = 0.1
"""Deviation of a random initial guess from the straight line, relative to the distance of the ends.
"""
LEAST_SPREAD = 0.01
"""Smallest such deviation in scales, used for controls and for states whose ends are closer."""


@such_as("ann_dc.interpolated_guess(problem)")
@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class InitialGuess:
    """Initial values of a network, in the user's units.

    Attributes
    ----------
    q : (n, N+1) array
        States, including the end.
    u : (m, N) array
        Controls.
    mu, beta : (n, N) array, optional
        Multipliers of the map and of the coupling; zero by default.

    Examples
    --------
    Half the straight line's controls:

    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> line = interpolated_guess(problem)
    >>> start = InitialGuess(q=line.q, u=line.u / 2)
    >>> ann_dc.solve(problem, initial_guess=start).certified
    True
    """

    q: Annotated[np.ndarray, Shape("n", "N+1")]
    u: Annotated[np.ndarray, Shape("m", "N")]
    mu: Annotated[np.ndarray, Shape("n", "N")] | None = None
    beta: Annotated[np.ndarray, Shape("n", "N")] | None = None


@checked
def interpolated_guess(problem: OptimalControlProblem) -> InitialGuess:
    """Return the straight line from q_0 to q_d with fitted controls.

    A free component has the value of its other end. A component that is free at both ends starts at
    zero, or at the offset of its `Scale`. The controls are one Gauss-Newton step, from those of
    least cost, towards f(q_k, u_k) = q_{k+1}.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.

    Returns
    -------
    InitialGuess

    Examples
    --------
    >>> import ann_dc
    >>> interpolated_guess(ann_dc.plants.car()).q[0, :3]
    array([0.        , 0.55555556, 1.11111111])
    """
    line = straight_line(problem)
    return InitialGuess(q=line.q.copy(), u=line.u.copy())


@checked
def zero_guess(problem: OptimalControlProblem) -> InitialGuess:
    """Return zero values except q_0; if f is undefined there, every state is q_0.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.

    Returns
    -------
    InitialGuess

    Examples
    --------
    >>> import ann_dc
    >>> zero_guess(ann_dc.plants.double_integrator(N=3, q_0=(2, 0))).q
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
    return InitialGuess(q=q, u=u)


@checked
def random_guess(problem: OptimalControlProblem, rng: np.random.Generator | Index) -> InitialGuess:
    """Return the straight line with random deviations between the same ends.

    Deviations are normally distributed. The standard deviation of states is a tenth of abs(q_d -
    q_0), or a hundredth of their scale if that is larger; that of controls is a hundredth of their
    scale.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.
    rng : numpy.random.Generator or int
        A generator, or the seed of a new one.

    Returns
    -------
    InitialGuess

    Examples
    --------
    >>> import ann_dc
    >>> start = random_guess(ann_dc.plants.double_integrator(N=5), 0)
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
    return InitialGuess(q=q, u=line.u + push * rng.standard_normal(line.u.shape))


GUESSES: dict[str, Callable[[OptimalControlProblem], InitialGuess]] = {
    "line": interpolated_guess,
    "zero": zero_guess,
    "random": partial(random_guess, rng=0),
}
"""Functions of a problem that return its initial guess, by the words of the command line."""
declare_words(InitialGuess, GUESSES)

Guess: TypeAlias = InitialGuess | Callable[[OptimalControlProblem], InitialGuess] | str
"""Initial guess, a function that returns the guess for a problem, or its word in `GUESSES`."""


def guess_of(problem: OptimalControlProblem, guess: Guess | None) -> InitialGuess:
    """Return the initial guess for a problem; the straight line for None."""
    if isinstance(guess, str):
        return of_word(InitialGuess, "initial_guess", guess, UnknownNameError)(problem)
    if isinstance(guess, InitialGuess):
        return guess
    return interpolated_guess(problem) if guess is None else guess(problem)


def check_start(problem: OptimalControlProblem, start: InitialGuess) -> None:
    """Reject an initial guess outside the domain or of the wrong size.

    Raises `ProblemError` with the stage and a remedy if map, cost, an inequality or one of their
    slopes is not finite. Also raised if the guess has the size of another problem.
    """
    expected = (problem.n, problem.horizon + 1), (problem.m, problem.horizon)
    if (start.q.shape, start.u.shape) != expected:
        raise ProblemError(
            f"initial_guess: expected q and u of shapes {expected[0]} and {expected[1]}, got "
            f"{start.q.shape} and {start.u.shape}; interpolated_guess(problem) returns one"
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
            f"initial_guess: {name} or its slope has no finite value at stage {k} "
            f"({at}){f', because of {found}' if found else ''}; q_0, q_d and the start have to "
            "be in the domain of every function (set initial_guess=)"
        )
