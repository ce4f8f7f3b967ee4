"""Batches of integrations: every lane has a separate step, tolerance and time."""

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
    """End conditions of a sample, besides a left domain."""

    until: float
    """Limit on network time."""
    first: float
    """First trial step."""
    tolerance: float
    """Residual tolerance of the settling time."""
    settled: float
    """Residual that confirms settling."""
    overflow: float
    """Largest magnitude of a state, relative to the largest at the start."""
    most_steps: int
    """Largest number of steps of a sample."""
    window: int
    """Number of steps in which the lowest residual must decrease."""
    headway: float
    """Required factor of that decrease."""
    rtol: float
    """Relative tolerance per step, before it shrinks."""
    atol: float
    """Absolute tolerance in network units, before it shrinks."""


class Pointers(NamedTuple):
    """Addresses used by an attempt, in the order in which the code takes them."""

    rhs: int
    """Address of ``rhs`` in the code of the network."""
    residuals: int
    """Address of ``residuals`` in the code of the network."""
    keep: int
    """Address of ``keep`` in the code of the network."""
    table: int
    """Address of the table of all tables."""
    x: int
    """Address of the states, with ghosts."""
    ahead: int
    """Address of the trial states, with ghosts."""
    slopes: int
    """Address of the slopes of all stages."""
    memory: int
    """Address of the rows of `backends.lanes.memory`."""
    found: int
    """Address of the results of ``residuals``."""
    numbers: int
    """Address of the constants."""


class Integration(NamedTuple):
    """End conditions, code and memory addresses of an integration."""

    ends: LaneEnds
    """End conditions of samples."""
    numbers: np.ndarray
    """Constants (n,) read by the code."""
    attempt: int
    """Address of the code."""
    pointers: Pointers
    """Addresses of the memory."""
    sizes: tuple[int, int, int]
    """Size of a ghost, distance between slopes, and size of all states in whole blocks."""

    @classmethod
    def of(cls, group: Group, rows: Rows, ends: LaneEnds) -> Integration:
        """Return the integration of a group, which must live as long as the record.

        The rows are those of the method's tableau.
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
    """Return the code of a sample after an accepted step, or before the first."""
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
    """Initialise a lane's memory before the first step from the residuals just read."""
    memory, width = group.memory, group.who.shape[0]
    constraint, stationarity = group.entry.found[lane], group.entry.found[width + lane]
    memory[CONSTRAINT, lane], memory[STATIONARITY, lane] = constraint, stationarity
    worst = max(constraint, stationarity)
    memory[WORST, lane] = memory[BEST, lane] = worst
    if worst < ends.tolerance:
        memory[SINCE, lane] = 0.0


@inlined
def _draw(group, found, lane):
    """Add a lane's state to its curve, if curves are stored."""
    count = int(group.memory[DONE, lane])
    if found.curve_times.shape[1] > 0 and count % group.stride[lane] == 0:
        draw(group, found, lane, count)


@inlined
def _fill(group, samples, found, integration, queue):
    """Load new samples into waiting lanes; return the number of lanes that still wait.

    Slopes and residuals of the loaded samples are evaluated.
    """
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
    """Check the lanes reported by an attempt; return True if any is done."""
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
    """Take steps of all lanes until the queue is done or the attempts are used.

    The queue (2,) contains the next sample and the end of the range; it and the group are
    overwritten, and ``found`` is filled in when samples are done. Returns True if all samples are
    done.
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
