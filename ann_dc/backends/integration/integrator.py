r"""An explicit Runge-Kutta pair in compiled code, over the same loops as every other evaluation.

A step of length h combines the slopes K_i of its stages,

.. math:: x' = x + h \sum_i b_i K_i, \qquad K_i = f\big(x + h \sum_{j<i} a_{ij} K_j\big),

and is accepted where the error estimate is below the tolerance. The last slope is that of the next
step, and its evaluation says by the way what the residual is and whether a domain was left. At its
stability limit an explicit method hovers at an error of its tolerance: that shrinks with the
residual, so that it never stands in for the network's own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.integrate import DOP853 as SCIPY_DOP853

from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.formulas import compiled
from ann_dc.evaluation.loops import evaluate, first_outside, residuals, rhs

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
"""Of the next step: over what the error allows; smallest and largest factor on the last one."""
SHRINK = 1e-3
"""Relative tolerance, at most, as a share of the residual."""
FINEST = 3e-14
"""Relative tolerance that floating point can keep."""
SHORTEST = 1e-14
"""Step, over the time and over the step before, at which the integration is given up."""

GOING_ON, SETTLED, OVERFLOWN, OUTSIDE, TIME_UP, TOO_SHORT = range(6)
"""How a piece of an integration ended."""


class Tableau(NamedTuple):
    """A Butcher tableau with its error estimate; the slope at the new point is the last one (FSAL).

    References
    ----------
    .. [1] E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 1993.
    """

    a: np.ndarray
    """(S, S): below the diagonal, the stages."""
    b: np.ndarray
    """(S,): the step."""
    error: np.ndarray
    """(S+1,): the estimate, the last of the new slope."""
    third: np.ndarray
    """(S+1,): that of order three which DOP853 weighs in; zero where there is none."""
    exponent: float
    """-1 over one more than the order of the estimate."""


DOP853_TABLEAU = Tableau(
    a=np.ascontiguousarray(SCIPY_DOP853.A),
    b=np.ascontiguousarray(SCIPY_DOP853.B),
    error=np.ascontiguousarray(SCIPY_DOP853.E5),
    third=np.ascontiguousarray(SCIPY_DOP853.E3),
    exponent=-1.0 / 8.0,
)
"""Dormand and Prince, of order eight, with the coefficients that SciPy has."""


class Course(NamedTuple):
    """Where an integration is; every piece of it overwrites this."""

    x: np.ndarray
    """(n,): the state."""
    ahead: np.ndarray
    """(n,): a state that is tried."""
    slopes: np.ndarray
    """(S+1, n)."""
    clock: np.ndarray
    """(4,): time, next step, whether the last one was refused, right-hand sides so far."""

    @classmethod
    def at(cls, x: np.ndarray, tableau: Tableau, step: float) -> Course:
        """From a state (n,) at time zero, with a first step to try; begin with `begin`."""
        return cls(
            x=x.copy(),
            ahead=np.empty(len(x)),
            slopes=np.zeros((len(tableau.b) + 1, len(x))),
            clock=np.array([0.0, step, 0.0, 0.0]),
        )


class Log(NamedTuple):
    """What a piece of an integration takes down, one row a step."""

    times: np.ndarray
    """(steps,)."""
    residuals: np.ndarray
    """(steps, 2): constraint and stationarity."""
    states: np.ndarray
    """(steps, n)."""

    @classmethod
    def of(cls, steps: int, size: int) -> Log:
        """Room for so many steps of a state of that size."""
        return cls(np.empty(steps), np.empty((steps, 2)), np.empty((steps, size)))


class Ends(NamedTuple):
    """What ends an integration, besides a log that is full."""

    until: float
    """Time."""
    settled: float
    """Residual."""
    largest: float
    """Magnitude of a state."""
    guard: DomainGuard
    """Domains of the function blocks."""
    rtol: float
    """Relative tolerance a step, before it shrinks."""
    atol: float
    """Absolute tolerance, in network units, before it shrinks."""


@compiled
def share_of_tolerance(worst, rtol):
    """What a residual leaves of an explicit method's tolerances, at most one."""
    return max(min(1.0, SHRINK * worst / rtol), FINEST / rtol)


@compiled
def begin(tape, work, course):
    """The slope at the start."""
    rhs(tape, work, course.x, course.slopes[-1])
    course.clock[3] += 1.0


@compiled
def _combined(weights, count, slopes, h, x, out):
    """``out = x + h sum_j weights[j] slopes[j]`` over the first ``count`` slopes."""
    for i in range(x.shape[0]):
        out[i] = x[i]
    for j in range(count):
        if weights[j] != 0.0:
            share = h * weights[j]
            for i in range(x.shape[0]):
                out[i] += share * slopes[j, i]


@compiled
def _error(tableau, course, h, rtol, atol):
    """Size of the error of a step: below one where it is accepted."""
    x, ahead, slopes = course.x, course.ahead, course.slopes
    fifth = third = 0.0
    for i in range(x.shape[0]):
        first = second = 0.0
        for j in range(slopes.shape[0]):
            first += tableau.error[j] * slopes[j, i]
            second += tableau.third[j] * slopes[j, i]
        scale = atol + rtol * max(abs(x[i]), abs(ahead[i]))
        fifth += (first / scale) ** 2
        third += (second / scale) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(h) * fifth / np.sqrt((fifth + 0.01 * third) * x.shape[0])


@compiled
def _tried(tape, work, tableau, course, ends, h):
    """All slopes of a step, and the state that it leads to in ``course.ahead``.

    False where a function block left its domain on the way: what it said there means nothing, and
    ``course.ahead`` is that state.
    """
    x, ahead, slopes = course.x, course.ahead, course.slopes
    stages = tableau.b.shape[0]
    slopes[0] = slopes[stages]
    for s in range(1, stages + 1):
        _combined(tableau.a[s] if s < stages else tableau.b, s, slopes, h, x, ahead)
        rhs(tape, work, ahead, slopes[s])
        course.clock[3] += 1.0
        if first_outside(tape, work, ends.guard)[0] >= 0:
            return False
    return True


@compiled
def _ended(course, ends, worst):
    """How things stand after an accepted step."""
    if worst < ends.settled:
        return SETTLED
    size = 0.0
    for i in range(course.x.shape[0]):
        size = max(size, abs(course.x[i]))
    if not (size < ends.largest and worst < np.inf):
        return OVERFLOWN
    return TIME_UP if course.clock[0] >= ends.until else GOING_ON


@compiled
def advance(tape, work, tableau, course, ends, log):
    """Steps until something ends the integration, or the log is full.

    Parameters
    ----------
    tape, work
        As in `loops.evaluate`.
    tableau : Tableau
    course : Course
        After `begin`; overwritten.
    ends : Ends
    log : Log
        Overwritten, one row an accepted step.

    Returns
    -------
    steps : int
        Rows of the log.
    ended : int
        `GOING_ON` where the log is full, else why.
    """
    clock, stages, h_0 = course.clock, tableau.b.shape[0], course.clock[1]
    evaluate(tape, work, course.x)
    worst = max(*residuals(tape, work))
    for step in range(log.times.shape[0]):
        share = share_of_tolerance(worst, ends.rtol)
        slope, is_inside = course.slopes[stages].copy(), True
        while True:
            h = min(clock[1], ends.until - clock[0])
            if not h > SHORTEST * max(abs(clock[0]), h_0):
                return step, TOO_SHORT if is_inside else OUTSIDE
            is_inside, size = _tried(tape, work, tableau, course, ends, h), np.inf
            if is_inside:
                size = _error(tableau, course, h, share * ends.rtol, share * ends.atol)
            if size < 1.0:
                break
            course.slopes[stages] = slope
            factor = SAFETY * size**tableau.exponent if size < np.inf else LEAST
            clock[1], clock[2] = h * max(LEAST, factor), 1.0
        factor = MOST if size == 0.0 else min(MOST, SAFETY * size**tableau.exponent)
        clock[0] += h
        clock[1] = h * (min(1.0, factor) if clock[2] > 0.0 else factor)
        clock[2] = 0.0
        course.x[:] = course.ahead
        constraint, stationarity = residuals(tape, work)
        worst = max(constraint, stationarity)
        log.times[step] = clock[0]
        log.residuals[step, 0], log.residuals[step, 1] = constraint, stationarity
        log.states[step] = course.x
        ended = _ended(course, ends, worst)
        if ended != GOING_ON:
            return step + 1, ended
    return log.times.shape[0], GOING_ON
