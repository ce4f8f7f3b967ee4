"""Step lengths on tensors, one per sample: initial values and updates.

A step rule is represented by numbers (`StepLengths`); see `rules.steps` for their meaning.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import torch

from ann_dc.backends.lanes.recurrence import StepLengths
from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.backends.recurrent.rules.steps import StepRule, above_limit
from ann_dc.evaluation.reference import evaluator


class StepState(NamedTuple):
    """Step state of every sample; each field has shape (B,)."""

    step: torch.Tensor
    """Step length h in units of network time."""
    longest: torch.Tensor
    """Longest h."""
    best: torch.Tensor
    """Lowest energy since the last cut."""
    limited: torch.Tensor
    """True if the step was ever cut."""
    age: torch.Tensor
    """Number of steps into the window."""
    mark: torch.Tensor
    """Lowest energy at the beginning of the window."""
    window: torch.Tensor
    """Length of the window."""
    turned: torch.Tensor
    """Turn of the moves since the last full turn: the sum of `turn_of`."""
    peak: torch.Tensor
    """Highest energy since the last full turn."""
    floor: torch.Tensor
    """Lowest of these peaks since the last cut."""

    @classmethod
    def of(cls, lengths: StepLengths, like: torch.Tensor) -> StepState:
        """Return the state before the first step.

        ``like`` (..., B) determines the number of samples, the type and the device.
        """

        def full(value: float) -> torch.Tensor:
            return torch.full_like(like[(0,) * (like.ndim - 1)], value)

        return cls(
            step=full(min(lengths.first, lengths.longest)),
            longest=full(lengths.longest),
            best=full(torch.inf),
            limited=full(0.0).bool(),
            age=full(0.0),
            mark=full(torch.inf),
            window=full(lengths.window),
            turned=full(0.0),
            peak=full(0.0),
            floor=full(torch.inf),
        )

    def next(
        self, lengths: StepLengths, energy: torch.Tensor, turn: torch.Tensor
    ) -> tuple[StepState, torch.Tensor]:
        """Return the state after a step and a mask (B,) of samples whose h was cut.

        Steps are longer after progress, and shorter after a rise or an idle window. ``energy`` (B,)
        is sqrt(sum |d m|) read by the step, infinite outside a domain. ``turn`` (B,) is the turn
        since the step before, see `turn_of`.
        """
        age = self.age + 1
        over = age >= self.window
        idle = over & (self.best > lengths.progress * self.mark)
        turned, peak = self.turned + turn, torch.maximum(self.peak, energy)
        full, lowest = turned >= lengths.turn, torch.minimum(self.floor, peak)
        cut = idle | (energy > lengths.rise * self.floor)
        better = ~cut & (energy < self.best)
        # a power by its logarithm: torch's own differs in the last digit along a vector
        earned = torch.exp(lengths.earned * torch.log(self.best / energy))
        factor = torch.where(self.limited, earned, lengths.growth)
        factor = torch.where(cut, lengths.cut, torch.where(better, factor, 1.0))
        best = torch.where(cut | better, energy, self.best)
        return StepState(
            step=(self.step * factor).clamp(lengths.least * self.longest, self.longest),
            longest=self.longest,
            best=best,
            limited=self.limited | cut,
            age=torch.where(over | cut, 0.0, age),
            mark=torch.where(over | cut, best, self.mark),
            window=torch.where(idle, 1.5 * self.window, self.window),
            turned=torch.where(cut | full, 0.0, turned),
            peak=torch.where(cut | full, 0.0, peak),
            floor=torch.where(cut, torch.inf, torch.where(full, lowest, self.floor)),
        ), cut

    def select(self, samples: torch.Tensor) -> StepState:
        """Return the state of these samples (b,)."""
        return StepState(*(part[samples] for part in self))

    def where(self, samples: torch.Tensor, other: StepState) -> StepState:
        """Return this state for ``samples``, a mask (B,), and ``other`` for the rest."""
        return StepState(*(torch.where(samples, mine, its) for mine, its in zip(self, other)))


def turn_of(along: torch.Tensor, energies: torch.Tensor) -> torch.Tensor:
    """Return sin(angle / 2) between two moves: 1 if opposite, 0 if unknown.

    ``along`` (B,) is sum d m, of the drives at a step and the moves of the step before.
    ``energies`` (B,) is the product of the energies at both.

    Examples
    --------
    >>> turn_of(torch.tensor([4.0, 0.0, -4.0]), torch.tensor([4.0, 4.0, 4.0]))
    tensor([0.0000, 0.7071, 1.0000])
    """
    cosine = along / energies
    half = (0.5 * (1.0 - cosine)).clamp(min=0.0)
    return torch.where(cosine.isfinite(), half.sqrt(), 0.0)


def lengths_of(rule: StepRule, flow: Flow) -> StepLengths:
    """Return the numbers of a step rule for a flow.

    Warns (`UserWarning`) if a fixed step exceeds the stability limit at the network's start.
    """
    lengths = rule.lengths(float(dual_limit(flow)))
    if lengths.is_fixed:
        limit = flow.limits.of(flow.constants).stable
        if 0 < limit < lengths.longest:
            warnings.warn(above_limit(lengths.longest, limit, flow.layout.network), stacklevel=2)
    return lengths


def dual_limit(flow: Flow) -> torch.Tensor:
    """Return min rho tau over PI duals, limited to two fastest time constants.

    Above h = rho tau a dual integrates faster in a step than its proportional path damps. The
    fastest mode is estimated at the network's start, once for unchanged gains. The result () is in
    units of network time.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> 0 < float(dual_limit(ann_dc.CellLayer(network).flow())) < 10
    True
    """
    network, fastest = flow.layout.network, flow.limits.of(flow.constants).fastest_rate
    limits = [flow.constants.rates.new_tensor(2.0 / fastest)]
    for dual in network.cell.duals:
        path, row = evaluator(network).edges.get(dual.path), network.neuron_index[dual.neuron]
        live = network.live[row]
        if path is not None and live.any():
            rho, rate = flow.constants.weights[path][live], flow.constants.rates[row][live]
            limits.append((rho / rate)[rho > 0].amin() if (rho > 0).any() else limits[0])
    return torch.stack(limits).amin().detach()
