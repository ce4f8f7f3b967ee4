"""Last exits of residuals inside their steps, located after a batch.

The step in which a residual finally falls below the tolerance is repeated from the state before it,
and its continuous extension is evaluated. `integration.between` does the same for a single run.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.batched.continuous_code import AT
from ann_dc.backends.batched.group import (
    NOBODY,
    Group,
    evaluate,
    load,
    read_residuals,
)
from ann_dc.backends.batched.memory import STEP, TIME
from ann_dc.backends.batched.segments import Driven, drive, enter_segment
from ann_dc.backends.integration.between import ROUNDS
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.formulas import inlined, released

CLOSE = 1e-4
"""Relative distance to the tolerance at which a lane is done: the accuracy of batch residuals."""


class Again(NamedTuple):
    """Repeated steps, one per lane."""

    stages: int  # number of rows of the step; extra stages and the state inside follow
    starts: np.ndarray  # beginning of every row, (rows + 1,)
    offsets: np.ndarray  # beginning of the slope of every entry, (entries,)
    weights: np.ndarray  # weights (entries, W); the last row is that of the states inside
    powers: np.ndarray  # powers of `Extension`
    theta: np.ndarray  # evaluated position (W,) in the step of each lane
    ends: np.ndarray  # fractions (2, W) of the step above and below the tolerance
    logs: np.ndarray  # logarithms (2, W) of the residuals there, over the tolerance
    is_open: np.ndarray  # mask (W,) of lanes that continue
    sides: np.ndarray  # index (W,) of the end that the last evaluation replaced, or -1
    shares: np.ndarray  # fraction (rows,) of the step of every row but the last
    driven: Driven  # inputs over time

    @classmethod
    def of(cls, group: Group, rows: Rows, driven: Driven) -> Again:
        """Return the record for a group, which must live as long; rows are the method's."""
        width, length, extension = len(group.who), group.slopes.shape[1], rows.extension
        stages, which = len(rows.starts) - 3, rows.which[: rows.starts[-3]]
        weights = np.concatenate([rows.weights[: len(which)], extension.weights])
        starts = np.concatenate([rows.starts[:stages], len(which) + extension.starts])
        return cls(
            stages=stages,
            starts=starts,
            offsets=np.concatenate([which, extension.which]) * length,
            weights=np.repeat(weights[:, None], width, axis=1),
            powers=extension.powers,
            theta=np.zeros(width),
            ends=np.zeros((2, width)),
            logs=np.zeros((2, width)),
            is_open=np.zeros(width, np.bool_),
            sides=np.zeros(width, np.int64),
            shares=np.add.reduceat(weights, starts[:-1]),
            driven=driven,
        )


@inlined
def _keep(group):
    addresses = group.entry.table.ctypes.data, group.ahead.ctypes.data, group.ahead.ctypes.data
    call(group.entry.keep, addresses, ())


@inlined
def _drive(group, again, x, row):
    """Set the inputs to the times of a row, or of the starts of the steps for row -1."""
    if again.driven.drive == 0:
        return
    is_inside = row == again.starts.shape[0] - 2
    for lane in range(again.theta.shape[0]):
        share = again.theta[lane] if is_inside else again.shares[row] if row >= 0 else 0.0
        group.memory[AT, lane] = group.memory[TIME, lane] + share * group.memory[STEP, lane]
    drive(group, again.driven, x)


@inlined
def _move(group, again, row):
    """Compute the state of a row and its slope.

    States at the ends of steps and inside are within the saturation limits.
    """
    at, first, last = 8 * group.entry.ghost, again.starts[row], again.starts[row + 1]
    addresses = (
        group.ahead.ctypes.data + at,
        group.x.ctypes.data + at,
        group.slopes.ctypes.data,
        again.weights[first].ctypes.data,
        again.offsets.ctypes.data + 8 * first,
        group.memory[STEP].ctypes.data,
    )
    call(group.combine, addresses, (last - first, group.padded))
    if row == again.stages - 1 or row == again.starts.shape[0] - 2:
        _keep(group)
    _drive(group, again, group.ahead, row)
    evaluate(group, group.entry.rhs, group.ahead, row + 1)


@inlined
def _above(group, lane, tolerance):
    """Return the logarithm of a residual over the tolerance; infinite if it is nan."""
    found, width = group.entry.found, group.who.shape[0]
    worst = max(found[lane], found[width + lane])
    return np.log(max(worst, 1e-300) / tolerance) if worst < np.inf else np.inf


@inlined
def _take(group, again, tolerance):
    """Evaluate all slopes of steps and extension, and the residuals at their ends."""
    ends, logs = again.ends, again.logs
    _drive(group, again, group.x, -1)
    evaluate(group, group.entry.rhs, group.x, 0)
    read_residuals(group, group.x)
    ends[0], ends[1] = 0.0, 1.0
    for lane in range(again.theta.shape[0]):
        logs[0, lane] = max(_above(group, lane, tolerance), 0.0)
    for row in range(again.starts.shape[0] - 2):
        _move(group, again, row)
        if row == again.stages - 1:
            read_residuals(group, group.ahead)
            for lane in range(again.theta.shape[0]):
                logs[1, lane] = min(_above(group, lane, tolerance), -CLOSE)


@inlined
def _check(group, again):
    """Evaluate the residuals of the states inside the steps."""
    powers, theta, row = again.powers, again.theta, again.starts.shape[0] - 2
    for i in range(powers.shape[0]):
        for lane in range(theta.shape[0]):
            weight = 0.0
            for power in range(powers.shape[1] - 1, -1, -1):
                weight = (weight + powers[i, power]) * theta[lane]
            again.weights[again.starts[row] + i, lane] = weight
    _move(group, again, row)
    read_residuals(group, group.ahead)


@inlined
def _cross(group, again, tolerance):
    """Find where residuals cross the tolerance, by false position in their logarithms."""
    ends, logs, is_open, theta = again.ends, again.logs, again.is_open, again.theta
    is_open[:], again.sides[:] = True, -1
    for _ in range(ROUNDS):
        is_over = True
        for lane in range(is_open.shape[0]):
            if is_open[lane]:
                a, b, high, low = ends[0, lane], ends[1, lane], logs[0, lane], logs[1, lane]
                theta[lane] = b - low * (b - a) / (low - high) if high < np.inf else 0.5 * (a + b)
                is_over = False
        if is_over:
            return
        _check(group, again)
        for lane in range(is_open.shape[0]):
            if is_open[lane]:
                log = _above(group, lane, tolerance)
                side = 0 if log >= 0.0 else 1
                if again.sides[lane] == side:  # Anderson, Björck: an end that stays counts less
                    share = 1.0 - log / logs[side, lane]
                    logs[1 - side, lane] *= share if share > 0.0 else 0.5
                ends[side, lane], logs[side, lane] = theta[lane], log
                again.sides[lane] = side
                is_open[lane] = not abs(log) < CLOSE


@released
def locate_exits(group, again, samples, found, chosen, tolerance):
    """Locate last exits of chosen samples (K,) in a group without running samples.

    ``exits`` and ``spans`` of ``found`` are read, and its ``times`` are overwritten.
    """
    width, count = group.who.shape[0], chosen.shape[0]
    for first in range(0, count, width):
        for lane in range(width):
            sample = chosen[min(first + lane, count - 1)]
            load(group, samples, found.exits[sample], lane, sample)
            group.memory[STEP, lane] = found.spans[sample, 1] - found.spans[sample, 0]
            group.memory[TIME, lane] = found.spans[sample, 0]
            number = np.searchsorted(
                again.driven.lines.breakpoints, found.spans[sample, 0], "right"
            )
            enter_segment(group, again.driven, lane, number - 1)
        _take(group, again, tolerance)
        _cross(group, again, tolerance)
        for lane in range(min(width, count - first)):
            sample = chosen[first + lane]
            moved = again.theta[lane] * group.memory[STEP, lane]
            found.times[sample, 1] = found.spans[sample, 0] + moved
    group.who[:], group.memory[STEP], group.memory[TIME] = NOBODY, 0.0, 0.0
