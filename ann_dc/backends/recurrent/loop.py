"""The loop of a recurrent layer: reading, moving, and the ledger of who is done."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import torch

from ann_dc.analysis.second_order import is_strict_minimum
from ann_dc.evaluation.reference import evaluator

if TYPE_CHECKING:
    from ann_dc.backends.recurrent.cell.flow import Flow, Reading
    from ann_dc.backends.recurrent.layer import RecurrentLayer

RUNNING, SETTLED, DIVERGED, LEFT_DOMAIN = 0, 1, 2, 3
"""How a sample stands; `RUNNING` at the end means: not settled."""


class Proposal(NamedTuple):
    """What is known at a state before the next step."""

    reading: Reading
    move: torch.Tensor
    energy: torch.Tensor
    """(B,): sqrt(sum |d m|)."""
    rejected: torch.Tensor
    """(B,): whether the acceleration takes its last step back."""


class Loop:
    """A batch on its way; `state` is (P, N, B), `time` the network time (B,) of each sample.

    ``strayed`` (B,) says whose function blocks have left their domains at some step.
    """

    def __init__(
        self, layer: RecurrentLayer, flow: Flow, state: torch.Tensor, *, accelerated: bool
    ) -> None:
        self.layer, self.flow, self.state = layer, flow, state
        self.pace = layer.step.begin(flow, state.detach())
        self.acceleration = layer.acceleration if accelerated else None
        self.memory = None if self.acceleration is None else self.acceleration.begin(state)
        self.signs = flow.domain_signs(flow.read(state.detach()))
        self.time = torch.zeros_like(self.pace.step)
        self.strayed = torch.zeros_like(self.pace.limited)
        self.first = state, self.pace
        self.done = 0
        self._look: Proposal | None = None

    @property
    def look(self) -> Proposal:
        """What the network says now."""
        if self._look is None:
            reading, move = self.layer.order.move(self.flow, self.state, self.pace.step)
            energy = (reading.drives * move).detach().abs().sum((0, 1)).sqrt()
            outside = self.flow.outside(reading, self.signs)
            energy = torch.where(energy.isfinite() & ~outside, energy, torch.inf)
            rejected = torch.zeros_like(outside)
            if self.acceleration is not None and self.memory is not None:
                rejected = self.acceleration.rejects(self.memory, energy)
            self.strayed = self.strayed | (outside & ~rejected)
            self._look = Proposal(reading, move, energy, rejected)
        return self._look

    def advance(self) -> None:
        """One step of every sample."""
        look, step = self.look, self.pace.step
        pace, cut = self.layer.step.update(self.pace, look.energy)
        if self.acceleration is None or self.memory is None:
            state = self.state + step * look.move
        else:
            cut = cut & ~look.rejected
            pace = type(pace)(*(torch.where(look.rejected, a, b) for a, b in zip(self.pace, pace)))
            self.memory, state = self.acceleration.next(
                self.memory,
                self.done % self.acceleration.memory,
                self.state,
                look.move,
                step,
                self._weight,
                look.energy,
                look.rejected,
                cut,
            )
        self.state = self.flow.within_rails(state)
        self.time = self.time + step
        self.pace, self._look = pace, None
        self.done += 1

    @cached_property
    def _weight(self) -> torch.Tensor:
        rates = self.flow.constants.rates
        return torch.where(rates > 0, rates, 1.0).rsqrt()

    def residuals(self) -> torch.Tensor:
        """(2, B) relative constraint and stationarity residuals."""
        return self.flow.residuals(self.state, self.look.reading.drives)

    def unsound(self, settled: torch.Tensor) -> torch.Tensor:
        """(B,) booleans: which accelerated samples of those that settled rest at no minimum.

        Anderson acceleration finds any equilibrium, the flow alone would leave a saddle.
        """
        unsound = torch.zeros_like(settled)
        if self.memory is None:
            return unsound
        network = self.layer.cell.network
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
        """From the start, without acceleration; ``samples`` are (B,) booleans."""
        state, pace = self.first
        self.state = torch.where(samples, state, self.state)
        self.pace = type(pace)(*(torch.where(samples, a, b) for a, b in zip(pace, self.pace)))
        if self.memory is not None:
            self.memory = self.memory._replace(
                known=self.memory.known & ~samples,
                safe=torch.where(samples, torch.inf, self.memory.safe),
                resume=torch.where(samples, 0.0, self.memory.resume),
            )
        self._look = None

    def take_back(self) -> None:
        """Undo the last step of those samples whose acceleration rejects it."""
        rejected = self.look.rejected
        if self.memory is not None and rejected.any():
            before = self.memory.last_state.T.reshape(self.state.shape)
            self.state, self._look = torch.where(rejected, before, self.state), None

    def keep(self, samples: torch.Tensor) -> None:
        """Go on with these samples only; ``samples`` (b,) are indices."""
        self.flow = self.flow.select(samples)
        self.state, self.time = self.state[..., samples], self.time[samples]
        self.strayed = self.strayed[samples]
        state, pace = self.first
        self.first = state[..., samples], type(pace)(*(part[samples] for part in pace))
        self.pace = type(self.pace)(*(part[samples] for part in self.pace))
        if self.memory is not None:
            self.memory = type(self.memory)(*(part[samples] for part in self.memory))
        self.signs = [s if s.shape[-1] == 1 else s[..., samples] for s in self.signs]
        self._look = None
