"""A group of samples on their way: one in every lane, as generated code takes them.

A sample that is done makes room for the next one at once, and one that fails costs itself alone: no
lane knows of another, so that what comes out is the same whatever runs beside it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ann_dc.backends.integration.integrator import SETTLED
from ann_dc.backends.lanes.memory import (
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
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.lanes import Entry, Lanes
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.codegen.step_code import UNROLLED, step_code
from ann_dc.evaluation.formulas import compiled, inlined

STALLED = 6
"""How a sample ended whose residual became no smaller; the other codes are the integrator's."""
OPEN = -1
"""The code of a sample that is not done."""
NOBODY = -1
"""In a lane that waits."""


class Samples(NamedTuple):
    """What goes in, one row a sample: B of them."""

    states: np.ndarray
    """(B, n): state vectors at the start."""
    pins: np.ndarray
    """(B, K): neurons that stand still, and those beyond the left end of the row."""
    pinned: np.ndarray
    """(K,): where these lie in a table with ghosts."""
    inputs: np.ndarray
    """(B, N + 2, I)."""
    left: np.ndarray
    """(B, K): what stored blocks say beyond the left end of the row."""
    sides: np.ndarray
    """(B, N, G): sides of poles."""
    weights: np.ndarray
    """(B, E, N): where every sample has its own; (1, E, N): one for all; else nothing."""
    rates: np.ndarray
    """(B, P, N): the same."""
    nominal: np.ndarray
    """(P, N): rates of the network that all are samples of."""


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
    exits: np.ndarray
    """(B, n): states before the step in which the residual fell below the tolerance."""
    spans: np.ndarray
    """(B, 2): when that step began and ended; nan where there was none."""
    curve_sizes: np.ndarray
    """(B,): rows of the curve."""
    curve_times: np.ndarray
    """(B, C): network times; C is 0 where no curves are kept, else one more than are asked for."""
    curves: np.ndarray
    """(B, C, n)."""
    curve_residuals: np.ndarray
    """(B, C, 2)."""

    @classmethod
    def of(cls, starts: np.ndarray, curves: int) -> Found:
        """Room for samples with so many states of each and its end, which are where they start.

        Parameters
        ----------
        starts : (B, n) array
        curves : int
        """
        (count, size), curves = starts.shape, curves + (curves > 0)
        return cls(
            states=starts.copy(),
            codes=np.full(count, OPEN),
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
    """As many samples as there are lanes, on their way; W lanes."""

    entry: Entry
    """The code of the network and its tables."""
    combine: int
    """Address of ``combine``."""
    inputs: np.ndarray
    """(N + 2, I, W) as code reads them."""
    work: np.ndarray
    """(N + 2, K, W)."""
    sides: np.ndarray
    """(N, G, W)."""
    weights: np.ndarray
    """(N, E, W); W is 1 where they are the same for all samples."""
    rates: np.ndarray
    """(N, P, W): the same."""
    roots: np.ndarray
    """Of the samples' rates over the network's; flat, empty where no metric asks for them."""
    components: np.ndarray
    """(n,): where a state vector lies."""
    x: np.ndarray
    """States of all lanes, with ghosts."""
    ahead: np.ndarray
    """States that are tried."""
    slopes: np.ndarray
    """(S + 1, ...)."""
    memory: np.ndarray
    """(rows, W): see `backends.lanes.memory`."""
    who: np.ndarray
    """(W,) samples, or `NOBODY`."""
    stride: np.ndarray
    """(W,): of the curve."""
    padded: int
    """Numbers of all states in whole blocks."""

    @classmethod
    def of(cls, lanes: Lanes, slopes: int, rows: int) -> Group:
        """An empty group with so many slopes and rows of memory.

        It knows the tables of ``lanes`` by their addresses, so these have to live as long.
        """
        entry, steps, width = lanes.entry, step_code(lanes.lanes, is_shared=False), lanes.lanes
        neurons = lanes.ghosted(lanes.tape.values[: lanes.neurons]).ravel()
        table = np.concatenate([neurons, np.zeros(UNROLLED)])
        return cls(
            entry=entry,
            combine=steps["combine"],
            inputs=lanes.tables["inputs"],
            work=lanes.tables["work"],
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
    """The code at an address, into a row of slopes; the lanes outside a domain, as bits."""
    addresses = (group.entry.table.ctypes.data, x.ctypes.data, group.slopes[row].ctypes.data)
    return call(address, addresses, ())


@inlined
def read_residuals(group, x):
    """Those of the states at which slopes were last asked for, into ``found``."""
    found = group.entry.found
    call(
        group.entry.residuals, (group.entry.table.ctypes.data, x.ctypes.data, found.ctypes.data), ()
    )


@inlined
def load(group, samples, state, lane, sample):
    """A sample into a lane, at a state (n,)."""
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
    """Its own weights and rates, if it has them; one network's serve all samples."""
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
def begin(group, lane, overflow, window):
    """A lane's memory before the first step."""
    for row in range(group.memory.shape[0]):
        group.memory[row, lane] = 0.0
    width, largest = group.who.shape[0], 1.0
    for at in range(group.entry.ghost + lane, group.entry.ghost + group.entry.size, width):
        value = abs(group.x[at])  # of pinned ones too
        largest = value if value > largest else largest
    group.memory[RUNS, lane], group.memory[LARGEST, lane] = 1.0, overflow * largest
    group.memory[SINCE, lane], group.memory[TURN, lane] = -1.0, window
    group.memory[BEST, lane] = group.memory[BEST_BEFORE, lane] = np.inf


@inlined
def close(group, found, lane, code):
    """A sample is done: its lane waits for the next."""
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
    """Where a lane is, and the end of its curve."""
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
    """Keep the states before the last step, without ghosts, and the time span of that step."""
    sample = group.who[lane]
    found.spans[sample, 0] = group.memory[SINCE_TIME, lane]
    found.spans[sample, 1] = group.memory[TIME, lane]
    for i in range(group.components.shape[0]):
        found.exits[sample, i] = before[group.components[i] + lane]


@inlined
def draw(group, found, lane, count):
    """State number ``count`` of a curve; where there is no room, every second one goes."""
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
    """The state vector of a lane."""
    for i in range(group.components.shape[0]):
        out[i] = group.x[group.entry.ghost + group.components[i] + lane]


def hand_over(group: Group, found: Found) -> None:
    """Enter where the samples are that nobody goes on with, at the end of their curves too."""
    for lane in np.flatnonzero(group.who != NOBODY):
        enter(group, found, lane)
