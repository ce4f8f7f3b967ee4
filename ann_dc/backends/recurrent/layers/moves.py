"""Moves m(x, h) of the update orders on tensors; the next state is x + h m."""

from __future__ import annotations

import torch

from ann_dc.backends.recurrent.cell.flow import Flow, Reading
from ann_dc.backends.recurrent.rules.orders import SIMULTANEOUS, STAGE_BY_STAGE, TWO_PHASE, Order


def move_of(
    order: Order, flow: Flow, state: torch.Tensor, step: torch.Tensor
) -> tuple[Reading, torch.Tensor]:
    """Return the reading at a state and the move m (P, N, B).

    The next state is state + step * m. The state (P, N, B) is in network units, and ``step`` (B,)
    is h in units of network time.
    """
    return _MOVES[order](flow, state, step)


def _simultaneous(flow, state, step):
    reading = flow.read(state)
    return reading, flow.move(reading.arriving, state)


def _two_phase(flow, state, step):
    reading = flow.read(state)
    first = flow.move(reading.arriving, state).index_fill(0, flow.layout.duals, 0.0)
    fresh = flow.within_rails(state + step * first)
    second = flow.read(fresh).drives * flow.constants.rates
    return reading, first.index_copy(0, flow.layout.duals, second[flow.layout.duals])


def _stage_by_stage(flow, state, step):
    reading = flow.read(state)
    stages, reach = state.shape[1], flow.layout.tape.reach
    seen, moved = [], state
    for k in range(stages):  # one tick of the clock: the one cell there is serves stage k
        first, last = max(k - reach, 0), min(k + reach + 1, stages)
        drive = flow.window(first, last).read(moved[:, first:last]).arriving[:, k - first]
        seen.append(drive)
        fresh = flow.within_rails(
            (moved[:, k] + step * drive * flow.constants.rates[:, k])[:, None]
        )
        moved = torch.cat([moved[:, :k], fresh, moved[:, k + 1 :]], dim=1)
    drives = torch.stack(seen, dim=1)
    return reading, flow.move(drives, state)


_MOVES = {
    SIMULTANEOUS: _simultaneous,
    TWO_PHASE: _two_phase,
    STAGE_BY_STAGE: _stage_by_stage,
}
