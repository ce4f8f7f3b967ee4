"""Many integrations at once: every lane has its own step, tolerance and time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.integrator import (
    OUTSIDE,
    OVERFLOWN,
    SETTLED,
    TIME_UP,
    TOO_SHORT,
)
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.backends.lanes.continuous_code import BEFORE, NUMBERS, WORST, continuous_code
from ann_dc.backends.lanes.group import (
    NOBODY,
    OPEN,
    STALLED,
    Group,
    begin,
    close,
    draw,
    evaluate,
    keep_exit,
    load,
    read_residuals,
)
from ann_dc.backends.lanes.memory import (
    BEST,
    BEST_BEFORE,
    CONSTRAINT,
    DONE,
    LARGEST,
    SINCE,
    STATIONARITY,
    STEP,
    TIME,
    TURN,
)
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.formulas import inlined, released


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


class Pointers(NamedTuple):
    """What an attempt works on: addresses and sizes, in the order in which the code takes them."""

    rhs: int
    """Of the code of the network."""
    residuals: int
    """The same."""
    keep: int
    """The same."""
    table: int
    """Of all tables."""
    x: int
    """States, with ghosts."""
    ahead: int
    """States that are tried, with ghosts."""
    slopes: int
    """Of all stages."""
    memory: int
    """Of `backends.lanes.memory`."""
    found: int
    """What ``residuals`` gives."""
    numbers: int
    """Constants."""


class Integration(NamedTuple):
    """How steps go, and where."""

    ends: LaneEnds
    """Of samples."""
    numbers: np.ndarray
    """(n,): what the code reads of them."""
    attempt: int
    """Address of the code."""
    pointers: Pointers
    """Where all that lies."""
    sizes: tuple[int, int, int]
    """Numbers of a ghost, from slope to slope, and of all states in whole blocks."""

    @classmethod
    def of(cls, group: Group, rows: Rows, ends: LaneEnds) -> Integration:
        """For a group, which has to live as long.

        Parameters
        ----------
        group : Group
        rows : Rows
            Of the method.
        ends : LaneEnds
        """
        entry, constants = group.entry, {**ends._asdict(), "live": group.entry.live}
        numbers = lined_up([float(constants[name]) for name in NUMBERS])
        tables = (entry.table, group.x, group.ahead, group.slopes, group.memory, entry.found)
        addresses = [table.ctypes.data for table in (*tables, numbers)]
        return cls(
            ends=ends,
            numbers=numbers,
            attempt=continuous_code(rows, len(group.who)),
            pointers=Pointers(entry.rhs, entry.residuals, entry.keep, *addresses),
            sizes=(entry.ghost, group.slopes.shape[1], group.padded),
        )


@inlined
def _code(group, ends, lane):
    """How a sample stands after an accepted step, or before the first."""
    memory, size = group.memory, group.entry.found[2 * group.who.shape[0] + lane]
    worst, steps = memory[WORST, lane], memory[DONE, lane]
    if worst < ends.settled:
        return SETTLED
    if not (size < memory[LARGEST, lane] and worst < np.inf):
        return OVERFLOWN
    if memory[TIME, lane] >= ends.until or steps >= ends.most_steps:
        return TIME_UP
    if steps >= memory[TURN, lane]:
        stalled = not memory[BEST, lane] < ends.headway * memory[BEST_BEFORE, lane]
        memory[BEST_BEFORE, lane], memory[BEST, lane] = memory[BEST, lane], np.inf
        memory[TURN, lane] += ends.window
        if stalled and steps >= 3 * ends.window:
            return STALLED
    return OPEN


@inlined
def _begin(group, ends, lane):
    """A lane's memory before the first step, at residuals just read."""
    memory, width = group.memory, group.who.shape[0]
    constraint, stationarity = group.entry.found[lane], group.entry.found[width + lane]
    memory[CONSTRAINT, lane], memory[STATIONARITY, lane] = constraint, stationarity
    worst = max(constraint, stationarity)
    memory[WORST, lane] = memory[BEST, lane] = worst
    if worst < ends.tolerance:
        memory[SINCE, lane] = 0.0


@inlined
def _draw(group, found, lane):
    """A lane's state on its curve, if there is one."""
    count = int(group.memory[DONE, lane])
    if found.curve_times.shape[1] > 0 and count % group.stride[lane] == 0:
        draw(group, found, lane, count)


@inlined
def _fill(group, samples, found, integration, queue):
    """New samples into the lanes that wait; their slopes and residuals. Whether any is left."""
    ends, width = integration.ends, group.who.shape[0]
    loaded, waiting, outside = 0, 0, 0
    for lane in range(width):
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            load(group, samples, samples.states[queue[0]], lane, queue[0])
            begin(group, lane, ends.overflow, ends.window)
            group.memory[STEP, lane] = ends.first
            queue[0] += 1
            loaded |= 1 << lane
    if loaded:
        outside = evaluate(group, group.entry.rhs, group.x, 0)
        read_residuals(group, group.x)
    for lane in range(width):
        if (loaded >> lane) & 1:
            _begin(group, ends, lane)
            _draw(group, found, lane)
            code = OUTSIDE if (outside >> lane) & 1 else _code(group, ends, lane)
            if code != OPEN:
                close(group, found, lane, code)
        waiting += int(group.who[lane] == NOBODY)
    return waiting


@inlined
def _look(group, found, ends, bits):
    """Look at the lanes that an attempt gives; whether any is done."""
    width, over = group.who.shape[0], False
    for lane in range(width):
        is_accepted = (bits >> (2 * width + lane)) & 1
        if is_accepted:
            _draw(group, found, lane)
        if (bits >> lane) & 1:
            is_outside = (bits >> (width + lane)) & 1
            code = OUTSIDE if is_outside else TOO_SHORT
            if is_accepted:
                if group.memory[SINCE, lane] == group.memory[DONE, lane]:
                    keep_exit(group, found, lane, group.slopes[BEFORE])
                code = _code(group, ends, lane)
            if code != OPEN:
                close(group, found, lane, code)
                over = True
    return over


@released
def advance_lanes(group, integration, samples, found, queue, attempts):
    """Steps of all lanes, until every sample of a queue is done or so many were tried.

    Parameters
    ----------
    group : Group
        Overwritten.
    integration : Integration
    samples : Samples
    found : Found
        Filled in as samples are done.
    queue : (2,) array of int
        The next sample, and the one at which to stop; overwritten.
    attempts : int

    Returns
    -------
    bool
        Whether all are done.
    """
    width, has_room = group.who.shape[0], True
    address, pointers, sizes = integration.attempt, integration.pointers, integration.sizes
    is_drawn, every = found.curve_times.shape[1] > 0, (1 << group.who.shape[0]) - 1
    for _ in range(attempts):
        while has_room:
            waiting = _fill(group, samples, found, integration, queue)
            if waiting == width and queue[0] >= queue[1]:
                return True
            has_room = waiting == width
        bits = call(address, pointers, sizes)
        if is_drawn or bits & every:
            has_room = _look(group, found, integration.ends, bits)
    return False
