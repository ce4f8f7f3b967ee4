"""Many integrations at once: a lane of every vector is a sample, with its own step and tolerance.

A sample that is done makes room for the next one at once, and one that fails costs itself alone: no
lane knows of another, so that what comes out is the same whatever runs beside it.
"""

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
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.formulas import compiled, released
from ann_dc.evaluation.generated.lanes import Cell, Lanes
from ann_dc.evaluation.vector_code.calls import call
from ann_dc.evaluation.vector_code.step_code import UNROLLED, step_code

STALLED = 6
"""How a sample ended whose residual became no smaller; the other codes are the integrator's."""
OPEN = -1
"""The code of a sample that is not done."""
NOBODY = -1
"""In a lane that waits."""


class Samples(NamedTuple):
    """What goes in, one row a sample: B of them."""

    states: np.ndarray
    """(B, N + 2, P): where to start, with pins and ends."""
    inputs: np.ndarray
    """(B, N + 2, I)."""
    ends: np.ndarray
    """(B, K): what stored blocks say beyond the left end."""
    sides: np.ndarray
    """(B, N, G): sides of poles."""


class Found(NamedTuple):
    """What comes out, one row a sample."""

    states: np.ndarray
    """(B, n): state vectors."""
    codes: np.ndarray
    """(B,): how it ended."""
    steps: np.ndarray
    """(B, 2): steps done, and after which the residual stayed below the tolerance, or -1."""
    times: np.ndarray
    """(B, 2): network time at the end, and after which the residual stayed below the tolerance."""
    residuals: np.ndarray
    """(B, 2)."""
    curve_sizes: np.ndarray
    """(B,): rows of the curve."""
    curve_times: np.ndarray
    """(B, C): network times; C is 0 where no curves are kept."""
    curves: np.ndarray
    """(B, C, n)."""
    curve_residuals: np.ndarray
    """(B, C, 2)."""

    @classmethod
    def of(cls, count: int, size: int, curves: int) -> Found:
        """Room for so many samples of n neurons with so many states of each."""
        return cls(
            states=np.full((count, size), np.nan),
            codes=np.full(count, OPEN),
            steps=np.tile([0, -1], (count, 1)),
            times=np.full((count, 2), np.nan),
            residuals=np.full((count, 2), np.inf),
            curve_sizes=np.zeros(count, np.int64),
            curve_times=np.zeros((count, curves)),
            curves=np.zeros((count, curves, size)),
            curve_residuals=np.zeros((count, curves, 2)),
        )


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
    window: int
    """Steps in which the lowest residual has to become smaller."""
    headway: float
    """By this factor."""
    rtol: float
    atol: float


class Group(NamedTuple):
    """As many samples as there are lanes, on their way; W lanes."""

    cell: Cell
    combine: int
    error: int
    accept: int
    inputs: np.ndarray
    """(N + 2, I, W) as code reads them."""
    work: np.ndarray
    """(N + 2, K, W)."""
    sides: np.ndarray
    """(N, G, W)."""
    components: np.ndarray
    """(n,): where a state vector lies."""
    x: np.ndarray
    ahead: np.ndarray
    slopes: np.ndarray
    """(S + 1, ...)."""
    offsets: np.ndarray
    """(entries,): where the slope of every entry of ``rows`` begins."""
    scales: np.ndarray
    """(2 W,): rtol, then atol."""
    errors: np.ndarray
    """(2 W,)."""
    h: np.ndarray
    """(W,)."""
    mask: np.ndarray
    """(W,)."""
    who: np.ndarray
    """(W,) samples, or `NOBODY`."""
    clock: np.ndarray
    """(W, 8): time, whether the last step was refused, residual, time and residual before, largest
    state, lowest residual of this window and of the last."""
    stride: np.ndarray
    """(W,): of the curve."""
    padded: int
    """Numbers of all states in whole blocks."""

    @classmethod
    def of(cls, lanes: Lanes, rows: Rows) -> Group:
        """An empty group; ``lanes`` has to live as long."""
        cell, steps, width = lanes.cell, step_code(lanes.lanes, is_shared=False), lanes.lanes
        table = np.zeros(cell.size + 2 * cell.ghost + UNROLLED)
        return cls(
            cell=cell,
            combine=steps["combine"],
            error=steps["error"],
            accept=steps["accept"],
            inputs=lanes.tables["inputs"],
            work=lanes.tables["work"],
            sides=lanes.tables["sides"],
            components=lanes.components,
            x=table,
            ahead=table.copy(),
            slopes=np.zeros((len(rows.starts) - 2, lanes.spare)),
            offsets=rows.which * lanes.spare,
            scales=np.ones(2 * width),
            errors=np.zeros(2 * width),
            h=np.zeros(width),
            mask=np.zeros(width),
            who=np.full(width, NOBODY),
            clock=np.zeros((width, 8)),
            stride=np.ones(width, np.int64),
            padded=-(-cell.size // UNROLLED) * UNROLLED,
        )


_NOW, _REFUSED, _WORST, _BEFORE, _WORST_BEFORE, _LARGEST, _BEST, _BEST_BEFORE = range(8)


@compiled
def _slope(group, x, row):
    """Slopes of all lanes; the lanes outside a domain, as bits."""
    addresses = (group.cell.table.ctypes.data, x.ctypes.data, group.slopes[row].ctypes.data)
    return call(group.cell.rhs, addresses, ())


@compiled
def _residuals(group, x):
    """Those of the states at which slopes were last asked for, into ``found``."""
    found = group.cell.found
    call(group.cell.residuals, (group.cell.table.ctypes.data, x.ctypes.data, found.ctypes.data), ())


@compiled
def _load(group, samples, found, ends, lane, sample):
    """A sample into a lane."""
    width, neurons = group.who.shape[0], samples.states.shape[2]
    largest = 1.0
    for k in range(samples.states.shape[1]):
        for p in range(neurons):
            value = samples.states[sample, k, p]
            at = (k * neurons + p) * width + lane
            group.x[at] = group.ahead[at] = value
        for i in range(samples.inputs.shape[2]):
            group.inputs[k, i, lane] = samples.inputs[sample, k, i]
    for i in range(group.components.shape[0]):
        value = abs(group.x[neurons * width + group.components[i] + lane])
        largest = value if not value <= largest else largest
    for i in range(samples.ends.shape[1]):
        group.work[0, i, lane] = samples.ends[sample, i]
    for k in range(samples.sides.shape[1]):
        for i in range(samples.sides.shape[2]):
            group.sides[k, i, lane] = samples.sides[sample, k, i]
    group.who[lane], group.h[lane], group.stride[lane] = sample, ends.first, 1
    clock = group.clock[lane]
    clock[:] = 0.0
    clock[_LARGEST] = ends.overflow * largest
    clock[_WORST] = clock[_BEST] = clock[_BEST_BEFORE] = np.inf


@compiled
def _read(group, lane):
    """Residuals (constraint, stationarity) of a lane."""
    width = group.who.shape[0]
    return group.cell.found[lane], group.cell.found[width + lane]


@compiled
def _note(group, found, ends, lane):
    """Enter where a lane is now: its settling time, and its curve."""
    sample, clock = group.who[lane], group.clock[lane]
    constraint, stationarity = _read(group, lane)
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
        _draw(group, found, lane)


@compiled
def _draw(group, found, lane):
    """One more state of a curve; where there is no room, every second one goes."""
    sample, most = group.who[lane], found.curve_times.shape[1]
    if found.curve_sizes[sample] == most:
        for row in range(1, (most + 1) // 2):
            found.curve_times[sample, row] = found.curve_times[sample, 2 * row]
            found.curves[sample, row] = found.curves[sample, 2 * row]
            found.curve_residuals[sample, row] = found.curve_residuals[sample, 2 * row]
        found.curve_sizes[sample] = (most + 1) // 2
        group.stride[lane] *= 2
        if found.steps[sample, 0] % group.stride[lane] != 0:
            return
    row = found.curve_sizes[sample]
    found.curve_times[sample, row] = group.clock[lane, _NOW]
    found.curve_residuals[sample, row] = found.residuals[sample]
    _copy_out(group, lane, found.curves[sample, row])
    found.curve_sizes[sample] = row + 1


@compiled
def _copy_out(group, lane, out):
    for i in range(group.components.shape[0]):
        out[i] = group.x[group.cell.ghost + group.components[i] + lane]


@compiled
def _ended(group, found, ends, lane):
    """How a sample stands after a step, or before the first."""
    clock, steps = group.clock[lane], found.steps[group.who[lane], 0]
    worst = clock[_WORST]
    if worst < ends.settled:
        return SETTLED
    size = 0.0
    for i in range(group.components.shape[0]):
        size = max(size, abs(group.x[group.cell.ghost + group.components[i] + lane]))
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


@compiled
def _close(group, found, lane, code):
    """A sample is done: its lane waits for the next."""
    sample = group.who[lane]
    found.codes[sample], found.times[sample, 0] = code, group.clock[lane, _NOW]
    if code != SETTLED:
        found.times[sample, 1], found.steps[sample, 1] = np.nan, -1
    _copy_out(group, lane, found.states[sample])
    if found.curve_times.shape[1] > 0 and found.curve_times[
        sample, found.curve_sizes[sample] - 1
    ] < group.clock[lane, _NOW]:
        group.stride[lane] = 1
        _draw(group, found, lane)
    group.who[lane], group.h[lane] = NOBODY, 0.0


@compiled
def _fill(group, samples, found, ends, queue):
    """New samples into the lanes that wait; their slopes and residuals."""
    loaded = False
    for lane in range(group.who.shape[0]):
        group.mask[lane] = 0.0
        if group.who[lane] == NOBODY and queue[0] < queue[1]:
            _load(group, samples, found, ends, lane, queue[0])
            group.mask[lane] = 1.0
            queue[0] += 1
            loaded = True
    if not loaded:
        return
    outside = _slope(group, group.x, 0)
    _residuals(group, group.x)
    for lane in range(group.who.shape[0]):
        if group.mask[lane] > 0.0:
            _note(group, found, ends, lane)
            code = OUTSIDE if (outside >> lane) & 1 else _ended(group, found, ends, lane)
            if code != OPEN:
                _close(group, found, lane, code)


@compiled
def _try(group, rows, ends):
    """A step of every lane; the lanes that left a domain on the way, as bits."""
    width, first = group.who.shape[0], 8 * group.cell.ghost
    x, ahead = group.x.ctypes.data + first, group.ahead.ctypes.data + first
    slopes, weights = group.slopes.ctypes.data, rows.weights.ctypes.data
    offsets, outside = group.offsets.ctypes.data, 0
    stages = rows.starts.shape[0] - 3
    for stage in range(stages):
        begin, end = rows.starts[stage], rows.starts[stage + 1]
        terms = (slopes, weights + 8 * begin, offsets + 8 * begin, group.h.ctypes.data)
        call(group.combine, (ahead, x, *terms), (end - begin, group.padded))
        outside |= _slope(group, group.ahead, stage + 1)
    begin, middle, end = rows.starts[stages], rows.starts[stages + 1], rows.starts[stages + 2]
    for lane in range(width):
        share = share_of_tolerance(group.clock[lane, _WORST], ends.rtol)
        group.scales[lane], group.scales[width + lane] = share * ends.rtol, share * ends.atol
    terms = (slopes, weights + 8 * begin, offsets + 8 * begin)
    results = (group.scales.ctypes.data, group.errors.ctypes.data)
    call(group.error, (x, ahead, *terms, *results), (middle - begin, end - begin, group.padded))
    _residuals(group, group.ahead)
    return outside


@compiled
def _judge(group, rows, found, lane, is_outside):
    """Whether a lane's step is accepted, and its next one; not a number where there is none."""
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
        _fill(group, samples, found, ends, queue)
        running = False
        for lane in range(group.who.shape[0]):
            group.mask[lane] = 0.0
            if group.who[lane] != NOBODY:
                running = True
                group.h[lane] = min(group.h[lane], ends.until - group.clock[lane, _NOW])
        if not running:
            if queue[0] >= queue[1]:
                return True
            continue
        outside = _try(group, rows, ends)
        for lane in range(group.who.shape[0]):
            if group.who[lane] != NOBODY:
                _judge(group, rows, found, lane, (outside >> lane) & 1)
        addresses = (
            group.x.ctypes.data + 8 * group.cell.ghost,
            group.ahead.ctypes.data + 8 * group.cell.ghost,
            group.slopes.ctypes.data,
            group.slopes[-1].ctypes.data,
            group.mask.ctypes.data,
        )
        call(group.accept, addresses, (group.padded,))
        for lane in range(group.who.shape[0]):
            if group.who[lane] == NOBODY:
                continue
            code = OPEN
            if group.mask[lane] > 0.0:
                _note(group, found, ends, lane)
                code = _ended(group, found, ends, lane)
            elif not group.h[lane] > SHORTEST * max(group.clock[lane, _NOW], ends.first):
                code = OUTSIDE if (outside >> lane) & 1 else TOO_SHORT
            if code != OPEN:
                _close(group, found, lane, code)
    return False
