"""Sample outcomes of a loop: settled, failed or running.

A sample is closed when its residual is a small fraction of the tolerance or no longer decreases, or
when it has diverged or left a domain. Once half of a batch is closed, the loop continues with the
others alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ann_dc.backends.batched.group import Ends
from ann_dc.backends.integration.integrator import (
    DIVERGED,
    LEFT_DOMAIN,
    RUNNING,
    SETTLED,
    STALLED,
)
from ann_dc.backends.layers.loop import Loop
from ann_dc.backends.settling import GROWTH


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
    """Ledger of the samples of a loop before its first step, with their end conditions."""

    def __init__(self, loop: Loop, ends: Ends) -> None:
        self.ends, like = ends, loop.time
        count = len(like)
        self.samples = torch.arange(count, device=like.device)
        self.final = loop.state.clone()
        self.codes = torch.full((count,), RUNNING, device=like.device)
        self.steps, self.since = torch.zeros_like(self.codes), torch.full_like(self.codes, -1)
        self.times = torch.full_like(like, torch.nan)
        self.residuals = torch.full((2, count), torch.inf, dtype=like.dtype, device=like.device)
        self.best, self.before = torch.full_like(like, torch.inf), torch.zeros_like(like)
        self.sizes, self.looked = torch.zeros_like(like), 0
        self.largest = ends.overflow * loop.state.nan_to_num().abs().amax((0, 1)).clamp(min=1.0)

    @property
    def open(self) -> torch.Tensor:
        """Mask (b,) of the running samples in the batch."""
        return self.codes[self.samples] == RUNNING

    def record(self, loop: Loop, residuals: torch.Tensor) -> bool:
        """Enter the relative residuals (2, b) and close the finished samples.

        Returns True if any sample still runs.
        """
        rejected, worst, open_ = loop.proposal.rejected, residuals.amax(0), self.open
        self._enter_exits(loop, open_, worst >= self.ends.tolerance)
        size = loop.state.abs().amax((0, 1))
        codes, stalled = self._codes(loop, worst, size), self._stalled(loop.done, worst, size)
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
        """Enter the steps and times since which residuals (b,) are not above the tolerance."""
        since, time, above = self.since[self.samples], self.times[self.samples], open_ & above
        falls = open_ & ~above & (since < 0)
        since, time = torch.where(above, -1, since), torch.where(above, torch.nan, time)
        self.since[self.samples] = torch.where(falls, loop.done, since)
        self.times[self.samples] = torch.where(falls, loop.time, time)

    def _codes(self, loop: Loop, worst: torch.Tensor, size: torch.Tensor) -> torch.Tensor:
        """Return codes (b,) by the larger residual (b,) and the largest state (b,)."""
        settled = worst < self.ends.settled
        codes = torch.where(settled, SETTLED, torch.where(worst.isfinite(), RUNNING, DIVERGED))
        codes = torch.where(loop.strayed, LEFT_DOMAIN, codes)
        return torch.where(size < self.largest[self.samples], codes, DIVERGED)

    def _stalled(self, done: int, worst: torch.Tensor, size: torch.Tensor) -> torch.Tensor:
        """Return a mask (b,) of samples whose best residual did not decrease in a window.

        A sample that still grows is not stalled, since it is about to diverge.
        """
        best = torch.minimum(self.best[self.samples], worst.nan_to_num(torch.inf))
        self.best[self.samples] = best
        window = done // self.ends.window
        if window == self.looked:
            return torch.zeros_like(worst, dtype=torch.bool)
        self.looked = window
        stalled = best >= self.ends.headway * self.before[self.samples]
        stalled &= size < GROWTH * self.sizes[self.samples]
        self.before[self.samples], self.sizes[self.samples] = best, size
        self.best[self.samples] = torch.inf
        return stalled & (window > 2)

    def _enter(self, loop: Loop, residuals, codes, which: torch.Tensor) -> None:
        samples = self.samples[which]
        self.final[..., samples] = loop.state[..., which]
        self.codes[samples] = codes[which]
        self.steps[samples] = loop.done
        self.residuals[:, samples] = residuals[:, which]

    def close(self, loop: Loop, stopped: str = "") -> Settled:
        """Enter the samples that still run; return all, with the reason for an interrupt if any."""
        loop.take_back()
        self._enter(loop, loop.residuals(), self.codes[self.samples], self.open)
        settled = self.codes == SETTLED
        return Settled(
            states=loop.cell.pack(self.final),
            codes=self.codes,
            steps=self.steps,
            settling_steps=torch.where(settled, self.since, -1),
            settling_times=torch.where(settled, self.times, torch.nan),
            residuals=self.residuals,
            stopped=stopped,
        )
