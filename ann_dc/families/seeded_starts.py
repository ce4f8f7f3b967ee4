r"""Seeded initial guesses: the straight line, then increasingly bent lines.

Independent noise at every stage is smoothed within a few steps, and all guesses end in the same
basin of attraction. A guess is therefore bent as a whole. The noise of `random_guess`, which knows
the admissible deviation of a component, is reduced to its lowest modes between the ends,

.. math:: q_k = line_k + a \sum_{j=1}^{3} \frac{c_j}{j} \sin(\pi j k / N) ,

with matching controls, and with an amplitude a that grows from guess to guess.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence

import numpy as np

from ann_dc.errors import ProblemError
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess, check_start, interpolated_guess, random_guess
from ann_dc.problem.scales import fitting_controls

MODES = 3
"""Largest number of half waves between the ends."""
LARGEST = 10.0
"""Amplitude of the last guess in deviations of `random_guess`: about the span of a component."""
LONGEST = 8_000
"""Number of batch steps after which a guess counts as not settled."""
HALVINGS = 20
"""Largest number of halvings towards the line for a guess outside a function's domain."""


def seeded_starts(
    problem: OptimalControlProblem, count: int, *, seed: int = 0
) -> list[InitialGuess]:
    """Return the straight line and ``count - 1`` guesses around it, in user's units.

    The distance from the line grows and is largest for the last guess. Another seed gives other
    guesses; the first one is always the line. A guess at which the dynamics or the cost are not
    finite is moved towards the line. Raises `ProblemError` if the count is not a positive integer
    or the seed is negative.

    >>> import ann_dc
    >>> line, *bent = seeded_starts(ann_dc.plants.double_integrator(N=5), 9)
    >>> bool(np.ptp(bent[0].q - line.q) < np.ptp(bent[-1].q - line.q))
    True
    """
    count, seed = _whole("starts", count, least=1), _whole("seed", seed, least=0)
    line = interpolated_guess(problem)
    return [line] + [
        _bent(problem, line, np.random.default_rng([seed, i]), LARGEST * i / (count - 1))
        for i in range(1, count)
    ]


def _bent(
    problem: OptimalControlProblem, line: InitialGuess, rng: np.random.Generator, amplitude: float
) -> InitialGuess:
    stages = problem.horizon
    noise = random_guess(problem, rng).q - line.q
    number = np.arange(1, MODES + 1)
    waves = np.sin(np.pi * np.outer(number, np.arange(stages + 1) / stages))
    bend = amplitude * (noise @ waves.T * np.sqrt(2 / stages) / number) @ waves
    bend[:, [0, -1]] = 0.0
    for _ in range(HALVINGS):
        q = line.q + bend
        start = InitialGuess(q=q, u=fitting_controls(problem, q))
        try:
            check_start(problem, start)
        except ProblemError:
            bend = bend / 2
        else:
            return start
    return line


def checked_starts(
    problem: OptimalControlProblem, starts: Sequence[InitialGuess]
) -> list[InitialGuess]:
    """Return the user's initial guesses, if a network of the problem can start there.

    Raises `ProblemError` naming the guess: if there are none, or if one is not an `InitialGuess`.
    It is also raised for arrays of another shape, for numbers that are not finite, and outside the
    domain of the dynamics or the cost.
    """
    starts = list(starts)
    if not starts:
        raise ProblemError(
            "starts: expected a number, or one InitialGuess or more, got an empty list"
        )
    for index, start in enumerate(starts):
        name = f"starts[{index}]"
        if not isinstance(start, InitialGuess):
            raise ProblemError(f"{name}: expected an InitialGuess, got {start!r}")
        _check_arrays(problem, start, name)
        try:
            check_start(problem, start)
        except ProblemError as error:
            raise ProblemError(f"{name}: {error}") from error
    return starts


def _check_arrays(problem: OptimalControlProblem, start: InitialGuess, name: str) -> None:
    n, m, stages = problem.n, problem.m, problem.horizon
    shapes = {"q": (n, stages + 1), "u": (m, stages), "mu": (n, stages), "beta": (n, stages)}
    for field, shape in shapes.items():
        given = getattr(start, field)
        if given is None and field in ("mu", "beta"):
            continue
        try:
            array = np.asarray(given, float)
        except (TypeError, ValueError) as error:
            raise ProblemError(f"{name}.{field}: expected numbers, got {given!r}") from error
        if array.shape != shape:
            raise ProblemError(
                f"{name}.{field}: expected an array of shape {shape}, got {array.shape}"
            )
        if not np.isfinite(array).all():
            row, stage = np.argwhere(~np.isfinite(array))[0]
            raise ProblemError(
                f"{name}.{field}: {array[row, stage]} in row {row} at stage {stage}; expected "
                "finite numbers"
            )


def _whole(name: str, value: object, *, least: int) -> int:
    try:
        number = operator.index(value)  # pyright: ignore[reportArgumentType]
    except TypeError:
        number = least - 1
    if isinstance(value, bool) or number < least:
        raise ProblemError(f"{name}: expected a whole number of at least {least}, got {value!r}")
    return number
