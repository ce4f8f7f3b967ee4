"""Who has settled, who is lost, and with what: the book that is kept on a loop.

A sample is closed when its residual has fallen to a small share of the tolerance, when it has
diverged, when it has left the domain of a function block, or when its residual gets no smaller;
what is entered then is what it ends with. Once half of a batch is closed, the loop goes on with the
others alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ann_dc.backends.recurrent.layers.loop import Loop
from ann_dc.backends.settling import GROWTH, HEADWAY, Settling
from ann_dc.backends.status import OVERFLOW

RUNNING, SETTLED, DIVERGED, LEFT_DOMAIN, STALLED = 0, 1, 2, 3, 4
"""How a sample stands; `RUNNING` at the end means: not settled."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Settled:
    """How B samples ended.

    Attributes
    ----------
    states : (B, n) tensor
        State vectors, in network units.
    codes : (B,) tensor
        `SETTLED`, `DIVERGED`, `LEFT_DOMAIN`, `STALLED` or `RUNNING`.
    steps : (B,) tensor
        Steps done.
    settling_steps : (B,) tensor
        Steps after which the residual stayed below the tolerance, rounded up to the next look;
        -1 where it did not settle.
    settling_times : (B,) tensor
        Network time at that look; nan where it did not settle.
    residuals : (2, B) tensor
        Relative constraint and stationarity residuals at the end.
    stopped : str
        Why somebody ended the run before its end; empty where nobody did.

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
        """(B,) booleans: which samples settled."""
        return self.codes == SETTLED


class Ledger:
    """How every sample of a loop stands.

    Parameters
    ----------
    loop : Loop
        Before its first step.
    settling : Settling
        Tolerance and confirmation; its ``controls`` are not looked at.
    check : int
        Steps between two records.
    window : int
        Steps in which the best residual has to become smaller.
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
        """(b,) booleans: which of the samples in the batch still run."""
        return self.codes[self.samples] == RUNNING

    def record(self, loop: Loop, residuals: torch.Tensor) -> bool:
        """Enter the residuals, close the samples that are done.

        Parameters
        ----------
        loop : Loop
            Which goes on with those that run once half of its samples are closed.
        residuals : (2, b) tensor
            Relative constraint and stationarity residuals.

        Returns
        -------
        bool
            Whether any still run.
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
        """Which residuals (b,) are above the tolerance, and since when the others are not."""
        samples, above, below = self.samples, open_ & above, open_ & ~above
        since = self.below_since[samples]
        since = torch.where(below & since.isnan(), loop.time, since)
        self.below_since[samples] = torch.where(above, torch.nan, since)
        self.last_above[samples] = torch.where(above, loop.done, self.last_above[samples])

    def _codes(self, loop: Loop, worst: torch.Tensor) -> torch.Tensor:
        """How the samples in the batch stand, by their larger residual (b,)."""
        size = loop.state.abs().amax((0, 1))
        settled = worst < self.settling.tolerance * self.settling.confirm
        codes = torch.where(settled, SETTLED, torch.where(worst.isfinite(), RUNNING, DIVERGED))
        codes = torch.where(loop.strayed, LEFT_DOMAIN, codes)
        return torch.where(size < self.largest[self.samples], codes, DIVERGED)

    def _stalled(self, loop: Loop, worst: torch.Tensor) -> torch.Tensor:
        """(b,) booleans: whose best residual is no smaller than that of the window before.

        Whoever still grows is not stalled: it is on its way to divergence.
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
        """Enter those that still run, and hand the ledger over.

        Parameters
        ----------
        loop : Loop
        stopped : str
            Why somebody ended the run before its end.
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
