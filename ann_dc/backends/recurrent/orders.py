r"""In which order the neurons of a step move: all at once, duals after primals, stage by stage.

Each order is a map x -> x + h m(x, h); the orders differ in m alone, so that step rules and
acceleration work with every one of them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import torch

from ann_dc.backends.recurrent.cell.flow import Flow, Reading
from ann_dc.hints.words import such_as


@such_as("ann_dc.TWO_PHASE")
class Order(ABC):
    """An update order: a move m(x, h), after which the state is x + h m.

    Attributes
    ----------
    name : str
        As the command line has it.
    """

    name: str

    @abstractmethod
    def move(
        self, flow: Flow, state: torch.Tensor, step: torch.Tensor
    ) -> tuple[Reading, torch.Tensor]:
        """What blocks say at a state, and the move m: the next state is state + step * m.

        Parameters
        ----------
        flow : Flow
        state : (P, N, B) tensor
            In network units.
        step : (B,) tensor
            h, in units of network time.

        Returns
        -------
        reading : Reading
            At ``state`` itself.
        move : (P, N, B) tensor
        """

    def __repr__(self) -> str:
        return self.name


class _Simultaneous(Order):
    name = "simultaneous"

    def move(self, flow, state, step):
        reading = flow.read(state)
        return reading, flow.move(reading.drives, state)


class _TwoPhase(Order):
    name = "two-phase"

    def move(self, flow, state, step):
        reading = flow.read(state)
        first = flow.move(reading.drives, state).index_fill(0, flow.layout.duals, 0.0)
        fresh = flow.within_rails(state + step * first)
        second = flow.read(fresh).drives * flow.constants.rates
        return reading, first.index_copy(0, flow.layout.duals, second[flow.layout.duals])


class _StageByStage(Order):
    name = "stage by stage"

    def move(self, flow, state, step):
        reading = flow.read(state)
        stages, reach = state.shape[1], flow.layout.tape.reach
        seen, moved = [], state
        for k in range(stages):  # one tick of the clock: the one cell there is serves stage k
            first, last = max(k - reach, 0), min(k + reach + 1, stages)
            drive = flow.window(first, last).read(moved[:, first:last]).drives[:, k - first]
            seen.append(drive)
            fresh = flow.within_rails(
                (moved[:, k] + step * drive * flow.constants.rates[:, k])[:, None]
            )
            moved = torch.cat([moved[:, :k], fresh, moved[:, k + 1 :]], dim=1)
        drives = torch.stack(seen, dim=1)
        return reading, flow.move(drives, state)


SIMULTANEOUS: Order = _Simultaneous()
"""All neurons move at once: (16), (17) and forward Euler."""

TWO_PHASE: Order = _TwoPhase()
"""Primal neurons in phase 1, dual neurons in phase 2 on the new residual. Equal to the simultaneous
recurrence with rho + h/tau_dual, on duals that are one step late."""

STAGE_BY_STAGE: Order = _StageByStage()
"""One cell serves the stages in turn and reads what was written before it (Gauss-Seidel) and
moves with its own drive; the metric takes what was said during the sweep and answers at its end."""

ORDERS = {order.name: order for order in (SIMULTANEOUS, TWO_PHASE, STAGE_BY_STAGE)}
"""Every order by its name, for the command line."""
