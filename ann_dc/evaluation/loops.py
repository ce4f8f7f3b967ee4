"""The compiled evaluator: one small interpreter over a `Tape`, generic over networks.

Numba compiles it once per machine and caches it on disk; a new network is new data, not new code.
Blocks are the outer loop, stages the inner one, so a step is a few long, regular loops.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from ann_dc.evaluation.tape import (
    BY_VALUE,
    BY_WEIGHT,
    DUAL,
    FUNCTION,
    POSITION,
    PRODUCT,
    STATE,
    SUM,
)
from ann_dc.network.functions import CODE

_SIN = CODE["sin"]
_COS = CODE["cos"]
_TAN = CODE["tan"]
_EXP = CODE["exp"]
_LOG = CODE["log"]
_SQRT = CODE["sqrt"]
RECIPROCAL = CODE["reciprocal"]
_TANH = CODE["tanh"]
_SINH = CODE["sinh"]
_COSH = CODE["cosh"]
_ATAN = CODE["atan"]
_ASIN = CODE["asin"]
_ACOS = CODE["acos"]

FLOOR = 1e-6
"""Smallest scale of positions and of duals to which a residual is related."""

RAN, SETTLED, LOST = 0, 1, 2
"""How a piece of a recurrence ended."""

compiled = nb.njit(cache=True, error_model="numpy", fastmath={"contract", "nsz"})


@compiled
def _value(code, x):  # noqa: C901 - one line a function block
    if code == _SIN:
        return math.sin(x)
    if code == _COS:
        return math.cos(x)
    if code == _TAN:
        return math.tan(x)
    if code == _EXP:
        return np.exp(x)
    if code == _LOG:
        return np.log(x)
    if code == _SQRT:
        return np.sqrt(x)
    if code == RECIPROCAL:
        return 1.0 / x
    if code == _TANH:
        return math.tanh(x)
    if code == _SINH:
        return np.sinh(x)
    if code == _COSH:
        return np.cosh(x)
    if code == _ATAN:
        return math.atan(x)
    if code == _ASIN:
        return np.arcsin(x)
    if code == _ACOS:
        return np.arccos(x)
    return max(x, 0.0)


@compiled
def _slope(code, x, y):  # noqa: C901 - one line a function block
    if code == _SIN:
        return math.cos(x)
    if code == _COS:
        return -math.sin(x)
    if code == _TAN:
        return 1.0 + y * y
    if code == _EXP:
        return y
    if code == _LOG:
        return 1.0 / x
    if code == _SQRT:
        return 0.5 / y
    if code == RECIPROCAL:
        return -y * y
    if code == _TANH:
        return 1.0 - y * y
    if code == _SINH:
        return np.cosh(x)
    if code == _COSH:
        return np.sinh(x)
    if code == _ATAN:
        return 1.0 / (1.0 + x * x)
    if code == _ASIN:
        return 1.0 / np.sqrt(1.0 - x * x)
    if code == _ACOS:
        return -1.0 / np.sqrt(1.0 - x * x)
    return 1.0 if x > 0.0 else 0.0


@compiled
def _arrive(tape, values, first, last, out):
    stages = out.shape[0]
    for k in range(stages):
        out[k] = 0.0
    for edge in range(first, last):
        source, shift = tape.sources[edge, 0], tape.sources[edge, 1] + 1
        for k in range(stages):
            out[k] += tape.weights[edge, k] * values[source, k + shift]


@compiled
def _pushes_out(state, move, low, high):
    """Whether a move would take a state past the rail at which it stands."""
    return (state <= low and move < 0.0) or (state >= high and move > 0.0)


@compiled
def evaluate(tape, x, values, drives):
    """Fill ``values`` (nodes, N + 2) and ``drives`` (neurons, N) at the state ``x`` (n,)."""
    stages = drives.shape[1]
    for i in range(x.shape[0]):
        values[tape.places[i, 0], tape.places[i, 1] + 1] = x[i]
    for step in range(tape.blocks.shape[0]):
        kind, node = tape.blocks[step, 0], tape.blocks[step, 1]
        a, b = tape.blocks[step, 2], tape.blocks[step, 3]
        if kind == SUM:
            _arrive(tape, values, a, b, values[node, 1 : stages + 1])
        elif kind == PRODUCT:
            for k in range(1, stages + 1):
                values[node, k] = values[a, k] * values[b, k]
        else:
            for k in range(1, stages + 1):
                values[node, k] = _value(a, values[b, k])
    for p in range(drives.shape[0]):
        _arrive(tape, values, tape.drives[p, 0], tape.drives[p, 1], drives[p])
        low, high = tape.limits[p, 0], tape.limits[p, 1]
        for k in range(stages):
            dead = tape.rates[p, k] == 0.0
            if dead or _pushes_out(values[p, k + 1], drives[p, k], low, high):
                drives[p, k] = 0.0


@compiled
def _restrict(tape, drives, grid):
    """Add the drives below every hat: the finest level from the chains, each next from the last."""
    grid[:] = 0.0
    for p in range(tape.hats.shape[0]):
        left, share = tape.hats[p], tape.shares[p]
        for j in range(tape.chains.shape[0]):
            drive = drives[tape.chains[j, p & 1], p >> 1]
            grid[left, j] += (1.0 - share) * drive
            grid[left + 1, j] += share * drive
    for level in range(1, tape.levels.shape[0] - 1):
        fine, first = tape.levels[level - 1], tape.levels[level]
        last = tape.levels[level + 1] - first - 1
        for a in range(last + 1):
            for j in range(tape.chains.shape[0]):
                total = grid[fine + 2 * a, j]
                if a > 0:
                    total += 0.5 * grid[fine + 2 * a - 1, j]
                if a < last:
                    total += 0.5 * grid[fine + 2 * a + 1, j]
                grid[first + a, j] = total


@compiled
def _respond(tape, grid):
    """Rates of the coarse neurons plus those of all coarser ones, in place of ``grid``."""
    chains, levels = tape.chains.shape[0], tape.levels.shape[0] - 1
    rates = np.empty(chains)
    for level in range(levels - 1, -1, -1):
        first, last = tape.levels[level], tape.levels[level + 1]
        for a in range(last - first):
            for i in range(chains):
                rates[i] = 0.0
                for j in range(chains):
                    rates[i] += tape.grids[first + a, i, j] * grid[first + a, j]
            if level < levels - 1:
                above = last + (a >> 1)
                for i in range(chains):
                    rates[i] += 0.5 * (grid[above, i] + grid[above + (a & 1), i])
            for i in range(chains):
                grid[first + a, i] = rates[i]


@compiled
def _coordinate(tape, drives, moves, grid):
    """Add the pyramid's part to ``moves``."""
    _restrict(tape, drives, grid)
    _respond(tape, grid)
    for p in range(tape.hats.shape[0]):
        left, share, stage = tape.hats[p], tape.shares[p], p >> 1
        for i in range(tape.chains.shape[0]):
            row = tape.chains[i, p & 1]
            if tape.rates[row, stage] != 0.0:
                moves[row, stage] += (1.0 - share) * grid[left, i] + share * grid[left + 1, i]


@compiled
def move(tape, drives, moves, grid):
    """``moves`` (neurons, N) = M ``drives``: rates and coordinators; ``grid`` is a workspace."""
    for p in range(drives.shape[0]):
        for k in range(drives.shape[1]):
            moves[p, k] = drives[p, k] * tape.rates[p, k]
    if tape.chains.shape[0] > 0:
        _coordinate(tape, drives, moves, grid)


@compiled
def rhs(tape, x, values, drives, moves, grid, out):
    """dx/ds into ``out`` (n,); the four arrays in between are workspaces."""
    evaluate(tape, x, values, drives)
    move(tape, drives, moves, grid)
    for i in range(x.shape[0]):
        p, k = tape.places[i, 0], tape.places[i, 1]
        low, high = tape.limits[p, 0], tape.limits[p, 1]
        out[i] = 0.0 if _pushes_out(x[i], moves[p, k], low, high) else moves[p, k]


@compiled
def drive_jacobian(tape, values, slots, data):
    """Entries of d drive / dx into ``data`` (nnz,), after `evaluate` has filled ``values``."""
    stages = values.shape[1] - 2
    slots[:] = tape.slot_start
    factor = np.empty(stages)
    for step in range(tape.slots.shape[0]):
        target, source, shift = tape.slots[step, 0], tape.slots[step, 1], tape.slots[step, 2] + 1
        kind, index = tape.slots[step, 3], tape.slots[step, 4]
        if kind == BY_WEIGHT:
            for k in range(stages):
                factor[k] = tape.weights[index, k]
        elif kind == BY_VALUE:
            for k in range(stages):
                factor[k] = values[index, k + 1]
        else:
            node, code, argument = (
                tape.blocks[index, 1],
                tape.blocks[index, 2],
                tape.blocks[index, 3],
            )
            for k in range(stages):
                factor[k] = _slope(code, values[argument, k + 1], values[node, k + 1])
        for k in range(stages):
            slots[target, k + 1] += factor[k] * slots[source, k + shift]
    for i in range(tape.entries.shape[0]):
        data[i] = slots[tape.entries[i, 2], tape.entries[i, 3] + 1]


@compiled
def residuals(tape, values, drives):
    """The network's own (constraint, stationarity) residual, relative, after `evaluate`.

    max(|c| / max|q, t|) and max(|grad L| / max|mu, beta|), in network units, the scales not below
    `FLOOR`. The drives are the gradients at the multipliers m = mu + rho c, which equal mu once
    the constraints hold. A network that is no optimiser has max|drive| / max(|x|, 1) instead. The
    certificate of a solution is taken in the user's units, with the problem's own derivatives.
    """
    constraint = stationarity = still = 0.0
    position, dual, state = FLOOR, FLOOR, 1.0
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
def first_outside(tape, values, domains, signs):
    """(block, stage) of the first function block outside its domain, or (-1, -1).

    ``domains`` (codes, 2) holds open intervals, ``signs`` (blocks, N) the sign that the argument
    of each reciprocal had at the start: it must not change.
    """
    for step in range(tape.blocks.shape[0]):
        if tape.blocks[step, 0] == FUNCTION:
            code, x = tape.blocks[step, 2], tape.blocks[step, 3]
            low, high = domains[code, 0], domains[code, 1]
            for k in range(signs.shape[1]):
                value = values[x, k + 1]
                if not (low < value < high) or (
                    code == RECIPROCAL and value * signs[step, k] <= 0.0
                ):
                    return step, k
    return -1, -1


@compiled
def recur(
    tape, x, step, slew, bounds, count, tolerance, domains, signs, values, drives, moves, grid
):
    """Up to ``count`` forward Euler steps of ``step`` on ``x`` in place.

    A step that would move a neuron further than its ``slew`` (n,) is shortened for all of them;
    the state is kept within ``bounds`` (n, 2).

    Returns the number of steps done, the last residual, and `RAN`, `SETTLED` (to ``tolerance``) or
    `LOST` (left a domain or overflowed).
    """
    last = np.inf
    for done in range(count):
        evaluate(tape, x, values, drives)
        constraint, stationarity = residuals(tape, values, drives)
        last = max(constraint, stationarity)
        if last < tolerance:
            return done, last, SETTLED
        if not last < 1e100 or first_outside(tape, values, domains, signs)[0] >= 0:
            return done, last, LOST
        move(tape, drives, moves, grid)
        reach = step
        for i in range(x.shape[0]):
            speed = abs(moves[tape.places[i, 0], tape.places[i, 1]])
            if reach * speed > slew[i]:
                reach = slew[i] / speed
        for i in range(x.shape[0]):
            moved = x[i] + reach * moves[tape.places[i, 0], tape.places[i, 1]]
            x[i] = min(max(moved, bounds[i, 0]), bounds[i, 1])
    return count, last, RAN


@compiled
def apply_metric(tape, drive, drives, moves, grid, out):
    """The metric times a vector: ``out = M drive``, both (n,)."""
    drives[:] = 0.0
    for i in range(drive.shape[0]):
        drives[tape.places[i, 0], tape.places[i, 1]] = drive[i]
    move(tape, drives, moves, grid)
    for i in range(drive.shape[0]):
        out[i] = moves[tape.places[i, 0], tape.places[i, 1]]
