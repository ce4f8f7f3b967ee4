r"""Explicit Runge-Kutta pair in compiled code, over interpreted or generated cells.

A step of length h combines the slopes K_i of its stages,

.. math:: x' = x + h \sum_i b_i K_i, \qquad K_i = f\big(x + h \sum_{j<i} a_{ij} K_j\big),

and is accepted if the error estimate is below the tolerance. The last slope is the first of the
next step; its evaluation also gives the residual and shows whether a domain was left. At its
stability limit an explicit method hovers at an error of its tolerance. The tolerance therefore
shrinks with the residual, so that this error does not mask the network's residual.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.between import Aside, extended, inside, last_exit
from ann_dc.backends.integration.systems import combined, kept, residuals, slope, squares
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.formulas import compiled, inlined, lengthy

SAFETY, LEAST, MOST = 0.9, 0.2, 10.0
"""Safety factor of the next step; smallest and largest factor relative to the last step."""
SHRINK = 1e-3
"""Largest relative tolerance, as a fraction of the residual."""
FINEST = 3e-14
"""Smallest relative tolerance attainable in floating point."""
SWING = 0.7
"""Fraction of the tolerance: if both ends of a step are below it, the inside is not examined."""
SHORTEST = 1e-14
"""Step, relative to the time and to the step before, at which the integration fails."""

RUNNING, SETTLED, DIVERGED, LEFT_DOMAIN, STALLED, TIME_UP, TOO_SHORT = range(7)
"""Codes of a sample or run in compiled code and in layers."""


class Course(NamedTuple):
    """State of an integration, overwritten by every piece."""

    x: np.ndarray  # state in the layout of the system
    ahead: np.ndarray  # trial state
    slopes: np.ndarray  # slopes (S + 2 + E, ...): of ``x``, S stages, ``ahead`` and `Aside`
    offsets: np.ndarray  # beginning of the slope of every entry of ``rows``, (entries,)
    scales: np.ndarray  # scales (2,) passed to vector code
    clock: np.ndarray
    """Scalars (7,): time, next step, refusal flag, right-hand sides, residual, first step, and time
    since which the residual is below the tolerance (nan otherwise).
    """
    aside: Aside  # states inside a step

    @classmethod
    def at(cls, x: np.ndarray, length: int, rows: Rows, step: float) -> Course:
        """Return the course from a state in the layout of the system at time zero.

        ``length`` is the number of values of a slope, and ``step`` is the first trial step.
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
    """Record of a piece of an integration."""

    times: np.ndarray  # network times (steps,)
    residuals: np.ndarray  # constraint and stationarity residuals (steps, 2)
    states: np.ndarray  # states (steps, size) without ghosts

    @classmethod
    def of(cls, steps: int, size: int) -> Log:
        """Return an empty log for a number of steps and a size of the state."""
        return cls(np.empty(steps), np.empty((steps, 2)), np.empty((steps, size)))


class Ends(NamedTuple):
    """End conditions of an integration, besides a full log and a left domain."""

    until: float  # time limit
    settled: float  # residual at which the run counts as settled
    largest: float  # largest magnitude of a state
    rtol: float  # relative tolerance per step, before it shrinks
    atol: float  # absolute tolerance in network units, before it shrinks
    tolerance: float = 0.0  # residual whose last exit is located; zero disables the search


@compiled
def share_of_tolerance(worst, rtol):
    """Return the tolerance factor of an explicit method at a residual, at most one."""
    return max(min(1.0, SHRINK * worst / rtol), FINEST / rtol)


@inlined
def _error_size(first, second, h, live):
    """Return the error size of a step from sums of squares; accepted if below one."""
    if first == 0.0:
        return 0.0
    return abs(h) * first / np.sqrt((first + 0.01 * second) * live)


@inlined
def next_step(h, size, exponent, refused):
    """Return the next trial step after a step of length ``h`` with this error size."""
    if not size < 1.0:
        factor = SAFETY * size**exponent if size < np.inf else LEAST
        return h * max(LEAST, factor)
    factor = MOST if size == 0.0 else min(MOST, SAFETY * size**exponent)
    return h * (min(1.0, factor) if refused else factor)


@inlined
def _begin(system, course, tolerance):
    """Evaluate the slope and the residual at the start."""
    slope(system, course.x, course.slopes[0])
    course.clock[3] += 1.0
    constraint, stationarity, _ = residuals(system, course.x)
    course.clock[4] = max(constraint, stationarity)
    course.clock[6] = 0.0 if course.clock[4] < tolerance else np.nan


@inlined
def _tried(system, rows, course, h):
    """Evaluate all slopes of a step and write the resulting state to ``course.ahead``.

    Returns False if a function block left its domain, at ``course.ahead``.
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
    """Return the end code after an accepted step to a state of this magnitude."""
    if course.clock[4] < ends.settled:
        return SETTLED
    if not (size < ends.largest and course.clock[4] < np.inf):
        return DIVERGED
    return TIME_UP if course.clock[0] >= ends.until else RUNNING


@inlined
def _step(system, rows, course, ends):
    """Take one step with as many trials as needed; return `RUNNING` or an end code."""
    clock, inside = course.clock, True
    share = share_of_tolerance(clock[4], ends.rtol)
    while True:
        left = ends.until - clock[0]
        h = min(clock[1], left)
        if not h > SHORTEST * max(clock[0], clock[5]):
            return TOO_SHORT if inside else LEFT_DOMAIN
        inside, size = _tried(system, rows, course, h), np.inf
        if inside:
            first, second = squares(system, rows, course, share * ends.rtol, share * ends.atol)
            size = _error_size(first, second, h, system.live)
        clock[1] = next_step(h, size, rows.exponent, clock[2] > 0.0)
        if size < 1.0:
            clock[0] = ends.until if h == left else clock[0] + h
            clock[2] = 0.0
            return RUNNING
        clock[2] = 1.0


@inlined
def _watch(system, course, began, worst, tolerance):
    """Update the time since which the residual stays below the tolerance."""
    clock, before = course.clock, course.clock[4]
    if not worst < tolerance:
        clock[6] = np.nan
    elif not max(before, worst) < SWING * tolerance:
        h = clock[0] - began
        theta, checks = last_exit(system, course.aside, h, (before, worst), tolerance)
        clock[3] += checks
        if theta >= 0.0:
            clock[6] = began + theta * h


@inlined
def _note(course, first, log, step, found):
    """Enter a step into the log and store its residual for the next step."""
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


@lengthy
def advance(system, rows, course, ends, log):
    """Take steps until an end condition is met or the log is full.

    Returns the number of log rows and a code, which is `RUNNING` if the log is full.
    """
    if course.clock[3] == 0.0:
        _begin(system, course, ends.tolerance)
    for step in range(log.times.shape[0]):
        began = course.clock[0]
        ended = _step(system, rows, course, ends)
        if ended != RUNNING:
            return step, ended
        constraint, stationarity, size = residuals(system, course.ahead)
        _watch(system, course, began, max(constraint, stationarity), ends.tolerance)
        _note(course, system.ghost, log, step, (constraint, stationarity))
        _accept(course, rows)
        ended = _ended(course, ends, size)
        if ended != RUNNING:
            return step + 1, ended
    return log.times.shape[0], RUNNING


@compiled
def draw(system, rows, course, ends, places, known, times):
    """Compute states (K, n) at rising times between known ones by integrating every gap again.

    The first trial step is the gap, so that a gap of one step reproduces that step. The rest of a
    gap in which a step fails is nan. Of ``ends``, only the step tolerances are used. ``places``
    (n,) are the indices of the state in the layout of the system, and ``known`` contains times and
    states.
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
        if _step(system, rows, course, ends) != RUNNING:
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
