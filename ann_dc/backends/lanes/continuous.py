"""Many integrations at once: every lane has its own step, tolerance and time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.integrator import (
    OUTSIDE,
    OVERFLOWN,
    SETTLED,
    SHORTEST,
    TIME_UP,
    TOO_SHORT,
    error_size,
    next_step,
    share_of_tolerance,
)
from ann_dc.backends.lanes.group import (
    NOBODY,
    OPEN,
    STALLED,
    copy_out,
    draw,
    end_of_curve,
    evaluate,
    largest_at_start,
    load,
    read,
    read_residuals,
)
from ann_dc.evaluation.formulas import inlined, released
from ann_dc.evaluation.vector_code.calls import call


class LaneEnds(NamedTuple):
    """What ends a sample, besides a domain that is left."""

    until: float
    """Network time."""
    first: float
    """First step to try."""
    tolerance: float
    """Residual, for the settling time."""
    settled: float
    """Residual at which it is sure."""
    overflow: float
    """Magnitude of a state, relative to the largest at the start."""
    most_steps: int
    """Steps of a sample."""
    window: int
    """Steps in which the lowest residual has to become smaller."""
    headway: float
    """By this factor."""
    rtol: float
    """Relative tolerance a step, before it shrinks."""
    atol: float
    """Absolute tolerance, in network units, before it shrinks."""


_NOW, _REFUSED, _WORST, _BEFORE, _WORST_BEFORE, _LARGEST, _BEST, _BEST_BEFORE = range(8)
"""What a lane's clock shows: time, whether the last step was refused, residual, time and residual
before, largest state, lowest residual of this window and of the last."""


@inlined
def _begin(group, ends, lane):
    """A lane's clock before the first step."""
    clock, largest = group.clock[lane], largest_at_start(group, lane)
    for i in range(clock.shape[0]):
        clock[i] = 0.0
    clock[_LARGEST] = ends.overflow * largest
    clock[_WORST] = clock[_BEST] = clock[_BEST_BEFORE] = np.inf


@inlined
def _note(group, found, ends, lane):
    """Enter where a lane is now: its settling time, and its curve."""
    sample, clock = group.who[lane], group.clock[lane]
    constraint, stationarity, _ = read(group, lane)
    worst = max(constraint, stationarity)
    clock[_WORST_BEFORE], clock[_WORST] = clock[_WORST], worst
    found.residuals[sample, 0], found.residuals[sample, 1] = constraint, stationarity
    if not worst < ends.tolerance:
        found.times[sample, 1], found.steps[sample, 1] = np.nan, -1
    elif found.steps[sample, 1] < 0:
        found.steps[sample, 1] = found.steps[sample, 0]
        share = 1.0
        if clock[_WORST_BEFORE] < np.inf:  # the logarithm is interpolated, as in `last_exit`
            high = np.log(clock[_WORST_BEFORE])
            share = (high - np.log(ends.tolerance)) / (high - np.log(max(worst, 1e-300)))
        found.times[sample, 1] = clock[_BEFORE] + share * (clock[_NOW] - clock[_BEFORE])
    if found.curve_times.shape[1] > 0 and found.steps[sample, 0] % group.stride[lane] == 0:
        draw(group, found, lane, found.steps[sample, 0])


@inlined
def _ended(group, found, ends, lane):
    """How a sample stands after a step, or before the first."""
    clock, steps = group.clock[lane], found.steps[group.who[lane], 0]
    worst = clock[_WORST]
    if worst < ends.settled:
        return SETTLED
    _, _, size = read(group, lane)
    if not (size < clock[_LARGEST] and worst < np.inf):
        return OVERFLOWN
    if clock[_NOW] >= ends.until or steps >= ends.most_steps:
        return TIME_UP
    clock[_BEST] = min(clock[_BEST], worst)
    if steps > 0 and steps % ends.window == 0:
        stalled = not clock[_BEST] < ends.headway * clock[_BEST_BEFORE]
        clock[_BEST_BEFORE], clock[_BEST] = clock[_BEST], np.inf
        if stalled and steps >= 3 * ends.window:
            return STALLED
    return OPEN


@inlined
def _close(group, found, lane, code):
    """A sample is done: its lane waits for the next."""
    sample = group.who[lane]
    found.codes[sample], found.times[sample, 0] = code, group.clock[lane, _NOW]
    if code != SETTLED:
        found.times[sample, 1], found.steps[sample, 1] = np.nan, -1
    copy_out(group, lane, found.states[sample])
    end_of_curve(group, found, lane)
    group.who[lane], group.h[lane] = NOBODY, 0.0


@inlined
def _fill(group, samples, found, ends, queue):
    """New samples into the lanes that wait; their slopes and residuals."""
    loaded = False
    for lane in range(group.who.shape[0]):
        group.mask[lane] = 0.0
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            load(group, samples, ends.first, lane, queue[0])
            _begin(group, ends, lane)
            group.mask[lane] = 1.0
            queue[0] += 1
            loaded = True
    if not loaded:
        return
    outside = evaluate(group, group.entry.rhs, group.x, 0)
    read_residuals(group, group.x)
    for lane in range(group.who.shape[0]):
        if group.mask[lane] > 0.0:
            _note(group, found, ends, lane)
            code = OUTSIDE if (outside >> lane) & 1 else _ended(group, found, ends, lane)
            if code != OPEN:
                _close(group, found, lane, code)


@inlined
def _try(group, rows, ends):
    """A step of every lane; the lanes that left a domain on the way, as bits."""
    width, first = group.who.shape[0], 8 * group.entry.ghost
    x, ahead = group.x.ctypes.data + first, group.ahead.ctypes.data + first
    slopes, weights = group.slopes.ctypes.data, rows.weights.ctypes.data
    offsets, outside = group.offsets.ctypes.data, 0
    stages = rows.starts.shape[0] - 3
    for stage in range(stages):
        begin, end = rows.starts[stage], rows.starts[stage + 1]
        terms = (slopes, weights + 8 * begin, offsets + 8 * begin, group.h.ctypes.data)
        call(group.combine, (ahead, x, *terms), (end - begin, group.padded))
        outside |= evaluate(group, group.entry.rhs, group.ahead, stage + 1)
    begin, middle, end = rows.starts[stages], rows.starts[stages + 1], rows.starts[stages + 2]
    for lane in range(width):
        share = share_of_tolerance(group.clock[lane, _WORST], ends.rtol)
        group.scales[lane], group.scales[width + lane] = share * ends.rtol, share * ends.atol
    terms = (slopes, weights + 8 * begin, offsets + 8 * begin)
    results = (group.scales.ctypes.data, group.errors.ctypes.data)
    call(group.error, (x, ahead, *terms, *results), (middle - begin, end - begin, group.padded))
    read_residuals(group, group.ahead)
    return outside


@inlined
def _judge(group, rows, found, lane, is_outside):
    """Whether a lane's step is accepted, and its next one."""
    width, clock, h = group.who.shape[0], group.clock[lane], group.h[lane]
    size, live = np.inf, group.components.shape[0]
    if not is_outside:
        size = error_size(group.errors[lane], group.errors[width + lane], h, live)
    group.h[lane] = next_step(h, size, rows.exponent, clock[_REFUSED] > 0.0)
    clock[_REFUSED] = 0.0 if size < 1.0 else 1.0
    if size < 1.0:
        group.mask[lane] = 1.0
        clock[_BEFORE] = clock[_NOW]
        clock[_NOW] += h
        found.steps[group.who[lane], 0] += 1


@inlined
def _filled(group, samples, found, ends, queue):
    """Whether any lane has a sample, after new ones came; no step goes beyond the end."""
    while True:
        _fill(group, samples, found, ends, queue)
        running = False
        for lane in range(group.who.shape[0]):
            group.mask[lane] = 0.0
            if group.who[lane] != NOBODY:
                running = True
                group.h[lane] = min(group.h[lane], ends.until - group.clock[lane, _NOW])
        if running or queue[0] >= queue[1]:
            return running


@inlined
def _accept(group):
    """Take over the states and slopes of the lanes whose mask is set."""
    first = 8 * group.entry.ghost
    states = (group.x.ctypes.data + first, group.ahead.ctypes.data + first)
    slopes = (group.slopes.ctypes.data, group.slopes[-1].ctypes.data, group.mask.ctypes.data)
    call(group.accept, (*states, *slopes), (group.padded,))


@inlined
def _standing(group, found, ends, lane, is_outside):
    """How a sample stands after a step was accepted or refused."""
    if group.mask[lane] > 0.0:
        _note(group, found, ends, lane)
        return _ended(group, found, ends, lane)
    if group.h[lane] > SHORTEST * max(group.clock[lane, _NOW], ends.first):
        return OPEN
    return OUTSIDE if is_outside else TOO_SHORT


@released
def advance_lanes(group, rows, samples, found, ends, queue, attempts):
    """Steps of all lanes, until every sample of a queue is done or so many were tried.

    Parameters
    ----------
    group : Group
        Overwritten.
    rows : Rows
    samples : Samples
    found : Found
        Filled in as samples are done.
    ends : LaneEnds
    queue : (2,) array of int
        The next sample, and the one at which to stop; overwritten.
    attempts : int

    Returns
    -------
    bool
        Whether all are done.
    """
    for _ in range(attempts):
        if not _filled(group, samples, found, ends, queue):
            return True
        outside = _try(group, rows, ends)
        for lane in range(group.who.shape[0]):
            if group.who[lane] != NOBODY:
                _judge(group, rows, found, lane, (outside >> lane) & 1)
        _accept(group)
        for lane in range(group.who.shape[0]):
            if group.who[lane] != NOBODY:
                code = _standing(group, found, ends, lane, (outside >> lane) & 1)
                if code != OPEN:
                    _close(group, found, lane, code)
    return False
