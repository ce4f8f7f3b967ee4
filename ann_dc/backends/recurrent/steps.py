r"""How long a step is: fixed, or as long as progress earns it.

No rule may look at the solution: a circuit does not have it. What a circuit has are the drives, and
with them the energy e = sqrt(sum \|d m\|) over what arrives, d, and what moves, m.

`AdaptiveStep` takes one constant from the network. A constraint pair of primal and dual obeys
s^2 + kappa s + eta kappa = 0 with eta = 1 / (rho tau) of its dual, whatever its kappa <= 1, and
forward Euler keeps it stable for h < 1 / eta = rho tau: so the longest step is a share of
min rho tau. Strong curvature can ask for less. That is told by the energy: a step that doubles it,
or a window without progress, cuts h; after that h grows only with the progress made,
h ~ e^{-earned}, so that every excursion to the stability limit is paid for beforehand.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import torch

from ann_dc.errors import NetworkError
from ann_dc.network.cell import Connection
from ann_dc.network.kernel import Kernel
from ann_dc.network.network import Network
from ann_dc.network.spectrum import spectrum


class Pace(NamedTuple):
    """What a step rule remembers of every sample; each (B,)."""

    step: torch.Tensor
    longest: torch.Tensor
    best: torch.Tensor
    """Lowest energy since the last cut."""
    limited: torch.Tensor
    """Whether the step was ever cut."""
    age: torch.Tensor
    """Steps into the window."""
    mark: torch.Tensor
    """Lowest energy when the window began."""
    window: torch.Tensor
    """Length of the window."""


class StepRule(ABC):
    """A rule for h."""

    @abstractmethod
    def begin(self, network: Network, like: torch.Tensor) -> Pace:
        """Before the first step; ``like`` is any tensor (..., B)."""

    @abstractmethod
    def update(self, pace: Pace, energy: torch.Tensor) -> tuple[Pace, torch.Tensor]:
        """After a step that read the energy (B,): the new pace, and which samples were cut (B,)."""


@dataclass(frozen=True, kw_only=True)
class FixedStep(StepRule):
    """The same h at every step.

    A warning tells when h is above the stability limit at the network's start (see
    `stability_limit`; at the solution it may be another).

    Attributes
    ----------
    step : float
        h, in units of network time.
    """

    step: float

    def __post_init__(self) -> None:
        if not 0 < self.step < float("inf"):
            raise NetworkError(f"step: expected a positive number, got {self.step!r}")

    def begin(self, network: Network, like: torch.Tensor) -> Pace:
        """At full length; warns above the stability limit."""
        limit = _limit_at_start(network)
        if 0 < limit < self.step:
            warnings.warn(
                f"step {self.step:g} is above the stability limit {limit:.3g} of {network.title} "
                "at its start: fast neurons grow from step to step; take a shorter one",
                stacklevel=2,
            )
        return _pace(like, first=self.step, longest=self.step, window=0.0)

    def update(self, pace: Pace, energy: torch.Tensor) -> tuple[Pace, torch.Tensor]:
        """Nothing changes."""
        return pace, torch.zeros_like(pace.limited)


@dataclass(frozen=True, kw_only=True)
class AdaptiveStep(StepRule):
    """As long as progress earns it; needs neither the solution nor eigenvalues.

    Attributes
    ----------
    share : float
        Longest step as a share of min rho tau over the duals.
    first : float
        First step, likewise.
    growth : float
        Factor a step until the first cut.
    cut : float
        Factor when the energy rises or a window brings nothing.
    rise : float
        Rise of the energy over its best that causes a cut.
    earned : float
        After the first cut, h grows by this power of the progress made.
    window : int
        Steps after which progress is looked for; an idle window makes the next ones longer.
    progress : float
        A window is idle when its lowest energy is above this share of the one before.
    least : float
        Shortest step as a share of the longest: a flow that grows at this step diverges.
    """

    share: float = 0.6
    first: float = 0.15
    growth: float = 1.03
    cut: float = 0.6
    rise: float = 2.0
    earned: float = 0.05
    window: int = 200
    progress: float = 0.9
    least: float = 1e-3

    def begin(self, network: Network, like: torch.Tensor) -> Pace:
        """With a short step, so that the start may be rough."""
        unit = dual_limit(network)
        return _pace(like, first=self.first * unit, longest=self.share * unit, window=self.window)

    def update(self, pace: Pace, energy: torch.Tensor) -> tuple[Pace, torch.Tensor]:
        """Longer after progress, shorter after a rise or an idle window."""
        age = pace.age + 1
        over = age >= pace.window
        idle = over & (pace.best > self.progress * pace.mark)
        cut = idle | (energy > self.rise * pace.best)
        better = ~cut & (energy < pace.best)
        factor = torch.where(pace.limited, (pace.best / energy) ** self.earned, self.growth)
        factor = torch.where(cut, self.cut, torch.where(better, factor, 1.0))
        best = torch.where(cut | better, energy, pace.best)
        return Pace(
            step=(pace.step * factor).clamp(self.least * pace.longest, pace.longest),
            longest=pace.longest,
            best=best,
            limited=pace.limited | cut,
            age=torch.where(over | cut, 0.0, age),
            mark=torch.where(over | cut, best, pace.mark),
            window=torch.where(idle, 1.5 * pace.window, pace.window),
        ), cut


def stability_limit(network: Network, x: np.ndarray) -> float:
    """Largest stable step of the simultaneous order at a state (n,).

    min 2a / (a^2 + b^2) over the eigenvalues -a +- ib of the flow; zero at a point that repels.
    """
    return spectrum(network, x).largest_step


@lru_cache(maxsize=32)  # a training loop asks at every pass
def _limit_at_start(network: Network) -> float:
    return stability_limit(network, network.start_state)


def dual_limit(network: Network) -> float:
    """min rho tau over the PI duals, and not more than two time constants of the fastest mode.

    Beyond h = rho tau a dual integrates faster in a step than its proportional path damps. A
    network without PI duals has the fastest mode alone (at its start).
    """
    fastest = 2.0 / Kernel(network).fastest_rate(network.start_state)
    tape, edges = network.program.tape, network.program.edges
    limits = [fastest]
    for dual in network.cell.duals:
        path = edges.get(Connection(source=dual.residual, target=dual.multiplier).name)
        row = network.neuron_index[dual.neuron]
        live = network.live[row]
        if path is not None and tape.weights[path].max() > 0 and live.any():
            limits.append(float((tape.weights[path][live] / tape.rates[row][live]).min()))
    return min(limits)


def _pace(like: torch.Tensor, *, first: float, longest: float, window: float) -> Pace:
    def full(value: float) -> torch.Tensor:
        return torch.full_like(like[(0,) * (like.ndim - 1)], value)

    return Pace(
        step=full(min(first, longest)),
        longest=full(longest),
        best=full(torch.inf),
        limited=full(0.0).bool(),
        age=full(0.0),
        mark=full(torch.inf),
        window=full(window),
    )
