"""Batch of samples in progress: current states, next step, and its execution.

The next state of an order is x + h m(x, h). `ledger` handles end conditions and outcomes.
"""

from __future__ import annotations

import torch

from ann_dc.analysis.saddle import is_strict_minimum
from ann_dc.backends.batched.step_control import StepState, next_step, turn_of
from ann_dc.backends.layers.cell_layer import CellLayer
from ann_dc.backends.layers.fixed_order import LIBRARY, total
from ann_dc.backends.layers.flow import Flow, Reading
from ann_dc.backends.layers.memory import Memory, Proposal
from ann_dc.backends.step_rules import (
    SIMULTANEOUS,
    TWO_PHASE,
    Anderson,
    Order,
    StepRule,
    lengths_of,
)
from ann_dc.evaluation.reference import evaluator


def derivative_of(
    order: Order, flow: Flow, state: torch.Tensor, step: torch.Tensor
) -> tuple[Reading, torch.Tensor]:
    """Return the reading at a state (P, N, B) and the move m (P, N, B) for steps h (B,)."""
    reading, duals = flow.read(state), flow.layout.duals
    if order not in (SIMULTANEOUS, TWO_PHASE):
        return reading, _stage_by_stage(flow, state, step)
    derivative = flow.derivative(reading.arriving, state)
    if order == TWO_PHASE:
        derivative = derivative.index_fill(0, duals, 0.0)
        fresh = flow.within_limits(state + step * derivative)
        second = flow.read(fresh).drives * flow.constants.rates
        derivative = derivative.index_copy(0, duals, second[duals])
    return reading, derivative


def _stage_by_stage(flow: Flow, state: torch.Tensor, step: torch.Tensor) -> torch.Tensor:
    stages, reach = state.shape[1], flow.layout.tape.reach
    seen, moved = [], state
    for k in range(stages):  # one tick of the clock: the one cell there is serves stage k
        first, last = max(k - reach, 0), min(k + reach + 1, stages)
        drive = flow.window(first, last).read(moved[:, first:last]).arriving[:, k - first]
        seen.append(drive)
        fresh = flow.within_limits(
            (moved[:, k] + step * drive * flow.constants.rates[:, k])[:, None]
        )
        moved = torch.cat([moved[:, :k], fresh, moved[:, k + 1 :]], dim=1)
    return flow.derivative(torch.stack(seen, dim=1), state)


class Loop:
    """Batch of B samples, advanced step by step from a ``state`` (P, N, B).

    ``strayed`` (B,) marks samples whose function blocks left their domains at some step.
    """

    def __init__(
        self,
        cell: CellLayer,
        flow: Flow,
        state: torch.Tensor,
        *,
        order: Order,
        step: StepRule,
        acceleration: Anderson | None,
    ) -> None:
        self.cell, self.flow, self.state = cell, flow, state
        self.order, self.lengths = order, lengths_of(step, flow.limits.of(flow.constants))
        row = torch.zeros_like(state.detach()[0, 0])
        self.step_state = StepState(*(torch.full_like(row, n) for n in self.lengths.start))
        self.memory = acceleration and Memory.of(acceleration, state, flow.constants.rates)
        self.signs = flow.domain_signs(flow.read(state.detach()))
        self.time, self.strayed = row, torch.zeros_like(row, dtype=torch.bool)
        self.first = state, self.step_state
        self.before = torch.zeros_like(state.detach()), torch.zeros_like(self.time)
        self.done = 0
        self._proposal: Proposal | None = None

    @property
    def proposal(self) -> Proposal:
        """Next step as the network alone gives it."""
        if self._proposal is None:
            step = self.step_state.step
            reading, derivative = derivative_of(self.order, self.flow, self.state, step)
            energy = total((reading.drives * derivative).detach().abs().flatten(0, 1)).sqrt()
            outside = self.flow.outside(reading, self.signs)
            energy = torch.where(energy.isfinite() & ~outside, energy, torch.inf)
            rejected = torch.zeros_like(outside)
            if self.memory is not None:
                rejected = self.memory.rejects(energy)
            self.strayed = self.strayed | (outside & ~rejected)
            self._proposal = Proposal(self.state, step, reading, derivative, energy, rejected)
        return self._proposal

    def advance(self) -> None:
        """Take one step of every sample."""
        proposal = self.proposal
        derivative, energy = self.before
        along = total((proposal.reading.drives * derivative).detach().flatten(0, 1))
        turn = turn_of(LIBRARY, along, proposal.energy * energy)
        self.before = proposal.derivative.detach(), proposal.energy
        following, cut = next_step(LIBRARY, self.lengths, self.step_state, proposal.energy, turn)
        if self.memory is None:
            state = proposal.state + proposal.step * proposal.derivative
        else:
            following = _where(proposal.rejected, self.step_state, following)
            cut = cut & ~proposal.rejected
            self.memory, state = self.memory.next(proposal, cut)
        self.state = self.flow.within_limits(state)
        self.time = self.time + proposal.step
        self.step_state, self._proposal = following, None
        self.done += 1

    def residuals(self) -> torch.Tensor:
        """Return the relative constraint and stationarity residuals (2, B)."""
        return self.flow.residuals(self.state, self.proposal.reading.drives)

    def unsound(self, settled: torch.Tensor) -> torch.Tensor:
        """Return a mask (B,) of settled accelerated samples that are not at a minimum.

        Anderson acceleration finds any equilibrium, whereas the flow alone would leave a saddle.
        """
        unsound = torch.zeros_like(settled)
        if self.memory is None:
            return unsound
        network = self.cell.network
        for sample in (settled & (self.memory.resume > 0)).nonzero()[:, 0].tolist():
            index = torch.tensor([sample], device=settled.device)
            state, flow = self.state[..., index], self.flow.select(index)
            entries = flow.jacobian_entries(state)[:, 0].cpu().double().numpy()
            saturated = flow.saturated(state)[0].cpu().numpy()
            unsound[sample] = not is_strict_minimum(
                network, evaluator(network).sparse(entries), saturated
            )
        return unsound

    def start_again(self, samples: torch.Tensor) -> None:
        """Restart the ``samples`` in a mask (B,) without acceleration."""
        state, step_state = self.first
        self.state = torch.where(samples, state, self.state)
        self.step_state = _where(samples, step_state, self.step_state)
        self.memory = self.memory and self.memory.ended(samples)
        self._proposal = None

    def take_back(self) -> None:
        """Undo the last step of those samples whose acceleration rejects it."""
        rejected = self.proposal.rejected
        if self.memory is not None and rejected.any():
            before = torch.where(rejected, self.memory.last_state, self.state)
            self.state, self._proposal = before, None

    def keep(self, samples: torch.Tensor) -> None:
        """Continue with the ``samples`` of the given indices (b,) only."""
        self.flow = self.flow.select(samples)
        self.state, self.time = self.state[..., samples], self.time[samples]
        self.strayed = self.strayed[samples]
        state, step_state = self.first
        self.first = state[..., samples], _select(step_state, samples)
        derivative, energy = self.before
        self.before = derivative[..., samples], energy[samples]
        self.step_state = _select(self.step_state, samples)
        self.memory = self.memory and self.memory.select(samples)
        self.signs = [s if s.shape[-1] == 1 else s[..., samples] for s in self.signs]
        self._proposal = None


def _select(state: StepState, samples: torch.Tensor) -> StepState:
    return StepState(*(part[samples] for part in state))


def _where(samples: torch.Tensor, a: StepState, b: StepState) -> StepState:
    """Return a for ``samples``, a mask (B,), and b for the rest."""
    return StepState(*(torch.where(samples, mine, other) for mine, other in zip(a, b)))
