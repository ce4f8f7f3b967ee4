"""Recurrent steps in generated code: one sample and step length per lane.

Orders, step rules and checks are those of the recurrent layers, number by number; see
`backends.recurrent` for their definition. Gradients and acceleration are not supported.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.integrator import OUTSIDE, OVERFLOWN, SETTLED, TIME_UP
from ann_dc.backends.lanes.group import (
    NOBODY,
    OPEN,
    STALLED,
    Group,
    begin,
    close,
    draw,
    load,
)
from ann_dc.backends.lanes.memory import (
    BEST,
    BEST_BEFORE,
    CONSTRAINT,
    DONE,
    LARGEST,
    STATIONARITY,
    STEP,
    TURN,
)
from ann_dc.backends.lanes.orders import SIMULTANEOUS, Scratch, keep_within_rails, reorder
from ann_dc.backends.lanes.recurrence_code import (
    FLOOR,
    LONGEST,
    LOWEST,
    MARK,
    NUMBERS,
    SIZE,
    STRAYED,
    WINDOW,
    recurrence_code,
)
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.formulas import inlined, released


class StepLengths(NamedTuple):
    """Numbers of a step rule; see `AdaptiveStep` for the fields."""

    first: float
    """First step in units of network time."""
    longest: float
    """Longest step."""
    window: float
    """Number of steps after which progress is checked."""
    growth: float
    """Factor per step until the first cut."""
    cut: float
    """Factor of a cut."""
    rise: float
    """Rise of the energy that causes a cut."""
    earned: float
    """Power of the progress by which a step grows after the first cut."""
    progress: float
    """Fraction of the lowest energy below which a window must get."""
    least: float
    """Shortest step relative to the longest."""
    turn: float
    """Sum of sin(angle / 2) between successive moves in which an oscillation has its peak."""

    @classmethod
    def always(cls, step: float) -> StepLengths:
        """Return the numbers of a constant step in units of network time.

        Nothing causes a cut, and all factors are one.
        """
        return cls(step, step, np.inf, 1.0, 1.0, np.inf, 1.0, 1.0, 1.0, 0.0)

    @property
    def is_fixed(self) -> bool:
        """True if the shortest step equals the longest."""
        return self.least >= 1.0 and self.first >= self.longest


class Looks(NamedTuple):
    """Check times and end conditions of a sample."""

    order: int
    """Update order of a step."""
    check: int
    """Number of steps between two checks."""
    limit: int
    """Largest number of steps."""
    tolerance: float
    """Residual tolerance of the settling time."""
    settled: float
    """Residual that confirms settling."""
    overflow: float
    """Largest magnitude of a state, relative to the largest at the start."""
    window: int
    """Number of steps in which the lowest residual must decrease."""
    headway: float
    """Required factor of that decrease."""
    growth: float
    """Factor per window by which a diverging state grows."""


class Pointers(NamedTuple):
    """Addresses of the functions and memory of a step."""

    rhs: int
    """Address of ``rhs`` in the code of the network."""
    residuals: int
    """Address of ``residuals`` in the code of the network."""
    look: int
    """Address of ``look`` of `recurrence_code`."""
    go_on: int
    """Address of ``go_on`` of `recurrence_code`."""
    table: int
    """Address of the table of all tables."""
    states: int
    """Address of the states with ghosts."""
    x: int
    """Address of the states without ghosts."""
    moves: int
    """Address of the moves of all neurons."""
    drives: int
    """Address of the drives of the states with which a step begins."""
    before: int
    """Address of the moves of the step before."""
    memory: int
    """Address of the rows of `backends.lanes.memory`."""
    found: int
    """Address of the results of ``residuals``."""
    numbers: int
    """Address of the constants."""
    padded: int
    """Size of all states in whole blocks."""
    has_rails: bool
    """True if a step may exceed a saturation limit."""


class Recurrence(NamedTuple):
    """Step rule, checks and memory of a network's recurrence."""

    scratch: Scratch
    """Memory of the update orders."""
    lengths: StepLengths
    """Step lengths."""
    looks: Looks
    """Check times and end conditions."""
    numbers: np.ndarray
    """Constants (n,) of both in the layout of the code."""
    pointers: Pointers
    """Addresses of the memory."""
    tick: np.ndarray
    """Counters (2,): steps of the whole group, and the step at which a sample reaches its limit."""

    @classmethod
    def of(cls, lanes: Lanes, group: Group, lengths: StepLengths, looks: Looks) -> Recurrence:
        """Return the recurrence of lanes and their group, which must live as long."""
        scratch, steps, entry = Scratch.of(lanes), recurrence_code(lanes.lanes), group.entry
        constants = looks._asdict() | lengths._asdict()  # growth is that of steps
        numbers = lined_up([float(constants[name]) for name in NUMBERS])
        is_kept = looks.order != SIMULTANEOUS
        x = group.x.ctypes.data
        pointers = Pointers(
            rhs=entry.rhs,
            residuals=entry.residuals,
            look=steps["look"],
            go_on=steps["go_on"],
            table=entry.table.ctypes.data,
            states=x,
            x=x + group.x.itemsize * entry.ghost,
            moves=group.slopes.ctypes.data,
            drives=(scratch.kept if is_kept else scratch.drives).ctypes.data,
            before=scratch.before.ctypes.data,
            memory=group.memory.ctypes.data,
            found=entry.found.ctypes.data,
            numbers=numbers.ctypes.data,
            padded=group.padded,
            has_rails=len(scratch.railed) > 0,
        )
        return cls(scratch, lengths, looks, numbers, pointers, np.zeros(2, np.int64))


@inlined
def _code(group, looks, lane):
    """Return the code of a sample that needs a check."""
    memory, size = group.memory, group.entry.found[2 * group.who.shape[0] + lane]
    worst = max(memory[CONSTRAINT, lane], memory[STATIONARITY, lane])
    stalled = memory[DONE, lane] >= memory[TURN, lane] and _makes_no_headway(
        memory, looks, size, lane
    )
    if not size < memory[LARGEST, lane]:
        return OVERFLOWN
    if memory[STRAYED, lane] > 0.0:
        return OUTSIDE
    if worst < looks.settled:
        return SETTLED
    if not worst < np.inf:
        return OVERFLOWN
    if stalled:
        return STALLED
    return TIME_UP if memory[DONE, lane] >= looks.limit else OPEN


@inlined
def _makes_no_headway(memory, looks, size, lane):
    """Return True if a window's lowest residual did not decrease and nothing grows.

    The check is made once per window.
    """
    turn = memory[DONE, lane] // looks.window
    stalled = memory[BEST, lane] >= looks.headway * memory[BEST_BEFORE, lane]
    stalled = stalled and size < looks.growth * memory[SIZE, lane] and turn > 2.0
    memory[BEST_BEFORE, lane], memory[SIZE, lane] = memory[BEST, lane], size
    memory[BEST, lane], memory[TURN, lane] = np.inf, (turn + 1.0) * looks.window
    return stalled


@inlined
def _fill(group, recurrence, samples, queue):
    """Load new samples into waiting lanes; return True if any lane has a sample."""
    running, lengths, memory = False, recurrence.lengths, group.memory
    for lane in range(group.who.shape[0]):
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            load(group, samples, samples.states[queue[0]], lane, queue[0])
            begin(group, lane, recurrence.looks.overflow, recurrence.looks.window)
            memory[STEP, lane] = min(lengths.first, lengths.longest)
            memory[LONGEST, lane], memory[WINDOW, lane] = lengths.longest, lengths.window
            memory[LOWEST, lane] = memory[MARK, lane] = memory[FLOOR, lane] = np.inf
            queue[0] += 1
        running = running or group.who[lane] != NOBODY
    return running


@inlined
def _look(group, recurrence, found, due, outside):
    """Check the due lanes, given as bits; close those that are done."""
    at, looks = recurrence.pointers, recurrence.looks
    call(at.residuals, (at.table, at.states, at.found), ())
    over = call(at.look, (at.memory, at.found, at.numbers), (due, outside))
    if over == 0 and found.curve_times.shape[1] == 0:
        return
    for lane in range(group.who.shape[0]):
        if found.curve_times.shape[1] > 0 and group.who[lane] != NOBODY and (due >> lane) & 1:
            count = int(group.memory[DONE, lane]) // looks.check
            if count % group.stride[lane] == 0:
                draw(group, found, lane, count)
        if (over >> lane) & 1:
            if (outside >> lane) & 1:
                group.memory[STRAYED, lane] = 1.0
            code = _code(group, looks, lane)
            if code != OPEN:
                close(group, found, lane, code)


@inlined
def _due(group, looks, tick):
    """Return the lanes to check as bits; few between the regular check steps."""
    due, left = 0, looks.limit
    for lane in range(group.who.shape[0]):
        if group.who[lane] != NOBODY:
            rest = looks.limit - int(group.memory[DONE, lane])
            due |= int(rest <= 0 or tick[0] % looks.check == 0) << lane
            left = min(left, rest) if rest > 0 else left
    tick[1] = tick[0] + left
    return due


@released
def recur_lanes(group, recurrence, samples, found, queue, attempts):
    """Take steps of all lanes until the queue is done or the attempts are used.

    Lanes are filled at check steps, so that all lanes are checked together. The queue (2,) contains
    the next sample and the end of the range. Queue, group and recurrence are overwritten, and
    ``found`` is filled in when samples are done. Returns True if all samples are done.
    """
    at, tick, order = recurrence.pointers, recurrence.tick, recurrence.looks.order
    check = recurrence.looks.check
    for _ in range(attempts):
        is_time = tick[0] % check == 0
        if is_time and not _fill(group, recurrence, samples, queue):
            return True
        outside = call(at.rhs, (at.table, at.states, at.moves), ())
        if is_time or tick[0] >= tick[1]:
            due = _due(group, recurrence.looks, tick)
            _look(group, recurrence, found, due, outside)
        if order != SIMULTANEOUS:
            reorder(group, recurrence.scratch, order)
        terms = (at.x, at.drives, at.moves, at.before, at.memory, at.numbers)
        call(at.go_on, terms, (at.padded, outside))
        if at.has_rails:
            keep_within_rails(group, recurrence.scratch, group.x)
        tick[0] += 1
    return False
