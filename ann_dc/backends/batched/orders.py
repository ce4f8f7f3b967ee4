"""Update orders of a recurrent step in generated code; see `Order`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.backends.batched.group import evaluate
from ann_dc.backends.batched.memory import STEP
from ann_dc.evaluation.calls import call
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.formulas import inlined
from ann_dc.evaluation.tape import DUAL

SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE = range(3)
"""Codes of the update orders."""


class Scratch(NamedTuple):
    """Memory of a recurrence in addition to a `Group`."""

    duals: np.ndarray  # rows of the dual neurons
    cells: tuple[int, int]  # N and P
    limits: np.ndarray  # saturation limits (P, 2)
    with_limits: np.ndarray  # rows of the neurons with a saturation limit
    drives: np.ndarray  # drives of all lanes in the layout of the code
    kept: np.ndarray  # drives of the state with which a step begins
    before: np.ndarray  # moves of the step before
    one: np.ndarray  # weight (W,) of a single slope in every lane
    none: np.ndarray  # beginning (1,) of that slope
    reach: int  # number of stages on either side on which a drive depends

    @classmethod
    def of(cls, lanes: Lanes) -> Scratch:
        """Return the memory for a network; ``lanes`` must live as long."""
        tape = lanes.tape
        return cls(
            duals=np.flatnonzero(tape.roles == DUAL),
            cells=(lanes.stages, lanes.neurons),
            limits=np.ascontiguousarray(tape.limits),
            with_limits=np.array(lanes.plan.with_limits, np.int64),
            drives=lanes.tables["drives"],
            kept=lined_up(np.zeros(lanes.spare)),
            before=lined_up(np.zeros(lanes.spare)),
            one=np.ones(lanes.lanes),
            none=np.zeros(1, np.int64),
            reach=lanes.plan.phases * lanes.plan.far,
        )


@inlined
def copy(source, target):
    """Copy an array number by number."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@inlined
def _clip_to_limits(scratch, x, width, ghost, stage):
    for row in scratch.with_limits:
        low, high = scratch.limits[row, 0], scratch.limits[row, 1]
        for lane in range(width):
            at = ghost + (stage * scratch.cells[1] + row) * width + lane
            x[at] = min(max(x[at], low), high)


@inlined
def clip_to_limits(group, scratch, x):
    """Clip states to the saturation limits that a step exceeded."""
    for stage in range(scratch.cells[0]):
        _clip_to_limits(scratch, x, group.who.shape[0], group.entry.ghost, stage)


@inlined
def _step_to(group, scratch, derivative, target):
    """Write ``target = x + h derivative`` within the saturation limits."""
    first = 8 * group.entry.ghost
    ends = (target.ctypes.data + first, group.x.ctypes.data + first)
    terms = (derivative.ctypes.data, scratch.one.ctypes.data, scratch.none.ctypes.data)
    call(group.combine, (*ends, *terms, group.memory[STEP].ctypes.data), (1, group.padded))
    clip_to_limits(group, scratch, target)


@inlined
def _rows(scratch, source, target, width):
    """Copy the rows of the dual neurons."""
    chunks, neurons = scratch.cells
    for k in range(chunks):
        for row in scratch.duals:
            for at in range((k * neurons + row) * width, (k * neurons + row + 1) * width):
                target[at] = source[at]


@inlined
def _two_phase(group, scratch):
    """Update primal neurons first, then dual neurons from the updated primal state."""
    width, derivative, second = group.who.shape[0], group.slopes[0], group.slopes[1]
    for i in range(second.shape[0]):
        second[i] = 0.0
    _rows(scratch, second, derivative, width)
    _step_to(group, scratch, derivative, group.ahead)
    evaluate(group, group.entry.cell, group.ahead, 1)
    _rows(scratch, second, derivative, width)


@inlined
def _rate(group, stage, row, lane):
    """Return 1 / tau, of the sample if it has separate rates."""
    return group.rates[stage, row, min(lane, group.rates.shape[2] - 1)]


@inlined
def _stage_by_stage(group, scratch):
    """Update the stages in turn from the values written before; preconditioner at the end."""
    width, (stages, neurons) = group.who.shape[0], scratch.cells
    derivative, table, ghost = group.slopes[0], group.entry.table, group.entry.ghost
    seen = group.slopes[1]
    copy(group.x, group.ahead)
    for k in range(stages):
        table[0], table[1] = max(k - scratch.reach, 0), min(k + scratch.reach + 1, stages)
        evaluate(group, group.entry.cell, group.ahead, 0)
        for p in range(neurons):
            at = (k * neurons + p) * width
            for lane in range(width):
                drive, rate = scratch.drives[at + lane], _rate(group, k, p, lane)
                seen[at + lane] = drive
                group.ahead[ghost + at + lane] += group.memory[STEP, lane] * drive * rate
        _clip_to_limits(scratch, group.ahead, width, ghost, k)
    table[0], table[1] = 0, stages
    for k in range(stages):
        for p in range(neurons):
            at = (k * neurons + p) * width
            for lane in range(width):
                scratch.drives[at + lane] = seen[at + lane]
                derivative[at + lane] = seen[at + lane] * _rate(group, k, p, lane)
    addresses = (table.ctypes.data, derivative.ctypes.data)
    call(group.entry.preconditioner, addresses, ())
    call(
        group.entry.projection, (table.ctypes.data, group.x.ctypes.data, derivative.ctypes.data), ()
    )


@inlined
def reorder(group, scratch, order):
    """Compute moves in another order after simultaneous moves, storing their drives."""
    copy(scratch.drives, scratch.kept)
    if order == TWO_PHASE:
        _two_phase(group, scratch)
    elif order == STAGE_BY_STAGE:
        _stage_by_stage(group, scratch)
