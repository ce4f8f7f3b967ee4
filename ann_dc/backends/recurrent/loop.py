"""The loop of a recurrent layer: reading, moving, and the ledger of who is done."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import torch

from ann_dc.analysis.spectra import is_sound
from ann_dc.backends.run import Settling
from ann_dc.backends.status import OVERFLOW

if TYPE_CHECKING:
    from ann_dc.backends.recurrent.cell.flow import Flow, Reading
    from ann_dc.backends.recurrent.layer import RecurrentLayer

RUNNING, SETTLED, DIVERGED, LEFT_DOMAIN = 0, 1, 2, 3
"""How a sample stands; `RUNNING` at the end means: not settled."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Settled:
    """How B samples ended.

    Attributes
    ----------
    states : (B, n) tensor
        State vectors.
    codes : (B,) tensor
        `SETTLED`, `DIVERGED`, `LEFT_DOMAIN` or `RUNNING`.
    steps : (B,) tensor
        Steps done.
    settling_steps : (B,) tensor
        Steps after which the residual stayed below the tolerance, rounded up to the next look;
        -1 where it did not settle.
    residuals : (2, B) tensor
        Relative constraint and stationarity residuals at the end.
    """

    states: torch.Tensor
    codes: torch.Tensor
    steps: torch.Tensor
    settling_steps: torch.Tensor
    residuals: torch.Tensor

    @property
    def settled(self) -> torch.Tensor:
        """(B,) booleans."""
        return self.codes == SETTLED


class Look(NamedTuple):
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
        self._look: Look | None = None

    @property
    def look(self) -> Look:
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
            self._look = Look(reading, move, energy, rejected)
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
            unsound[sample] = not is_sound(network, network.program.sparse(entries), resting)
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


class Ledger:
    """Who has settled, who is lost, and with what."""

    def __init__(self, loop: Loop, settling: Settling, check: int) -> None:
        self.settling, self.check = settling, check
        count = loop.state.shape[-1]
        like = loop.pace.step
        self.samples = torch.arange(count, device=like.device)
        self.final = loop.state.clone()
        self.codes = torch.full((count,), RUNNING, device=like.device)
        self.steps = torch.zeros_like(self.codes)
        self.last_above = torch.full_like(self.codes, -1)
        self.residuals = torch.full((2, count), torch.inf, dtype=like.dtype, device=like.device)
        self.largest = OVERFLOW * loop.state.nan_to_num().abs().amax((0, 1)).clamp(min=1.0)

    @property
    def open(self) -> torch.Tensor:
        """(b,) booleans: which of the samples in the batch still run."""
        return self.codes[self.samples] == RUNNING

    def book(self, loop: Loop, residuals: torch.Tensor) -> bool:
        """Enter the residuals (2, b), close the samples that are done; whether any still run."""
        look, worst, open_ = loop.look, residuals.amax(0), self.open
        self.last_above[self.samples[open_ & (worst >= self.settling.tolerance)]] = loop.done
        size = loop.state.abs().amax((0, 1))
        settled = worst < self.settling.tolerance * self.settling.confirm
        codes = torch.where(settled, SETTLED, torch.where(worst.isfinite(), RUNNING, DIVERGED))
        codes = torch.where(loop.strayed, LEFT_DOMAIN, codes)
        codes = torch.where(size < self.largest[self.samples], codes, DIVERGED)
        unsound = loop.unsound(open_ & (codes == SETTLED) & ~look.rejected)
        if unsound.any():
            loop.start_again(unsound)
            codes = torch.where(unsound, RUNNING, codes)
        codes = torch.where(look.rejected, RUNNING, codes)
        over = open_ & (codes != RUNNING)
        if not over.any():
            return True
        self._enter(loop, residuals, codes, over)
        left = self.open.nonzero()[:, 0]
        if 0 < 2 * len(left) <= len(self.samples):
            loop.keep(left)
            self.samples = self.samples[left]
        return len(left) > 0

    def _enter(self, loop: Loop, residuals, codes, which: torch.Tensor) -> None:
        samples = self.samples[which]
        self.final[..., samples] = loop.state[..., which]
        self.codes[samples] = codes[which]
        self.steps[samples] = loop.done
        self.residuals[:, samples] = residuals[:, which]

    def close(self, loop: Loop) -> Settled:
        """Enter those that still run, and hand the ledger over."""
        loop.take_back()
        residuals = loop.residuals()
        self._enter(loop, residuals, self.codes[self.samples], self.open)
        return Settled(
            states=loop.layer.cell.pack(self.final),
            codes=self.codes,
            steps=self.steps,
            settling_steps=self._settling_steps(),
            residuals=self.residuals,
        )

    def _settling_steps(self) -> torch.Tensor:
        from_start = self.last_above < 0
        first_below = torch.where(from_start, 0, self.last_above + self.check)
        first_below = torch.minimum(first_below, self.steps)
        return torch.where(self.codes == SETTLED, first_below, -1)
