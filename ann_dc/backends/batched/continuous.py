"""Batches of integrations: every lane has a separate step, tolerance and time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.batched.continuous_code import BEFORE, NUMBERS, UNTIL, WORST, continuous_code
from ann_dc.backends.batched.group import (
    NOBODY,
    Ends,
    Group,
    begin,
    close,
    draw,
    evaluate,
    keep_exit,
    makes_no_headway,
    read_residuals,
)
from ann_dc.backends.batched.memory import (
    BEST,
    CONSTRAINT,
    DONE,
    LARGEST,
    SINCE,
    SINCE_TIME,
    STATIONARITY,
    STEP,
    TIME,
    TURN,
)
from ann_dc.backends.batched.segments import Driven, drive_now, enter_segment
from ann_dc.backends.integration.integrator import (
    DIVERGED,
    LEFT_DOMAIN,
    RUNNING,
    SETTLED,
    STALLED,
    TIME_UP,
    TOO_SHORT,
)
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.formulas import inlined, released


class Integration(NamedTuple):
    """End conditions and code of an integration."""

    ends: Ends  # end conditions of samples
    until: float  # limit on network time
    confirmed: float  # residual that confirms settling at that limit
    first: float  # first trial step
    numbers: np.ndarray  # constants (n,) read by the code
    attempt: int  # address of the code
    driven: Driven  # inputs over time

    @classmethod
    def of(
        cls, group: Group, rows: Rows, ends: Ends, steps: dict[str, float], driven: Driven
    ) -> Integration:
        """Return the integration of a group by the rows of a method's tableau.

        ``steps`` contains the limit on network time ``until``, the ``first`` step, ``rtol``,
        ``atol`` and the residual ``confirmed`` of a sample that is settled at the limit.
        """
        constants = {**ends._asdict(), **steps, "live": group.entry.live}
        return cls(
            ends=ends,
            until=steps["until"],
            confirmed=steps["confirmed"],
            first=steps["first"],
            numbers=lined_up([float(constants[name]) for name in NUMBERS]),
            attempt=continuous_code(rows, len(group.who), is_driven=driven.drive != 0),
            driven=driven,
        )


@inlined
def _code(group, integration, lane):
    """Return the code of a sample after an accepted step, or before the first."""
    memory, size = group.memory, group.entry.found[2 * group.who.shape[0] + lane]
    worst, ends = memory[WORST, lane], integration.ends
    if worst < ends.settled:
        return SETTLED
    if not (size < memory[LARGEST, lane] and worst < np.inf):
        return DIVERGED
    if memory[TIME, lane] >= integration.until and worst < integration.confirmed:
        return SETTLED
    if memory[TIME, lane] >= integration.until or memory[DONE, lane] >= ends.most_steps:
        return TIME_UP
    if memory[DONE, lane] >= memory[TURN, lane] and makes_no_headway(memory, ends, lane):
        return STALLED
    return RUNNING


@inlined
def _enter_residuals(group, ends, lane):
    """Enter the residuals just read into a lane's memory, before the first step of a segment."""
    memory, width = group.memory, group.who.shape[0]
    constraint, stationarity = group.entry.found[lane], group.entry.found[width + lane]
    memory[CONSTRAINT, lane], memory[STATIONARITY, lane] = constraint, stationarity
    worst = max(constraint, stationarity)
    memory[WORST, lane] = memory[BEST, lane] = worst
    if not worst < ends.tolerance:
        memory[SINCE, lane] = -1.0
    elif memory[SINCE, lane] < 0.0:
        memory[SINCE, lane], memory[SINCE_TIME, lane] = memory[DONE, lane], memory[TIME, lane]


@inlined
def _fill(group, samples, found, integration, queue):
    """Load new samples into waiting lanes; return the number of lanes that still wait.

    Slopes and residuals of the loaded samples are evaluated.
    """
    width = group.who.shape[0]
    loaded, waiting, outside = 0, 0, 0
    for lane in range(width):
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            begin(group, samples, integration.ends, lane, queue[0])
            group.memory[STEP, lane] = integration.first
            enter_segment(group, integration.driven, lane, 0)
            queue[0] += 1
            loaded |= 1 << lane
    if loaded:
        drive_now(group, integration.driven)
        outside = evaluate(group, group.entry.rhs, group.x, 0)
        read_residuals(group, group.x)
    for lane in range(width):
        if (loaded >> lane) & 1:
            _enter_residuals(group, integration.ends, lane)
            draw(group, found, lane, int(group.memory[DONE, lane]))
            code = LEFT_DOMAIN if (outside >> lane) & 1 else _code(group, integration, lane)
            if code != RUNNING:
                close(group, found, lane, code)
        waiting += int(group.who[lane] == NOBODY)
    return waiting


@inlined
def _go_on(group, found, integration, moved):
    """Enter the next segments of some lanes, given as bits; return True if any lane is done.

    Slopes and residuals are evaluated again, since inputs may jump.
    """
    driven, over = integration.driven, False
    for lane in range(group.who.shape[0]):
        if (moved >> lane) & 1:
            enter_segment(group, driven, lane, driven.segment[lane] + 1)
    drive_now(group, driven)
    outside = evaluate(group, group.entry.rhs, group.x, 0)
    read_residuals(group, group.x)
    for lane in range(group.who.shape[0]):
        if (moved >> lane) & 1:
            was_settled = group.memory[SINCE, lane] >= 0.0
            _enter_residuals(group, integration.ends, lane)
            if group.memory[SINCE, lane] >= 0.0 and not was_settled:
                found.spans[group.who[lane]] = np.nan  # below the tolerance by the jump alone
            if (outside >> lane) & 1:
                close(group, found, lane, LEFT_DOMAIN)
                over = True
    return over


@inlined
def _reported(group, found, integration, bits, lane):
    """Return the code of a sample in a lane that an attempt reports."""
    width = group.who.shape[0]
    if (bits >> (2 * width + lane)) & 1:
        if group.memory[SINCE, lane] == group.memory[DONE, lane]:
            keep_exit(group, found, lane, group.slopes[BEFORE])
        return _code(group, integration, lane)
    return LEFT_DOMAIN if (bits >> (width + lane)) & 1 else TOO_SHORT


@inlined
def _check(group, found, integration, bits):
    """Check the lanes reported by an attempt; return True if any is done."""
    width, over, moved = group.who.shape[0], False, 0
    for lane in range(width):
        if (bits >> (2 * width + lane)) & 1:
            draw(group, found, lane, int(group.memory[DONE, lane]))
        if (bits >> lane) & 1:
            code = _reported(group, found, integration, bits, lane)
            if code != RUNNING:
                close(group, found, lane, code)
                over = True
            elif group.memory[TIME, lane] >= group.memory[UNTIL, lane]:
                moved |= 1 << lane
    if moved:
        over = _go_on(group, found, integration, moved) or over
    return over


@released
def advance_lanes(group, integration, samples, found, queue, attempts):
    """Take steps of all lanes until the queue is done or the attempts are used.

    The queue (2,) contains the next sample and the end of the range. Returns True if all samples
    are done.
    """
    width, has_room, entry = group.who.shape[0], True, group.entry
    places = (
        entry.rhs, entry.residuals, entry.keep, entry.table.ctypes.data, group.x.ctypes.data,
        group.ahead.ctypes.data, group.slopes.ctypes.data, group.memory.ctypes.data,
        entry.found.ctypes.data, integration.numbers.ctypes.data, integration.driven.drive,
        integration.driven.table.ctypes.data,
    )  # fmt: skip
    sizes = (entry.ghost, group.slopes.shape[1], group.padded)
    is_drawn, every = found.curve_times.shape[1] > 0, (1 << width) - 1
    for _ in range(attempts):
        while has_room:
            waiting = _fill(group, samples, found, integration, queue)
            if waiting == width and queue[0] >= queue[1]:
                return True
            has_room = waiting == width
        bits = call(integration.attempt, places, sizes)
        if is_drawn or bits & every:
            has_room = _check(group, found, integration, bits)
    return False
