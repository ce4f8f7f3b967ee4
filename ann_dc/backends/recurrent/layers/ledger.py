"""Sample outcomes of a loop: settled, failed or running.

A sample is closed when its residual has fallen to a small fraction of the tolerance or no longer
decreases. It is also closed when it has diverged or left the domain of a function block. Its final
values are entered then. Once half of a batch is closed, the loop continues with the others alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ann_dc.backends.recurrent.layers.loop import Loop
from ann_dc.backends.settling import GROWTH, HEADWAY, Settling
from ann_dc.backends.status import OVERFLOW

RUNNING, SETTLED, DIVERGED, LEFT_DOMAIN, STALLED = 0, 1, 2, 3, 4
"""Codes of a sample; `RUNNING` at the end means that the sample did not settle."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Settled:
    """Final values of B samples.

    Attributes
    ----------
    states : (B, n) tensor
        State vectors in network units.
    codes : (B,) tensor
        Outcome code: `SETTLED`, `DIVERGED`, `LEFT_DOMAIN`, `STALLED` or `RUNNING`.
    steps : (B,) tensor
        Number of steps.
    settling_steps : (B,) tensor
        Steps after which the residual stayed below the tolerance, rounded up to the next check; -1
        if the sample did not settle.
    settling_times : (B,) tensor
        Network time at that check; nan if the sample did not settle.
    residuals : (2, B) tensor
        Relative constraint and stationarity residuals at the end.
    stopped : str
        Reason for an interrupt of the run; empty if the run was not interrupted.

    Examples
    --------
    >>> import ann_dc
    >>> layer = ann_dc.RecurrentLayer(ann_dc.design(ann_dc.plants.double_integrator(N=5)).network)
    >>> end = layer.settle(limit=10)  # not nearly enough
    >>> end.settled.item(), end.steps.item(), end.settling_steps.item()
    (False, 10, -1)
    """

    states: torch.Tensor
    codes: torch.Tensor
    steps: torch.Tensor
    settling_steps: torch.Tensor
    settling_times: torch.Tensor
    residuals: torch.Tensor
    stopped: str = ""

    @property
    def settled(self) -> torch.Tensor:
        """Mask (B,) of the samples that settled."""
        return self.codes == SETTLED


class Ledger:
    """Ledger of the samples of a loop.

    Parameters
    ----------
    loop : Loop
        Loop before its first step.
    settling : Settling
        Tolerance and confirmation; ``controls`` is ignored.
    check : int
        Number of steps between two records.
    window : int
        Number of steps in which the best residual must decrease.
    """

    def __init__(self, loop: Loop, settling: Settling, check: int, window: int) -> None:
        self.settling, self.check, self.window = settling, check, window
        count = loop.state.shape[-1]
        like = loop.time
        self.samples = torch.arange(count, device=like.device)
        self.final = loop.state.clone()
        self.codes = torch.full((count,), RUNNING, device=like.device)
        self.steps = torch.zeros_like(self.codes)
        self.last_above = torch.full_like(self.codes, -1)
        self.below_since = torch.full_like(like, torch.nan)
        self.residuals = torch.full((2, count), torch.inf, dtype=like.dtype, device=like.device)
        self.best, self.before = torch.full_like(like, torch.inf), torch.zeros_like(like)
        self.sizes, self.looked = torch.zeros_like(like), 0
        self.largest = OVERFLOW * loop.state.nan_to_num().abs().amax((0, 1)).clamp(min=1.0)

    @property
    def open(self) -> torch.Tensor:
        """Mask (b,) of the running samples in the batch."""
        return self.codes[self.samples] == RUNNING

    def record(self, loop: Loop, residuals: torch.Tensor) -> bool:
        """Enter the relative residuals (2, b) and close the finished samples.

        Once half of its samples are closed, the loop continues with the running samples only.
        Returns True if any sample still runs.
        """
        rejected, worst, open_ = loop.proposal.rejected, residuals.amax(0), self.open
        self._enter_exits(loop, open_, worst >= self.settling.tolerance)
        codes, stalled = self._codes(loop, worst), self._stalled(loop, worst)
        if loop.memory is not None:
            unsound = loop.unsound(open_ & (codes == SETTLED) & ~rejected)
            stalled &= ~unsound
            codes = torch.where(unsound | rejected, RUNNING, codes)
            if unsound.any():
                loop.start_again(unsound)
                self.best[self.samples[unsound]] = torch.inf
                self.before[self.samples[unsound]] = torch.inf
        codes = torch.where((codes == RUNNING) & stalled, STALLED, codes)
        over = open_ & (codes != RUNNING)
        if not over.any():
            return True
        self._enter(loop, residuals, codes, over)
        left = self.open.nonzero()[:, 0]
        if 0 < 2 * len(left) <= len(self.samples):
            loop.keep(left)
            self.samples = self.samples[left]
        return len(left) > 0

    def _enter_exits(self, loop: Loop, open_: torch.Tensor, above: torch.Tensor) -> None:
        """Mark residuals (b,) above the tolerance and store since when the others are not."""
        samples, above, below = self.samples, open_ & above, open_ & ~above
        since = self.below_since[samples]
        since = torch.where(below & since.isnan(), loop.time, since)
        self.below_since[samples] = torch.where(above, torch.nan, since)
        self.last_above[samples] = torch.where(above, loop.done, self.last_above[samples])

    def _codes(self, loop: Loop, worst: torch.Tensor) -> torch.Tensor:
        """Return the codes of the samples in the batch, by their larger residual (b,)."""
        size = loop.state.abs().amax((0, 1))
        settled = worst < self.settling.tolerance * self.settling.confirm
        codes = torch.where(settled, SETTLED, torch.where(worst.isfinite(), RUNNING, DIVERGED))
        codes = torch.where(loop.strayed, LEFT_DOMAIN, codes)
        return torch.where(size < self.largest[self.samples], codes, DIVERGED)

    def _stalled(self, loop: Loop, worst: torch.Tensor) -> torch.Tensor:
        """Return a mask (b,) of samples whose best residual did not decrease in a window.

        A sample that still grows is not stalled, since it is about to diverge.
        """
        best = torch.minimum(self.best[self.samples], worst.nan_to_num(torch.inf))
        self.best[self.samples] = best
        if loop.done // self.window == self.looked:
            return torch.zeros_like(worst, dtype=torch.bool)
        self.looked = loop.done // self.window
        size = loop.state.abs().amax((0, 1))
        stalled = best >= HEADWAY * self.before[self.samples]
        stalled &= size < GROWTH * self.sizes[self.samples]
        self.before[self.samples], self.sizes[self.samples] = best, size
        self.best[self.samples] = torch.inf
        return stalled & (self.looked > 2)

    def _enter(self, loop: Loop, residuals, codes, which: torch.Tensor) -> None:
        samples = self.samples[which]
        self.final[..., samples] = loop.state[..., which]
        self.codes[samples] = codes[which]
        self.steps[samples] = loop.done
        self.residuals[:, samples] = residuals[:, which]

    def close(self, loop: Loop, stopped: str = "") -> Settled:
        """Enter the samples that still run and return the final values.

        ``stopped`` is the reason for an interrupt of the run.
        """
        loop.take_back()
        residuals = loop.residuals()
        self._enter(loop, residuals, self.codes[self.samples], self.open)
        return Settled(
            states=loop.cell.pack(self.final),
            codes=self.codes,
            steps=self.steps,
            settling_steps=self._settling_steps(),
            settling_times=torch.where(self.codes == SETTLED, self.below_since, torch.nan),
            residuals=self.residuals,
            stopped=stopped,
        )

    def _settling_steps(self) -> torch.Tensor:
        from_start = self.last_above < 0
        first_below = torch.where(from_start, 0, self.last_above + self.check)
        first_below = torch.minimum(first_below, self.steps)
        return torch.where(self.codes == SETTLED, first_below, -1)
