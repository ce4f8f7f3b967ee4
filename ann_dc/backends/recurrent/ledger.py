"""Who has settled, who is lost, and with what: the book that is kept on a loop.

A sample is closed when its residual has fallen to a small share of the tolerance, when it has
diverged, or when it has left the domain of a function block; what is entered then is what it ends
with. Once half of a batch is closed, the loop goes on with the others alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ann_dc.backends.recurrent.loop import Loop
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import OVERFLOW

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


class Ledger:
    """How every sample of a loop stands.

    Parameters
    ----------
    loop : Loop
        Before its first step.
    settling : Settling
    check : int
        Steps between two records.
    """

    def __init__(self, loop: Loop, settling: Settling, check: int) -> None:
        self.settling, self.check = settling, check
        count = loop.state.shape[-1]
        like = loop.time
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

    def record(self, loop: Loop, residuals: torch.Tensor) -> bool:
        """Enter the residuals (2, b), close the samples that are done; whether any still run."""
        rejected, worst, open_ = loop.proposal.rejected, residuals.amax(0), self.open
        self.last_above[self.samples[open_ & (worst >= self.settling.tolerance)]] = loop.done
        codes = self._codes(loop, worst)
        unsound = loop.unsound(open_ & (codes == SETTLED) & ~rejected)
        if unsound.any():
            loop.start_again(unsound)
            codes = torch.where(unsound, RUNNING, codes)
        codes = torch.where(rejected, RUNNING, codes)
        over = open_ & (codes != RUNNING)
        if not over.any():
            return True
        self._enter(loop, residuals, codes, over)
        left = self.open.nonzero()[:, 0]
        if 0 < 2 * len(left) <= len(self.samples):
            loop.keep(left)
            self.samples = self.samples[left]
        return len(left) > 0

    def _codes(self, loop: Loop, worst: torch.Tensor) -> torch.Tensor:
        """How the samples in the batch stand, by their larger residual (b,)."""
        size = loop.state.abs().amax((0, 1))
        settled = worst < self.settling.tolerance * self.settling.confirm
        codes = torch.where(settled, SETTLED, torch.where(worst.isfinite(), RUNNING, DIVERGED))
        codes = torch.where(loop.strayed, LEFT_DOMAIN, codes)
        return torch.where(size < self.largest[self.samples], codes, DIVERGED)

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
            states=loop.cell.pack(self.final),
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
