"""Evaluation as loops over numbers: a small interpreter of a `Tape`.

Numba compiles the interpreter once per machine and caches it on disk. A new network is new data,
not new code. Blocks are the outer loop and stages the inner loop, so a step consists of a few long,
regular loops. Intermediate results are stored in a `Workspace`, so nothing is allocated during a
step. Arrays are copied number by number: for an assignment of slices Numba compiles error messages
for three seconds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.evaluation import rules
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.formulas import (
    check_written,
    compiled,
    index,
    inlined,
    inner,
    slope_at,
    value_at,
)
from ann_dc.evaluation.pivots import has_limit, stands_at_limit
from ann_dc.evaluation.preconditioner_arrays import clear, derivative
from ann_dc.evaluation.rules import FLOOR, LOST, OVERFLOW, RAN, SETTLED, SMALLEST_POSITION
from ann_dc.evaluation.tape import (
    BY_VALUE,
    BY_WEIGHT,
    DUAL,
    FUNCTION,
    POSITION,
    PRODUCT,
    STATE,
    SUM,
    Tape,
)

_1, _2, _3 = index(1), index(2), index(3)
_pushes_out = inner(rules.pushes_out)
_is_defined = inner(rules.is_defined)


class Workspace(NamedTuple):
    """Arrays that an evaluation fills; P neurons, N stages."""

    values: np.ndarray
    """Node values (nodes, N + 2); values that are not live come from the tape."""
    drives: np.ndarray
    """Net inputs of the neurons (P, N)."""
    derivatives: np.ndarray
    """State derivatives (P, N), the preconditioned net inputs."""
    nodes: np.ndarray
    """Nodes of a pyramid (grid points, chains), or of the neurons that a stiffness couples (S, 1).
    """
    arriving: np.ndarray
    """Uncut net inputs of neurons with saturation limits (P, N)."""
    clamp: np.ndarray
    """Addresses of a clamp and its table (2,); zero if no neuron with a limit is coupled."""


def workspace(tape: Tape, planes: np.ndarray, clamp: np.ndarray) -> Workspace:
    """Return a new workspace for a tape.

    Raises `NetworkError` if the loops lack a function block.
    """
    check_written(code for kind, _, code, _ in tape.blocks.tolist() if kind == FUNCTION)
    points, chains = max(int(tape.grid_starts[-1]), 1), max(len(tape.chains), 1)
    coupled = len(tape.coupled) - 1
    return Workspace(
        values=tape.values.copy(),
        drives=planes[0],
        derivatives=planes[1],
        nodes=np.zeros((coupled, 1) if coupled else (points, chains)),
        arriving=planes[2],
        clamp=clamp,
    )


@inner
def _copy(source, first, target):
    """Copy a row from a column on."""
    for k in range(target.shape[0]):
        target[k] = source[first + k]


@inlined
def _arrive(sources, weights, values, first, last, out):
    """Sum the connections of a target, four stages at a time (one vector register).

    The last group of four stages may overlap the previous group. For unsigned indices Numba omits
    the test for negative indices, which costs as much as the sum.
    """
    stages, is_near = out.shape[0], out.shape[0] >= 4
    for four in range((stages + 3) // 4 if is_near else 0):
        k = min(4 * four, stages - 4)
        here = index(k)
        a = b = c = d = 0.0
        for i in range(first, last):
            edge, source, column = index(i), index(sources[i, 0]), sources[i, 1] + 1 + k
            if column < 0 or column + 4 > values.shape[1]:
                is_near = False
                break
            there = index(column)
            a += weights[edge, here] * values[source, there]
            b += weights[edge, here + _1] * values[source, there + _1]
            c += weights[edge, here + _2] * values[source, there + _2]
            d += weights[edge, here + _3] * values[source, there + _3]
        out[here], out[here + _1], out[here + _2], out[here + _3] = a, b, c, d
    if not is_near:
        _arrive_from_far(sources, weights, values, first, last, out)


@inner
def _arrive_from_far(sources, weights, values, first, last, out):
    """Sum the connections of a target if a row is short or reads outside the columns."""
    stages = out.shape[0]
    for k in range(stages):
        out[k] = 0.0
    for edge in range(first, last):
        source, shift = sources[edge, 0], sources[edge, 1] + 1
        for k in range(max(0, -shift), min(stages, stages + 2 - shift)):
            out[k] += weights[edge, k] * values[source, k + shift]


@inner
def _gather(tape, neuron, drive):
    """Sum the contributions of all cells to a shared neuron in the last cell."""
    for row in tape.shared:
        if row == neuron:
            for k in range(drive.shape[0] - 1):
                drive[drive.shape[0] - 1] += drive[k]


@compiled
def evaluate(tape, work, x):  # noqa: C901 - a call would hand over every array of the tape
    """Compute the node values and net inputs at the state ``x`` (n,) into ``work``."""
    values, drives = work.values, work.drives
    stages = drives.shape[1]
    for i in range(x.shape[0]):
        values[index(tape.places[i, 0]), index(tape.places[i, 1] + 1)] = x[i]
    for row in tape.shared:
        for k in range(1, stages):
            values[row, k] = values[row, stages]
    for step in range(tape.blocks.shape[0]):
        kind, node = tape.blocks[step, 0], tape.blocks[step, 1]
        a, b = tape.blocks[step, 2], tape.blocks[step, 3]
        if kind == SUM:
            out = values[node, 1 : stages + 1]
            _arrive(tape.sources, tape.weights, values, a, b, out)
        elif kind == PRODUCT:
            for k in range(1, stages + 1):
                values[node, k] = values[a, k] * values[b, k]
        else:
            for k in range(1, stages + 1):
                values[node, k] = value_at(a, values[b, k])
    for p in range(drives.shape[0]):
        first, last = tape.drives[p, 0], tape.drives[p, 1]
        _arrive(tape.sources, tape.weights, values, first, last, drives[p])
        _gather(tape, p, drives[p])
        low, high = tape.limits[p, 0], tape.limits[p, 1]
        for k in range(stages):
            drives[p, k] = drives[p, k] if tape.rates[p, k] != 0.0 else 0.0
        if has_limit(tape.limits, p):
            for k in range(stages):
                work.arriving[p, k] = drives[p, k]
                if _pushes_out(values[p, k + 1], drives[p, k], low, high):
                    drives[p, k] = 0.0


@inlined
def flow(tape, work):
    """Compute derivatives (neurons, N) that lead past no limit, after `evaluate`."""
    derivative(tape, work)
    if work.clamp[0] != 0 and stands_at_limit(tape, work.values):
        for p in tape.reached:
            if not has_limit(tape.limits, p):
                _copy(work.drives[p], 0, work.arriving[p])
        addresses = work.clamp[1], work.values.ctypes.data, work.derivatives.ctypes.data
        call(work.clamp[0], addresses, ())


@inlined
def rhs(tape, work, x, out):
    """Compute dx/ds into ``out`` (n,)."""
    evaluate(tape, work, x)
    flow(tape, work)
    for i in range(x.shape[0]):
        out[i] = work.derivatives[index(tape.places[i, 0]), index(tape.places[i, 1])]


@compiled
def rhs_of_arrays(tape, x, values, planes, nodes, clamp, out):
    """Compute `rhs` for calls from Python.

    Separate arrays take 0.5 us less of 5 us than a record.
    """
    work = Workspace(values, planes[0], planes[1], nodes, planes[2], clamp)
    rhs(tape, work, x, out)


@compiled
def drive_jacobian(tape, work, x, slots, data):
    """Compute the entries (nnz,) of d drive / dx at ``x`` (n,) into ``data``.

    ``slots`` is a workspace.
    """
    evaluate(tape, work, x)
    values = work.values
    stages = values.shape[1] - 2
    for row in range(slots.shape[0]):
        _copy(tape.slot_start[row], 0, slots[row])
    factor = np.empty(stages)
    for step in range(tape.slots.shape[0]):
        target, source, shift = tape.slots[step, 0], tape.slots[step, 1], tape.slots[step, 2] + 1
        kind, index = tape.slots[step, 3], tape.slots[step, 4]
        if kind == BY_WEIGHT:
            _copy(tape.weights[index], 0, factor)
        elif kind == BY_VALUE:
            _copy(values[index], 1, factor)
        else:
            node, code = tape.blocks[index, 1], tape.blocks[index, 2]
            argument = tape.blocks[index, 3]
            for k in range(stages):
                factor[k] = slope_at(code, values[argument, k + 1], values[node, k + 1])
        for k in range(max(0, -shift), min(stages, stages + 2 - shift)):
            slots[target, k + 1] += factor[k] * slots[source, k + shift]
    for i in range(tape.entries.shape[0]):
        data[i] = slots[tape.entries[i, 2], tape.entries[i, 3] + 1]


@compiled
def residuals(tape, work):
    """Compute `rules.residuals` in loops, after `evaluate`."""
    values, drives = work.values, work.drives
    constraint = stationarity = still = 0.0
    position, dual, state = SMALLEST_POSITION, FLOOR, 1.0
    for p in range(drives.shape[0]):
        role = tape.roles[p]
        for k in range(drives.shape[1]):
            drive, value = abs(drives[p, k]), abs(values[p, k + 1])
            if not drive < np.inf:
                return np.inf, np.inf
            if role == DUAL:
                constraint, dual = max(constraint, drive), max(dual, value)
            elif role == STATE:
                still, state = max(still, drive), max(state, value)
            else:
                stationarity = max(stationarity, drive)
                if role == POSITION:
                    position = max(position, value)
    return constraint / position, max(stationarity / dual, still / state)


@compiled
def first_outside(tape, work, guard):
    """Return (block, stage) of the first block outside its domain, or (-1, -1).

    ``guard`` is a `DomainGuard`. Call `evaluate` first.
    """
    values = work.values
    for step in range(tape.blocks.shape[0]):
        if tape.blocks[step, 0] == FUNCTION:
            code, x = tape.blocks[step, 2], tape.blocks[step, 3]
            low, high = guard.domains[code, 0], guard.domains[code, 1]
            inside, signs = True, guard.signs[step]
            for k in range(signs.shape[0]):
                inside &= _is_defined(values[x, k + 1], low, high, signs[k])
            k = 0
            while not inside:
                if not _is_defined(values[x, k + 1], low, high, signs[k]):
                    return step, k
                k += 1
    return -1, -1


@compiled
def clip_to_limits(tape, x):
    """Clip a state ``x`` (n,) to the saturation limits in place."""
    for i in range(x.shape[0]):
        low, high = tape.limits[tape.places[i, 0], 0], tape.limits[tape.places[i, 0], 1]
        x[i] = min(max(x[i], low), high)


@compiled
def recur(tape, work, x, step, bounds, count, tolerance):
    """Run up to ``count`` forward Euler steps of ``step`` on ``x`` (n,) in place.

    A step that would move a neuron further than its slew is shortened for all neurons. ``bounds``
    (`Bounds`) contains the slew, the range of the state, and the domains that the state must not
    leave. ``tape`` and ``work`` are those of `evaluate`.

    Returns the number of steps, the last residual, and the outcome: `RAN`, `SETTLED` (residual
    below ``tolerance``) or `LOST` (left a domain or overflowed).
    """
    last, slew, box, derivatives = np.inf, bounds.slew, bounds.box, work.derivatives
    for done in range(count):
        evaluate(tape, work, x)
        constraint, stationarity = residuals(tape, work)
        last = max(constraint, stationarity)
        if last < tolerance:
            return done, last, SETTLED
        if not last < OVERFLOW or first_outside(tape, work, bounds.guard)[0] >= 0:
            return done, last, LOST
        flow(tape, work)
        reach = step
        for i in range(x.shape[0]):
            speed = abs(derivatives[tape.places[i, 0], tape.places[i, 1]])
            if reach * speed > slew[i]:
                reach = slew[i] / speed
        for i in range(x.shape[0]):
            moved = x[i] + reach * derivatives[tape.places[i, 0], tape.places[i, 1]]
            x[i] = min(max(moved, box[i, 0]), box[i, 1])
    return count, last, RAN


@compiled
def apply_preconditioner(tape, work, drive, out):
    """Compute ``out = M drive``, both (n,)."""
    drives, derivatives = work.drives, work.derivatives
    clear(drives)
    for i in range(drive.shape[0]):
        drives[tape.places[i, 0], tape.places[i, 1]] = drive[i]
    derivative(tape, work)
    for i in range(drive.shape[0]):
        out[i] = derivatives[tape.places[i, 0], tape.places[i, 1]]
