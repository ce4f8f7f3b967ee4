"""Batch of samples in progress: current states, next step, and its execution.

The loop combines an update order, a step rule and optionally an acceleration. End conditions and
outcomes are handled by `ledger`.
"""

from __future__ import annotations

import torch

from ann_dc.analysis.saddle import is_strict_minimum
from ann_dc.backends.recurrent.cell.fixed_order import total
from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.backends.recurrent.cell.layer import CellLayer
from ann_dc.backends.recurrent.layers.memory import Memory
from ann_dc.backends.recurrent.layers.moves import move_of
from ann_dc.backends.recurrent.layers.proposal import Proposal
from ann_dc.backends.recurrent.layers.steps import StepState, lengths_of, turn_of
from ann_dc.backends.recurrent.rules.acceleration import Anderson
from ann_dc.backends.recurrent.rules.orders import Order
from ann_dc.backends.recurrent.rules.steps import StepRule
from ann_dc.evaluation.reference import evaluator


class Loop:
    """Batch of B samples, advanced step by step.

    Parameters
    ----------
    flow : Flow
        Flow of the cell for the inputs of the samples.
    state : (P, N, B) tensor
        Initial state.

    Attributes
    ----------
    state : (P, N, B) tensor
        Current state.
    time : (B,) tensor
        Network time.
    strayed : (B,) booleans
        Mask of samples whose function blocks left their domains at some step.
    done : int
        Number of steps.
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
        self.order, self.lengths = order, lengths_of(step, flow)
        self.step_state = StepState.of(self.lengths, state.detach())
        self.memory = acceleration and Memory.of(acceleration, state, flow.constants.rates)
        self.signs = flow.domain_signs(flow.read(state.detach()))
        self.time = torch.zeros_like(self.step_state.step)
        self.strayed = torch.zeros_like(self.step_state.limited)
        self.first = state, self.step_state
        self.before = torch.zeros_like(state.detach()), torch.zeros_like(self.time)
        self.done = 0
        self._proposal: Proposal | None = None

    @property
    def proposal(self) -> Proposal:
        """Next step as the network alone gives it."""
        if self._proposal is None:
            step = self.step_state.step
            reading, move = move_of(self.order, self.flow, self.state, step)
            energy = total((reading.drives * move).detach().abs().flatten(0, 1)).sqrt()
            outside = self.flow.outside(reading, self.signs)
            energy = torch.where(energy.isfinite() & ~outside, energy, torch.inf)
            rejected = torch.zeros_like(outside)
            if self.memory is not None:
                rejected = self.memory.rejects(energy)
            self.strayed = self.strayed | (outside & ~rejected)
            self._proposal = Proposal(self.state, step, reading, move, energy, rejected)
        return self._proposal

    def advance(self) -> None:
        """Take one step of every sample."""
        proposal = self.proposal
        move, energy = self.before
        along = total((proposal.reading.drives * move).detach().flatten(0, 1))
        turn = turn_of(along, proposal.energy * energy)
        self.before = proposal.move.detach(), proposal.energy
        following, cut = self.step_state.next(self.lengths, proposal.energy, turn)
        if self.memory is None:
            state = proposal.following
        else:
            following = self.step_state.where(proposal.rejected, following)
            cut = cut & ~proposal.rejected
            self.memory, state = self.memory.next(proposal, cut)
        self.state = self.flow.within_rails(state)
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
            resting = flow.resting(state)[0].cpu().numpy()
            unsound[sample] = not is_strict_minimum(
                network, evaluator(network).sparse(entries), resting
            )
        return unsound

    def start_again(self, samples: torch.Tensor) -> None:
        """Restart the ``samples`` in a mask (B,) without acceleration."""
        state, step_state = self.first
        self.state = torch.where(samples, state, self.state)
        self.step_state = step_state.where(samples, self.step_state)
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
        self.first = state[..., samples], step_state.select(samples)
        move, energy = self.before
        self.before = move[..., samples], energy[samples]
        self.step_state = self.step_state.select(samples)
        self.memory = self.memory and self.memory.select(samples)
        self.signs = [s if s.shape[-1] == 1 else s[..., samples] for s in self.signs]
        self._proposal = None
