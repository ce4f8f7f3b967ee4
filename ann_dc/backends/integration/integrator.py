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

from ann_dc.backends.integration.between import Aside, extended, inside, last_exit
from ann_dc.backends.integration.systems import combined, kept, residuals, slope, squares
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.formulas import compiled, inlined

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
"""Of the next step: over what the error allows; smallest and largest factor on the last one."""
SHRINK = 1e-3
"""Relative tolerance, at most, as a share of the residual."""
FINEST = 3e-14
"""Relative tolerance that floating point can keep."""
SWING = 0.7
"""Share of the tolerance: if both ends of a step are below it, the inside is not examined."""
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
    """(S + 2 + E, ...), one after the other; the first is that of ``x``, that of ``ahead`` comes
    after S of stages, and then those of `Aside`."""
    offsets: np.ndarray
    """(entries,): where the slope of every entry of ``rows`` begins."""
    scales: np.ndarray
    """(2,): what is handed to vector code."""
    clock: np.ndarray
    """(7,): time, next step, whether one was refused, right-hand sides, residual, first step, and
    the time since which the residual stays below the tolerance: nan while it does not."""
    aside: Aside
    """States inside a step."""

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
        x, scales, slopes = x.copy(), np.zeros(2), np.zeros((rows.slopes, length))
        return cls(
            x=x,
            ahead=x.copy(),
            slopes=slopes,
            offsets=rows.which * length,
            scales=scales,
            clock=np.array([0.0, step, 0.0, 0.0, np.inf, step, np.nan]),
            aside=Aside.of(rows.extension, x, slopes, scales),
        )


class Log(NamedTuple):
    """What a piece of an integration takes down."""

    times: np.ndarray
    """(steps,)."""
    residuals: np.ndarray
    """(steps, 2): constraint and stationarity."""
    states: np.ndarray
    """(steps, size): without ghosts."""

    @classmethod
    def of(cls, steps: int, size: int) -> Log:
        """Return an empty log for a number of steps and a size of the state."""
        return cls(np.empty(steps), np.empty((steps, 2)), np.empty((steps, size)))


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
    tolerance: float = 0.0
    """Residual whose last exit is located; zero: none."""


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
def _begin(system, course, tolerance):
    """The slope and the residual at the start."""
    slope(system, course.x, course.slopes[0])
    course.clock[3] += 1.0
    constraint, stationarity, _ = residuals(system, course.x)
    course.clock[4] = max(constraint, stationarity)
    course.clock[6] = 0.0 if course.clock[4] < tolerance else np.nan


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
def _watch(system, course, began, worst, tolerance):
    """Update the time since which the residual stays below the tolerance, after a step."""
    clock, before = course.clock, course.clock[4]
    if not worst < tolerance:
        clock[6] = np.nan
    elif not max(before, worst) < SWING * tolerance:
        h = clock[0] - began
        theta, looks = last_exit(system, course.aside, h, (before, worst), tolerance)
        clock[3] += looks
        if theta >= 0.0:
            clock[6] = began + theta * h


@inlined
def _note(course, first, log, step, found):
    """Enter a step into the log, and keep its residual for the next step."""
    for i in range(log.states.shape[1]):
        log.states[step, i] = course.ahead[first + i]
    log.times[step] = course.clock[0]
    log.residuals[step, 0], log.residuals[step, 1] = found
    course.clock[4] = max(found[0], found[1])


@inlined
def _accept(course, rows):
    x, slopes, last = course.x, course.slopes, rows.starts.shape[0] - 3
    for i in range(x.shape[0]):
        x[i] = course.ahead[i]
    for i in range(slopes.shape[1]):
        slopes[0, i] = slopes[last, i]


@compiled
def advance(system, rows, course, ends, log):
    """Steps until something ends the integration, or the log is full.

    Parameters
    ----------
    system : System
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
        _begin(system, course, ends.tolerance)
    for step in range(log.times.shape[0]):
        began = course.clock[0]
        ended = _step(system, rows, course, ends)
        if ended != GOING_ON:
            return step, ended
        constraint, stationarity, size = residuals(system, course.ahead)
        _watch(system, course, began, max(constraint, stationarity), ends.tolerance)
        _note(course, system.ghost, log, step, (constraint, stationarity))
        _accept(course, rows)
        ended = _ended(course, ends, size)
        if ended != GOING_ON:
            return step + 1, ended
    return log.times.shape[0], GOING_ON


@compiled
def draw(system, rows, course, ends, places, known, times):
    """Compute states between known ones by integrating every gap again.

    The first step that is tried is the gap, so that a gap of one step is that step.

    Parameters
    ----------
    system : System
    rows : Rows
    course : Course
        Overwritten.
    ends : Ends
        Of which the tolerances of a step count.
    places : (n,) array of int
        Where a state vector lies in a state as the system has it.
    known : (T,) array, (T, n) array
        Times and states.
    times : (K,) array
        Rising, from the first known one to the last.

    Returns
    -------
    (K, n) array
        nan in the rest of a gap in which a step fails.
    """
    at, states = known
    found = np.full((times.shape[0], places.shape[0]), np.nan)
    gap, begin = 0, 0
    while begin < times.shape[0]:
        while gap < at.shape[0] - 2 and at[gap + 1] <= times[begin]:
            gap += 1
        end = begin + 1
        while end < times.shape[0] and (times[end] < at[gap + 1] or gap == at.shape[0] - 2):
            end += 1
        length = at[gap + 1] - at[gap]
        for i in range(places.shape[0]):
            course.x[places[i]] = states[gap, i]
        _bridged(
            system, rows, course, Ends(length, -1.0, np.inf, ends.rtol, ends.atol, 0.0), places,
            times[begin:end] - at[gap], found[begin:end],
        )  # fmt: skip
        begin = end
    return found


@inlined
def _bridged(system, rows, course, ends, places, times, found):
    """Compute states at rising times, up to the first step that fails."""
    clock, done = course.clock, 0
    clock[:] = 0.0
    clock[1] = clock[5] = ends.until
    _begin(system, course, 0.0)
    while done < times.shape[0]:
        began, is_new = clock[0], True
        if _step(system, rows, course, ends) != GOING_ON:
            return
        constraint, stationarity, _ = residuals(system, course.ahead)
        h = clock[0] - began
        while done < times.shape[0] and (times[done] <= clock[0] or clock[0] >= ends.until):
            if is_new and not extended(system, course.aside, h):
                return
            is_new = False
            inside(system, course.aside, min((times[done] - began) / h, 1.0), h)
            for i in range(places.shape[0]):
                found[done, i] = course.aside.ahead[places[i]]
            done += 1
        _accept(course, rows)
        clock[4] = max(constraint, stationarity)
