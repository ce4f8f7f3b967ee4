"""Recurrent steps in generated code: a lane is a sample, with its own length of a step.

The same orders, rules and looks as the recurrent layers have, number by number: see
`backends.recurrent` for what they mean. Neither gradients nor acceleration.
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
    """A step rule as numbers; see `AdaptiveStep`, whose fields these are."""

    first: float
    """First step, in units of network time."""
    longest: float
    """Longest one."""
    window: float
    """Steps after which progress is looked for."""
    growth: float
    """Factor a step until the first cut."""
    cut: float
    """Factor of a cut."""
    rise: float
    """Of the energy, that causes a cut."""
    earned: float
    """Power of the progress by which a step grows after the first cut."""
    progress: float
    """Share of the lowest energy that a window has to get below."""
    least: float
    """Shortest step over the longest."""
    turn: float
    """Sum of sin(angle / 2) between successive moves in which a swing has its peak."""

    @classmethod
    def always(cls, step: float) -> StepLengths:
        """The same step, in units of network time: nothing causes a cut, and no factor is other."""
        return cls(step, step, np.inf, 1.0, 1.0, np.inf, 1.0, 1.0, 1.0, 0.0)

    @property
    def is_fixed(self) -> bool:
        """Whether no step is shorter than the longest."""
        return self.least >= 1.0 and self.first >= self.longest


class Looks(NamedTuple):
    """When somebody looks, and what ends a sample."""

    order: int
    """Which neurons of a step move first."""
    check: int
    """Steps between two looks."""
    limit: int
    """Most steps."""
    tolerance: float
    """Residual, for the settling time."""
    settled: float
    """Residual at which it is sure."""
    overflow: float
    """Magnitude of a state, relative to the largest at the start."""
    window: int
    """Steps in which the lowest residual has to become smaller."""
    headway: float
    """By this factor."""
    growth: float
    """Factor a window by which a state that diverges grows."""


class Pointers(NamedTuple):
    """Where the pieces of a step begin and what they work on: addresses and sizes."""

    rhs: int
    """Of the code of the network."""
    residuals: int
    """The same."""
    look: int
    """Of `recurrence_code`."""
    go_on: int
    """The same."""
    table: int
    """Of all tables."""
    states: int
    """With ghosts."""
    x: int
    """States without them."""
    moves: int
    """Of all neurons."""
    drives: int
    """Those of the states that a step begins with."""
    before: int
    """Moves of the step before."""
    memory: int
    """Of `backends.lanes.memory`."""
    found: int
    """What ``residuals`` gives."""
    numbers: int
    """Constants."""
    padded: int
    """Numbers of all states in whole blocks."""
    has_rails: bool
    """Whether a step may go past one."""


class Recurrence(NamedTuple):
    """How a network's steps go, and where its samples are."""

    scratch: Scratch
    """What orders need."""
    lengths: StepLengths
    """Of steps."""
    looks: Looks
    """And ends."""
    numbers: np.ndarray
    """(n,): constants of both, as code reads them."""
    pointers: Pointers
    """Where all that lies."""
    tick: np.ndarray
    """(2,): steps of the whole group, and that at which a sample has done its last."""

    @classmethod
    def of(cls, lanes: Lanes, group: Group, lengths: StepLengths, looks: Looks) -> Recurrence:
        """For lanes and the group on them, which have to live as long.

        Parameters
        ----------
        lanes : Lanes
        group : Group
        lengths : StepLengths
        looks : Looks
        """
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
    """How a sample stands that has to be looked at more closely."""
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
    """Asked once a window: whether its lowest residual is no smaller, and nothing grows."""
    turn = memory[DONE, lane] // looks.window
    stalled = memory[BEST, lane] >= looks.headway * memory[BEST_BEFORE, lane]
    stalled = stalled and size < looks.growth * memory[SIZE, lane] and turn > 2.0
    memory[BEST_BEFORE, lane], memory[SIZE, lane] = memory[BEST, lane], size
    memory[BEST, lane], memory[TURN, lane] = np.inf, (turn + 1.0) * looks.window
    return stalled


@inlined
def _fill(group, recurrence, samples, queue):
    """New samples into the lanes that wait; whether any lane has one."""
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
    """Look at the lanes that are due, as bits; close those that are done."""
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
    """The lanes to look at, as bits; at the end of some other step than looks are at, few."""
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
    """Steps of all lanes, until every sample of a queue is done or so many were done.

    Lanes are filled at steps at which somebody looks, so that looks at all lanes fall together.

    Parameters
    ----------
    group : Group
        Overwritten.
    recurrence : Recurrence
        Overwritten.
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
