"""Group of samples in progress, one per lane, in the layout of generated code.

A finished sample is immediately replaced by the next sample, and a failing sample fails alone.
Lanes are independent, so that the result of a sample does not depend on the samples in other lanes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ann_dc.backends.batched.memory import (
    BEST,
    BEST_BEFORE,
    CONSTRAINT,
    DONE,
    LARGEST,
    RUNS,
    SINCE,
    SINCE_TIME,
    STATIONARITY,
    TIME,
    TURN,
)
from ann_dc.backends.integration.integrator import RUNNING, SETTLED
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.lanes import Entry, Lanes
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.codegen.step_code import UNROLLED, step_code
from ann_dc.evaluation.formulas import compiled, inlined

NOBODY = -1
"""Sample number of a waiting lane."""


class Ends(NamedTuple):
    """End conditions of a sample, besides a left domain."""

    tolerance: float  # residual tolerance of the settling time
    settled: float  # residual that confirms settling
    overflow: float  # largest magnitude of a state, relative to the largest at the start
    most_steps: int  # largest number of steps
    window: int  # number of steps in which the lowest residual must decrease
    headway: float  # required factor of that decrease


class Samples(NamedTuple):
    """Inputs of B samples, one row per sample."""

    states: np.ndarray  # start state vectors (B, n)
    pins: np.ndarray  # values (B, K) of fixed neurons and of the left boundary
    pinned: np.ndarray  # indices (K,) of these values in a table with ghosts
    inputs: np.ndarray  # inputs (B, N + 2, I)
    left: np.ndarray  # values (B, K) of stored blocks at the left boundary
    sides: np.ndarray  # sides (B, N, G) of poles
    weights: np.ndarray  # weights (B, E, N) per sample, (1, E, N) for all samples, or empty
    rates: np.ndarray  # rates (B, P, N) per sample, (1, P, N) for all samples, or empty
    nominal: np.ndarray  # rates (P, N) of the network of which all are samples


class Found(NamedTuple):
    """Results, one row per sample."""

    states: np.ndarray  # state vectors (B, n)
    codes: np.ndarray  # end code (B,) of each sample
    steps: np.ndarray  # numbers of steps (B, 2) until the end, and of settling or -1
    times: np.ndarray  # network times (B, 2) at the end, and of settling
    residuals: np.ndarray  # residuals (B, 2)
    exits: np.ndarray  # states (B, n) before the step in which the residual became small
    spans: np.ndarray  # begin and end (B, 2) of that step; nan if there was none
    curve_sizes: np.ndarray  # number of curve rows (B,)
    curve_times: np.ndarray  # network times (B, C); C is 0 or one more than requested
    curves: np.ndarray  # curve states (B, C, n)
    curve_residuals: np.ndarray  # curve residuals (B, C, 2)

    @classmethod
    def of(cls, starts: np.ndarray, curves: int) -> Found:
        """Return empty results for samples that start at states (B, n).

        The record has room for ``curves`` states of each sample and its end.
        """
        (count, size), curves = starts.shape, curves + (curves > 0)
        return cls(
            states=starts.copy(),
            codes=np.full(count, RUNNING),
            steps=np.tile([0, -1], (count, 1)),
            times=np.full((count, 2), np.nan),
            residuals=np.full((count, 2), np.inf),
            exits=np.zeros((count, size)),
            spans=np.full((count, 2), np.nan),
            curve_sizes=np.zeros(count, np.int64),
            curve_times=np.zeros((count, curves)),
            curves=np.zeros((count, curves, size)),
            curve_residuals=np.zeros((count, curves, 2)),
        )


class Group(NamedTuple):
    """Group of W samples in progress, one per lane."""

    entry: Entry  # code of the network and its tables
    combine: int  # address of ``combine``
    inputs: np.ndarray  # inputs (N + 2, I, W) in the layout of the code
    work: np.ndarray  # values of stored blocks (N + 2, K, W)
    sides: np.ndarray  # sides of poles (N, G, W)
    weights: np.ndarray  # weights (N, E, W); W is 1 if all samples have the same weights
    rates: np.ndarray  # rates (N, P, W); W is 1 if all samples have the same rates
    roots: np.ndarray  # square roots of the rates over the network's; flat, may be empty
    components: np.ndarray  # indices (n,) of the state vector components
    x: np.ndarray  # states of all lanes, with ghosts
    ahead: np.ndarray  # trial states
    slopes: np.ndarray  # slopes (S + 1, ...)
    memory: np.ndarray  # memory (rows, W): see `backends.batched.memory`
    who: np.ndarray  # sample number (W,) of each lane, or `NOBODY`
    stride: np.ndarray  # stride (W,) of the curve
    padded: int  # size of all states in whole blocks

    @classmethod
    def of(cls, lanes: Lanes, slopes: int, rows: int) -> Group:
        """Return an empty group with numbers of slopes and memory rows.

        The group stores addresses of the tables of ``lanes``, which must live as long.
        """
        entry, steps, width = lanes.entry, step_code(lanes.lanes, is_shared=False), lanes.lanes
        neurons = lanes.ghosted(lanes.tape.values[: lanes.neurons]).ravel()
        table = np.concatenate([neurons, np.zeros(UNROLLED)])
        return cls(
            entry=entry,
            combine=steps["combine"],
            inputs=lanes.near(lanes.tables["inputs"]),
            work=lanes.near(lanes.tables["work"]),
            sides=lanes.tables["sides"],
            weights=lanes.tables["weights"],
            rates=lanes.tables["rates"],
            roots=lanes.tables.get("roots", np.zeros(0)),
            components=lanes.components,
            x=lined_up(table),
            ahead=lined_up(table),
            slopes=lined_up(np.zeros((slopes, lanes.spare))),
            memory=lined_up(np.zeros((rows, width))),
            who=np.full(width, NOBODY),
            stride=np.ones(width, np.int64),
            padded=-(-entry.size // UNROLLED) * UNROLLED,
        )


@inlined
def evaluate(group, address, x, row):
    """Run code into a row of slopes; return the lanes outside a domain as bits."""
    addresses = (group.entry.table.ctypes.data, x.ctypes.data, group.slopes[row].ctypes.data)
    return call(address, addresses, ())


@inlined
def read_residuals(group, x):
    """Write the residuals of the last evaluated states into ``found``."""
    found = group.entry.found
    call(
        group.entry.residuals, (group.entry.table.ctypes.data, x.ctypes.data, found.ctypes.data), ()
    )


@inlined
def load(group, samples, state, lane, sample):
    """Load a sample into a lane, at a state (n,)."""
    for i in range(state.shape[0]):
        at = group.entry.ghost + group.components[i] + lane
        group.x[at] = group.ahead[at] = state[i]
    for i in range(samples.pins.shape[1]):
        at = samples.pinned[i] + lane
        group.x[at] = group.ahead[at] = samples.pins[sample, i]
    for k in range(samples.inputs.shape[1]):
        for i in range(samples.inputs.shape[2]):
            group.inputs[k, i, lane] = samples.inputs[sample, k, i]
    for i in range(samples.left.shape[1]):
        group.work[0, i, lane] = samples.left[sample, i]
    for k in range(samples.sides.shape[1]):
        for i in range(samples.sides.shape[2]):
            group.sides[k, i, lane] = samples.sides[sample, k, i]
    _load_numbers(group, samples, lane, sample)
    group.who[lane], group.stride[lane] = sample, 1


@inlined
def _load_numbers(group, samples, lane, sample):
    """Load the weights and rates of a sample, or those shared by all samples."""
    own = sample if samples.weights.shape[0] > 1 else 0
    for i in range(samples.weights.shape[1]):
        for k in range(samples.weights.shape[2]):
            group.weights[k, i, lane] = samples.weights[own, i, k]
    for i in range(samples.rates.shape[1]):
        for k in range(samples.rates.shape[2]):
            rate, nominal = samples.rates[own, i, k], samples.nominal[i, k]
            group.rates[k, i, lane] = rate
            if group.roots.shape[0] > 0 and nominal > 0.0:
                at = (k * samples.rates.shape[1] + i) * group.who.shape[0] + lane
                group.roots[at] = math.sqrt(rate / nominal)


@inlined
def begin(group, samples, ends, lane, sample):
    """Load a sample into a lane and initialise its memory before the first step."""
    load(group, samples, samples.states[sample], lane, sample)
    for row in range(group.memory.shape[0]):
        group.memory[row, lane] = 0.0
    width, largest = group.who.shape[0], 1.0
    for at in range(group.entry.ghost + lane, group.entry.ghost + group.entry.size, width):
        value = abs(group.x[at])  # of pinned ones too
        largest = value if value > largest else largest
    group.memory[RUNS, lane], group.memory[LARGEST, lane] = 1.0, ends.overflow * largest
    group.memory[SINCE, lane], group.memory[TURN, lane] = -1.0, ends.window
    group.memory[BEST, lane] = group.memory[BEST_BEFORE, lane] = np.inf


@inlined
def makes_no_headway(memory, ends, lane):
    """Return True if the lowest residual did not decrease in a window; checked once per window."""
    turn = memory[DONE, lane] // ends.window
    stalled = memory[BEST, lane] >= ends.headway * memory[BEST_BEFORE, lane]
    memory[BEST_BEFORE, lane], memory[BEST, lane] = memory[BEST, lane], np.inf
    memory[TURN, lane] = (turn + 1.0) * ends.window
    return stalled and turn > 2.0


@inlined
def close(group, found, lane, code):
    """Close a finished sample and mark its lane as waiting."""
    sample = group.who[lane]
    found.codes[sample] = code
    enter(group, found, lane)
    if code != SETTLED:
        found.times[sample, 1], found.steps[sample, 1] = np.nan, -1
    group.who[lane] = NOBODY
    for row in range(group.memory.shape[0]):
        group.memory[row, lane] = 0.0


@compiled
def enter(group, found, lane):
    """Enter the state of a lane and the end of its curve into the results."""
    sample = group.who[lane]
    found.steps[sample, 0] = group.memory[DONE, lane]
    found.steps[sample, 1] = group.memory[SINCE, lane]
    found.times[sample, 0] = group.memory[TIME, lane]
    found.times[sample, 1] = group.memory[SINCE_TIME, lane]
    found.residuals[sample, 0] = group.memory[CONSTRAINT, lane]
    found.residuals[sample, 1] = group.memory[STATIONARITY, lane]
    _copy_out(group, lane, found.states[sample])
    last = found.curve_sizes[sample] - 1
    if last >= 0 and found.curve_times[sample, last] < group.memory[TIME, lane]:
        _add_to_curve(group, found, lane)


@inlined
def keep_exit(group, found, lane, before):
    """Store the states before the last step and the time span of that step.

    The states are stored without ghosts.
    """
    sample = group.who[lane]
    found.spans[sample, 0] = group.memory[SINCE_TIME, lane]
    found.spans[sample, 1] = group.memory[TIME, lane]
    for i in range(group.components.shape[0]):
        found.exits[sample, i] = before[group.components[i] + lane]


@inlined
def draw(group, found, lane, count):
    """Add state number ``count`` to a curve, if curves are stored and the state is due.

    A full curve is thinned to every second state.
    """
    if found.curve_times.shape[1] == 0 or count % group.stride[lane] != 0:
        return
    sample, most = group.who[lane], found.curve_times.shape[1] - 1
    if found.curve_sizes[sample] == most:
        for row in range(1, (most + 1) // 2):
            found.curve_times[sample, row] = found.curve_times[sample, 2 * row]
            for i in range(found.curves.shape[2]):
                found.curves[sample, row, i] = found.curves[sample, 2 * row, i]
            for i in range(2):
                found.curve_residuals[sample, row, i] = found.curve_residuals[sample, 2 * row, i]
        found.curve_sizes[sample] = (most + 1) // 2
        group.stride[lane] *= 2
    if count % group.stride[lane] == 0:
        _add_to_curve(group, found, lane)


@inlined
def _add_to_curve(group, found, lane):
    sample = group.who[lane]
    row = found.curve_sizes[sample]
    found.curve_times[sample, row] = group.memory[TIME, lane]
    found.curve_residuals[sample, row, 0] = group.memory[CONSTRAINT, lane]
    found.curve_residuals[sample, row, 1] = group.memory[STATIONARITY, lane]
    _copy_out(group, lane, found.curves[sample, row])
    found.curve_sizes[sample] = row + 1


@inlined
def _copy_out(group, lane, out):
    for i in range(group.components.shape[0]):
        out[i] = group.x[group.entry.ghost + group.components[i] + lane]


def hand_over(group: Group, found: Found) -> None:
    """Enter states and curve ends of unfinished samples into the results."""
    for lane in np.flatnonzero(group.who != NOBODY):
        enter(group, found, lane)
