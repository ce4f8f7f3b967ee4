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
    copy_out,
    draw,
    end_of_curve,
    largest_at_start,
    load,
    read,
)
from ann_dc.backends.lanes.orders import propose, step_to
from ann_dc.evaluation.formulas import inlined, released

(_H, _LONGEST, _LOWEST, _LIMITED, _AGE, _MARK, _WINDOW, _TIME, _STRAYED, _LARGEST, _BEST,
 _BEFORE, _SIZE, _LOOKED, _BELOW) = range(15)  # fmt: skip


class StepLengths(NamedTuple):
    """A step rule as numbers; see `AdaptiveStep`, whose fields these are."""

    first: float
    """First step, in units of network time."""
    longest: float
    """Longest one."""
    window: float
    """0 for a step that is always the same."""
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


@inlined
def _update(memory, lengths, energy):
    """The next step of a lane, after one that read this energy; see `AdaptiveStep.update`."""
    if lengths.window == 0.0:
        return
    memory[_AGE] += 1.0
    over = memory[_AGE] >= memory[_WINDOW]
    idle = over and memory[_LOWEST] > lengths.progress * memory[_MARK]
    cut = idle or energy > lengths.rise * memory[_LOWEST]
    better = not cut and energy < memory[_LOWEST]
    factor = 1.0
    if cut:
        factor = lengths.cut
    elif better:
        factor = lengths.growth
        if memory[_LIMITED] > 0.0:
            factor = np.exp(lengths.earned * np.log(memory[_LOWEST] / energy))
    if cut or better:
        memory[_LOWEST] = energy
    shortest = lengths.least * memory[_LONGEST]
    memory[_H] = min(max(memory[_H] * factor, shortest), memory[_LONGEST])
    memory[_LIMITED] = 1.0 if cut else memory[_LIMITED]
    if over or cut:
        memory[_AGE], memory[_MARK] = 0.0, memory[_LOWEST]
    if idle:
        memory[_WINDOW] *= 1.5


@inlined
def _begin(group, scratch, lengths, looks, lane):
    """A lane's memory before the first step."""
    memory = scratch.memory[lane]
    for i in range(memory.shape[0]):
        memory[i] = 0.0
    memory[_H] = min(lengths.first, lengths.longest)
    memory[_LONGEST], memory[_WINDOW] = lengths.longest, lengths.window
    memory[_LOWEST] = memory[_MARK] = memory[_BEST] = np.inf
    memory[_LARGEST] = looks.overflow * largest_at_start(group, lane)


@inlined
def _look(group, scratch, found, looks, lane):
    """Enter where a lane is; how it stands."""
    sample, memory = group.who[lane], scratch.memory[lane]
    done = found.steps[sample, 0]
    constraint, stationarity, size = read(group, lane)
    worst = max(constraint, stationarity)
    found.residuals[sample, 0], found.residuals[sample, 1] = constraint, stationarity
    if worst >= looks.tolerance:
        memory[_BELOW] = 0.0
    elif memory[_BELOW] == 0.0:
        memory[_BELOW] = 1.0
        found.times[sample, 1], found.steps[sample, 1] = memory[_TIME], done
    if found.curve_times.shape[1] > 0:
        group.clock[lane, 0] = memory[_TIME]
        if (done // looks.check) % group.stride[lane] == 0:
            draw(group, found, lane, done // looks.check)
    code = _standing(looks, memory, worst)
    if not size < memory[_LARGEST]:
        code = OVERFLOWN
    if _makes_no_headway(memory, looks, worst, size, done) and code == OPEN:
        code = STALLED
    return TIME_UP if code == OPEN and done >= looks.limit else code


@inlined
def _standing(looks, memory, worst):
    """How a residual stands."""
    if memory[_STRAYED] > 0.0:
        return OUTSIDE
    if worst < looks.settled:
        return SETTLED
    return OPEN if worst < np.inf else OVERFLOWN


@inlined
def _makes_no_headway(memory, looks, worst, size, done):
    """Asked once a window: whether its lowest residual is no smaller, and nothing grows."""
    memory[_BEST] = min(memory[_BEST], worst)
    if done // looks.window == memory[_LOOKED]:
        return False
    memory[_LOOKED] = done // looks.window
    stalled = memory[_BEST] >= looks.headway * memory[_BEFORE]
    stalled = stalled and size < looks.growth * memory[_SIZE] and memory[_LOOKED] > 2.0
    memory[_BEFORE], memory[_SIZE], memory[_BEST] = memory[_BEST], size, np.inf
    return stalled


@inlined
def _close(group, scratch, found, lane, code):
    sample = group.who[lane]
    found.codes[sample], found.times[sample, 0] = code, scratch.memory[lane, _TIME]
    if code != SETTLED:
        found.times[sample, 1], found.steps[sample, 1] = np.nan, -1
    copy_out(group, lane, found.states[sample])
    end_of_curve(group, found, lane)
    group.who[lane] = NOBODY


@inlined
def _fill(group, scratch, samples, lengths, looks, queue):
    running = False
    for lane in range(group.who.shape[0]):
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            load(group, samples, 1.0, lane, queue[0])
            _begin(group, scratch, lengths, looks, lane)
            queue[0] += 1
        running = running or group.who[lane] != NOBODY
    return running


@inlined
def _is_due(looks, done):
    """Whether somebody looks after so many steps."""
    return done % looks.check == 0 or done >= looks.limit


@inlined
def _are_due(group, scratch, found, looks):
    """Whether somebody looks at any lane; every lane gets its step on the way."""
    due = False
    for lane in range(group.who.shape[0]):
        group.h[lane] = 0.0
        if group.who[lane] != NOBODY:
            group.h[lane] = scratch.memory[lane, _H]
            due = due or _is_due(looks, found.steps[group.who[lane], 0])
    return due


@inlined
def _judge(group, scratch, found, lengths, looks, lane, is_outside):
    """Look at a lane where it is due; unless its sample is done, its step is as it was read."""
    memory, sample = scratch.memory[lane], group.who[lane]
    energy, done = np.sqrt(group.errors[lane]), found.steps[sample, 0]
    if is_outside:
        memory[_STRAYED], energy = 1.0, np.inf
    if _is_due(looks, done):
        code = _look(group, scratch, found, looks, lane)
        if code != OPEN:
            _close(group, scratch, found, lane, code)
            group.h[lane] = 0.0
            return
    memory[_TIME] += memory[_H]
    group.clock[lane, 0] = memory[_TIME]
    found.steps[sample, 0] = done + 1
    _update(memory, lengths, energy if energy < np.inf else np.inf)


@released
def recur_lanes(group, scratch, samples, found, lengths, looks, queue, attempts):
    """Steps of all lanes, until every sample of a queue is done or so many were done.

    Parameters
    ----------
    group : Group
        Overwritten.
    scratch : Scratch
    samples : Samples
    found : Found
        Filled in as samples are done.
    lengths : StepLengths
    looks : Looks
    queue : (2,) array of int
        The next sample, and the one at which to stop; overwritten.
    attempts : int

    Returns
    -------
    bool
        Whether all are done.
    """
    for _ in range(attempts):
        if not _fill(group, scratch, samples, lengths, looks, queue):
            return True
        outside = propose(group, scratch, looks.order, _are_due(group, scratch, found, looks))
        for lane in range(group.who.shape[0]):
            if group.who[lane] != NOBODY:
                _judge(group, scratch, found, lengths, looks, lane, (outside >> lane) & 1)
        step_to(group, scratch, group.slopes[0], group.x)
    return False
