"""Recurrent steps in generated code: one sample and step length per lane.

Orders, step rules and checks are those of the recurrent layers, number by number; see
`backends.step_rules` for their definition. Gradients and acceleration are not supported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.batched.group import (
    NOBODY,
    Ends,
    begin,
    close,
    draw,
    evaluate,
    makes_no_headway,
    read_residuals,
)
from ann_dc.backends.batched.memory import CONSTRAINT, DONE, LARGEST, STATIONARITY, TURN
from ann_dc.backends.batched.orders import SIMULTANEOUS, Scratch, clip_to_limits, reorder
from ann_dc.backends.batched.recurrence_code import SIZE, STATE, STRAYED, recurrence_code
from ann_dc.backends.batched.step_control import StepLengths
from ann_dc.backends.integration.integrator import (
    DIVERGED,
    LEFT_DOMAIN,
    RUNNING,
    SETTLED,
    STALLED,
    TIME_UP,
)
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.formulas import inlined, released


class Checks(NamedTuple):
    """Update order, check times and end conditions of a sample."""

    order: int  # update order of a step
    check: int  # number of steps between two checks
    growth: float  # factor per window by which a diverging state grows
    ends: Ends  # end conditions


class Recurrence(NamedTuple):
    """Step rule, checks, code and memory of a network's recurrence."""

    scratch: Scratch  # memory of the update orders
    start: np.ndarray  # step state (10,) of a sample before its first step
    checks: Checks  # check times and end conditions
    numbers: np.ndarray  # constants (n,) read by the code
    look: int  # address of ``look`` of `recurrence_code`
    go_on: int  # address of ``go_on`` of `recurrence_code`
    tick: np.ndarray  # steps (2,) of the group, now and when a sample reaches its limit

    @classmethod
    def of(cls, lanes: Lanes, lengths: StepLengths, checks: Checks) -> Recurrence:
        """Return the recurrence of lanes, which must live as long."""
        steps, ends = recurrence_code(lanes.lanes), checks.ends
        return cls(
            scratch=Scratch.of(lanes),
            start=np.array(lengths.start),
            checks=checks,
            numbers=lined_up([ends.tolerance, ends.settled, float(ends.most_steps), *lengths]),
            look=steps["look"],
            go_on=steps["go_on"],
            tick=np.zeros(2, np.int64),
        )


@inlined
def _code(group, checks, lane):
    """Return the code of a sample that needs a check."""
    memory, size = group.memory, group.entry.found[2 * group.who.shape[0] + lane]
    worst, stalled = max(memory[CONSTRAINT, lane], memory[STATIONARITY, lane]), False
    if memory[DONE, lane] >= memory[TURN, lane]:
        stalled = size < checks.growth * memory[SIZE, lane]  # what grows is about to diverge
        memory[SIZE, lane] = size
        stalled = makes_no_headway(memory, checks.ends, lane) and stalled
    if not size < memory[LARGEST, lane]:
        return DIVERGED
    if memory[STRAYED, lane] > 0.0:
        return LEFT_DOMAIN
    if worst < checks.ends.settled:
        return SETTLED
    if not worst < np.inf:
        return DIVERGED
    if stalled:
        return STALLED
    return TIME_UP if memory[DONE, lane] >= checks.ends.most_steps else RUNNING


@inlined
def _fill(group, recurrence, samples, queue):
    """Load new samples into waiting lanes; return True if any lane has a sample."""
    running = False
    for lane in range(group.who.shape[0]):
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            begin(group, samples, recurrence.checks.ends, lane, queue[0])
            for i, row in enumerate(STATE):
                group.memory[row, lane] = recurrence.start[i]
            queue[0] += 1
        running = running or group.who[lane] != NOBODY
    return running


@inlined
def _check(group, recurrence, found, due, outside):
    """Check the due lanes, given as bits; close those that are done."""
    checks = recurrence.checks
    read_residuals(group, group.x)
    places = (
        group.memory.ctypes.data,
        group.entry.found.ctypes.data,
        recurrence.numbers.ctypes.data,
    )
    over = call(recurrence.look, places, (due, outside))
    if over == 0 and found.curve_times.shape[1] == 0:
        return
    for lane in range(group.who.shape[0]):
        if group.who[lane] != NOBODY and (due >> lane) & 1:
            draw(group, found, lane, int(group.memory[DONE, lane]) // checks.check)
        if (over >> lane) & 1:
            if (outside >> lane) & 1:
                group.memory[STRAYED, lane] = 1.0
            code = _code(group, checks, lane)
            if code != RUNNING:
                close(group, found, lane, code)


@inlined
def _due(group, checks, tick):
    """Return the lanes to check as bits; few between the regular check steps."""
    due, left = 0, checks.ends.most_steps
    for lane in range(group.who.shape[0]):
        if group.who[lane] != NOBODY:
            rest = checks.ends.most_steps - int(group.memory[DONE, lane])
            due |= int(rest <= 0 or tick[0] % checks.check == 0) << lane
            left = min(left, rest) if rest > 0 else left
    tick[1] = tick[0] + left
    return due


@released
def recur_lanes(group, recurrence, samples, found, queue, attempts):
    """Take steps of all lanes until the queue is done or the attempts are used.

    Lanes are filled at check steps, so that all lanes are checked together. The queue (2,) contains
    the next sample and the end of the range. Returns True if all samples are done.
    """
    scratch, tick, checks = recurrence.scratch, recurrence.tick, recurrence.checks
    is_simple = checks.order == SIMULTANEOUS
    drives = scratch.drives.ctypes.data if is_simple else scratch.kept.ctypes.data
    x = group.x.ctypes.data + 8 * group.entry.ghost
    places = (
        x, drives, group.slopes.ctypes.data, scratch.before.ctypes.data,
        group.memory.ctypes.data, recurrence.numbers.ctypes.data,
    )  # fmt: skip
    for _ in range(attempts):
        is_time = tick[0] % checks.check == 0
        if is_time and not _fill(group, recurrence, samples, queue):
            return True
        outside = evaluate(group, group.entry.rhs, group.x, 0)
        if is_time or tick[0] >= tick[1]:
            _check(group, recurrence, found, _due(group, checks, tick), outside)
        if not is_simple:
            reorder(group, scratch, checks.order)
        call(recurrence.go_on, places, (group.padded, outside))
        if scratch.with_limits.shape[0] > 0:
            clip_to_limits(group, scratch, group.x)
        tick[0] += 1
    return False
