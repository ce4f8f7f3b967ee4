"""Step lengths of recurrent steps: one definition for generated code and for tensors.

See `AdaptiveStep` for the meaning of the numbers. The functions take their array library as an
argument: that of generated code, or torch.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np


class StepLengths(NamedTuple):
    """Numbers of a step rule; lengths are in units of network time."""

    first: float  # first step
    longest: float  # longest step
    window: float  # number of steps after which progress is checked
    growth: float  # factor per step until the first cut
    cut: float  # factor of a cut
    rise: float  # rise of the energy that causes a cut
    earned: float  # power of the progress by which a step grows after the first cut
    progress: float  # fraction of the lowest energy below which a window must get
    least: float  # shortest step relative to the longest
    turn: float
    """Sum of sin(angle / 2) between successive derivatives in which an oscillation has its peak."""

    @classmethod
    def always(cls, step: float) -> StepLengths:
        """Return the numbers of a constant step: nothing causes a cut, and all factors are one."""
        return cls(step, step, np.inf, 1.0, 1.0, np.inf, 1.0, 1.0, 1.0, 0.0)

    @property
    def is_fixed(self) -> bool:
        """True if the shortest step equals the longest."""
        return self.least >= 1.0 and self.first >= self.longest

    @property
    def start(self) -> StepState:
        """State before the first step."""
        return StepState(
            step=min(self.first, self.longest),
            longest=self.longest,
            best=np.inf,
            limited=0.0,
            age=0.0,
            mark=np.inf,
            window=self.window,
            turned=0.0,
            peak=0.0,
            floor=np.inf,
        )


class StepState(NamedTuple):
    """Step state of every sample; each field is a number, a vector or a tensor (B,)."""

    step: Any  # step length h in units of network time
    longest: Any  # longest h
    best: Any  # lowest energy since the last cut
    limited: Any  # one if the step was ever cut, else zero
    age: Any  # number of steps into the window
    mark: Any  # lowest energy at the beginning of the window
    window: Any  # length of the window
    turned: Any  # turn of the derivatives since the last full turn: the sum of `turn_of`
    peak: Any  # highest energy since the last full turn
    floor: Any  # lowest of these peaks since the last cut


def turn_of(library: Any, along: Any, energies: Any) -> Any:
    """Return sin(angle / 2) between two derivatives: 1 if opposite, 0 if unknown.

    ``along`` is sum d m, of the drives at a step and the derivatives of the step before.
    ``energies`` is the product of the energies at both.

    Examples
    --------
    >>> turn_of(np, np.array([4.0, 0.0, -4.0]), np.array([4.0, 4.0, 4.0])).round(4).tolist()
    [0.0, 0.7071, 1.0]
    """
    cosine = along / energies
    half = 0.5 * (1.0 - cosine)
    half = library.where(half > 0.0, half, 0.0)
    return library.where(library.isfinite(cosine), library.sqrt(half), 0.0)


def next_step(
    library: Any, lengths: StepLengths, state: StepState, energy: Any, turn: Any
) -> tuple[StepState, Any]:
    r"""Return the state after a step and a mask of the samples whose h was cut.

    Steps are longer after progress, and shorter after a rise or an idle window. ``energy`` is
    sqrt(sum \|d m\|) read by the step, infinite outside a domain. ``turn`` is the turn since the
    step before, see `turn_of`.
    """
    where = library.where
    age, turned = state.age + 1.0, state.turned + turn
    over, full = age >= state.window, turned >= lengths.turn
    idle = over & (state.best > lengths.progress * state.mark)
    cut = idle | (energy > lengths.rise * state.floor)
    better = (energy < state.best) & ~cut
    best, starts = where(cut | better, energy, state.best), over | cut
    peak, ends = library.maximum(energy, state.peak), cut | full
    floor = where(full, library.minimum(peak, state.floor), state.floor)
    step = state.step * _factor(library, lengths, state, energy, (cut, better))
    step = library.maximum(step, lengths.least * state.longest)
    return StepState(
        step=library.minimum(step, state.longest),
        longest=state.longest,
        best=best,
        limited=where(cut, 1.0, state.limited),
        age=where(starts, 0.0, age),
        mark=where(starts, best, state.mark),
        window=where(idle, 1.5 * state.window, state.window),
        turned=where(ends, 0.0, turned),
        peak=where(ends, 0.0, peak),
        floor=where(cut, np.inf, floor),
    ), cut


def _factor(
    library: Any, lengths: StepLengths, state: StepState, energy: Any, how: tuple[Any, Any]
) -> Any:
    """Return the factor of the next step for masks of those cut and those with less energy."""
    cut, better = how

    def earned() -> Any:
        # a power by its logarithm: torch's own differs in the last digit along a vector
        return library.exp(lengths.earned * library.log(state.best / energy))

    growth = library.rarely(better & (state.limited > 0.0), earned, lengths.growth)
    return library.where(cut, lengths.cut, library.where(better, growth, 1.0))
