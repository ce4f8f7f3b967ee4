r"""An explicit Runge-Kutta pair in compiled code, over interpreted or generated cells alike.

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

from ann_dc.backends.integration.systems import combined, kept, residuals, slope, squares
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.formulas import compiled, inlined

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


class Course(NamedTuple):
    """Where an integration is; every piece of it overwrites this."""

    x: np.ndarray
    """The state, as the system has it."""
    ahead: np.ndarray
    """A state that is tried."""
    slopes: np.ndarray
    """(S + 1, ...), one after the other; the first is that of ``x``."""
    offsets: np.ndarray
    """(entries,): where the slope of every entry of ``rows`` begins."""
    scales: np.ndarray
    """(2,): what is handed to vector code."""
    clock: np.ndarray
    """(6,): time, next step, whether one was refused, right-hand sides, residual, first step."""

    @classmethod
    def at(cls, x: np.ndarray, length: int, rows: Rows, step: float) -> Course:
        """From a state at time zero.

        Parameters
        ----------
        x : array
            As the system has it.
        length : int
            Numbers of a slope.
        rows : Rows
        step : float
            The first one to try.
        """
        return cls(
            x=x.copy(),
            ahead=x.copy(),
            slopes=np.zeros((len(rows.starts) - 2, length)),
            offsets=rows.which * length,
            scales=np.zeros(2),
            clock=np.array([0.0, step, 0.0, 0.0, np.inf, step]),
        )


class Log(NamedTuple):
    """What a piece of an integration takes down."""

    times: np.ndarray
    """(steps,)."""
    residuals: np.ndarray
    """(steps, 2): constraint and stationarity."""
    curve_times: np.ndarray
    """(steps, points): between the last step and this one, and here."""
    curve: np.ndarray
    """(steps, points, size): states then, without ghosts."""

    @classmethod
    def of(cls, steps: int, size: int, points: int = 1) -> Log:
        """Room for so many steps of a state of that size, with as many points a step."""
        times, curve = np.empty((steps, points)), np.empty((steps, points, size))
        return cls(np.empty(steps), np.empty((steps, 2)), times, curve)


class Ends(NamedTuple):
    """What ends an integration, besides a log that is full and a domain that is left."""

    until: float
    """Time."""
    settled: float
    """Residual."""
    largest: float
    """Magnitude of a state."""
    rtol: float
    """Relative tolerance a step, before it shrinks."""
    atol: float
    """Absolute tolerance, in network units, before it shrinks."""


@compiled
def share_of_tolerance(worst, rtol):
    """What a residual leaves of an explicit method's tolerances, at most one."""
    return max(min(1.0, SHRINK * worst / rtol), FINEST / rtol)


@inlined
def error_size(first, second, h, live):
    """Size of the error of a step, below one where it is accepted, from sums of squares."""
    if first == 0.0:
        return 0.0
    return abs(h) * first / np.sqrt((first + 0.01 * second) * live)


@inlined
def next_step(h, size, exponent, refused):
    """The step to try after one of length ``h`` with an error of this size."""
    if not size < 1.0:
        factor = SAFETY * size**exponent if size < np.inf else LEAST
        return h * max(LEAST, factor)
    factor = MOST if size == 0.0 else min(MOST, SAFETY * size**exponent)
    return h * (min(1.0, factor) if refused else factor)


@inlined
def _begin(system, course):
    """The slope and the residual at the start."""
    slope(system, course.x, course.slopes[0])
    course.clock[3] += 1.0
    constraint, stationarity, _ = residuals(system, course.x)
    course.clock[4] = max(constraint, stationarity)


@inlined
def _tried(system, rows, course, h):
    """All slopes of a step, and the state that it leads to in ``course.ahead``.

    False where a function block left its domain on the way: what it said there means nothing, and
    ``course.ahead`` is that state.
    """
    last = rows.starts.shape[0] - 4
    for stage in range(last + 1):
        combined(system, rows, stage, course, h)
        if stage == last:
            kept(system, course.ahead)
        course.clock[3] += 1.0
        if not slope(system, course.ahead, course.slopes[stage + 1]):
            return False
    return True


@inlined
def _ended(course, ends, size):
    """How things stand after an accepted step to a state of this magnitude."""
    if course.clock[4] < ends.settled:
        return SETTLED
    if not (size < ends.largest and course.clock[4] < np.inf):
        return OVERFLOWN
    return TIME_UP if course.clock[0] >= ends.until else GOING_ON


@inlined
def _step(system, rows, course, ends):
    """One step, tried as often as it takes; `GOING_ON`, or why there is none."""
    clock, inside = course.clock, True
    share = share_of_tolerance(clock[4], ends.rtol)
    while True:
        h = min(clock[1], ends.until - clock[0])
        if not h > SHORTEST * max(clock[0], clock[5]):
            return TOO_SHORT if inside else OUTSIDE
        inside, size = _tried(system, rows, course, h), np.inf
        if inside:
            first, second = squares(system, rows, course, share * ends.rtol, share * ends.atol)
            size = error_size(first, second, h, system.live)
        clock[1] = next_step(h, size, rows.exponent, clock[2] > 0.0)
        if size < 1.0:
            clock[0] += h
            clock[2] = 0.0
            return GOING_ON
        clock[2] = 1.0


@inlined
def _drawn(course, first, began, log, step):
    """The curve of a step that began at this time: a cubic through its ends and slopes."""
    points, h = log.curve.shape[1], course.clock[0] - began
    for point in range(points):
        s = (point + 1.0) / points
        log.curve_times[step, point] = began + s * h if point < points - 1 else course.clock[0]
        after, before = s * s * (3.0 - 2.0 * s), (1.0 - s) * (1.0 - s) * (1.0 + 2.0 * s)
        begun, done = s * (1.0 - s) * (1.0 - s) * h, s * s * (s - 1.0) * h
        for i in range(log.curve.shape[2]):
            slopes = begun * course.slopes[0, i] + done * course.slopes[-1, i]
            x, ahead = course.x[first + i], course.ahead[first + i]
            log.curve[step, point, i] = before * x + after * ahead + slopes


@inlined
def _accept(course):
    x, slopes = course.x, course.slopes
    for i in range(x.shape[0]):
        x[i] = course.ahead[i]
    for i in range(slopes.shape[1]):
        slopes[0, i] = slopes[-1, i]


@compiled
def advance(system, rows, course, ends, log):
    """Steps until something ends the integration, or the log is full.

    Parameters
    ----------
    system : Interpreted or Generated
    rows : Rows
    course : Course
        Overwritten.
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
    if course.clock[3] == 0.0:
        _begin(system, course)
    for step in range(log.times.shape[0]):
        began = course.clock[0]
        ended = _step(system, rows, course, ends)
        if ended != GOING_ON:
            return step, ended
        _drawn(course, system.ghost, began, log, step)
        _accept(course)
        constraint, stationarity, size = residuals(system, course.x)
        course.clock[4] = max(constraint, stationarity)
        log.times[step] = course.clock[0]
        log.residuals[step, 0], log.residuals[step, 1] = constraint, stationarity
        ended = _ended(course, ends, size)
        if ended != GOING_ON:
            return step + 1, ended
    return log.times.shape[0], GOING_ON
