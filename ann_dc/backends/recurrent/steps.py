r"""How long a step is: fixed, or as long as progress earns it.

No rule may look at the solution: a circuit does not have it. What a circuit has are the drives, and
with them the energy e = sqrt(sum \|d m\|) over what arrives, d, and what moves, m.

`AdaptiveStep` takes one constant from the network (and an estimate of its fastest rate at the
start, which it does not exceed). A constraint pair of primal and dual obeys
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
from typing import NamedTuple

import torch

from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.errors import require_positive
from ann_dc.evaluation.reference import evaluator
from ann_dc.hints.checked import checked
from ann_dc.hints.words import such_as
from ann_dc.network.network import Network


class StepState(NamedTuple):
    """What a step rule remembers of every sample; each (B,)."""

    step: torch.Tensor
    """h, in units of network time."""
    longest: torch.Tensor
    """Longest h."""
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

    def select(self, samples: torch.Tensor) -> StepState:
        """The state of these samples (b,)."""
        return StepState(*(part[samples] for part in self))

    def where(self, samples: torch.Tensor, other: StepState) -> StepState:
        """This state for ``samples``, (B,) booleans, the other one for the rest."""
        return StepState(*(torch.where(samples, mine, its) for mine, its in zip(self, other)))


@such_as("ann_dc.FixedStep(step=0.1)")
class StepRule(ABC):
    """A rule for h: what is remembered before the first step, and after every other."""

    @abstractmethod
    def begin(self, flow: Flow, like: torch.Tensor) -> StepState:
        """Before the first step.

        Parameters
        ----------
        flow : Flow
        like : (..., B) tensor
            Says how many samples there are, of which type, and on which device.
        """

    @abstractmethod
    def update(self, last: StepState, energy: torch.Tensor) -> tuple[StepState, torch.Tensor]:
        """After a step.

        Parameters
        ----------
        last : StepState
        energy : (B,) tensor
            sqrt(sum |d m|) that the step read; infinite outside a domain.

        Returns
        -------
        state : StepState
        cut : (B,) booleans
            Whose h was cut.
        """


def above_limit(step: float, limit: float, network: Network) -> str:
    """What is said of a step above the stability limit at a network's start."""
    return (
        f"step {step:g} is above the stability limit {limit:.3g} of {network.title} at its start: "
        "fast neurons grow from step to step; take a shorter one"
    )


@checked
@dataclass(frozen=True, kw_only=True)
class FixedStep(StepRule):
    """The same h at every step.

    A warning tells when h is above the stability limit at the network's start (see
    `stability_limit`; at the solution it may be another).

    Attributes
    ----------
    step : float
        h, in units of network time.

    Raises
    ------
    NetworkError
        If it is not a positive number.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.analysis import stability_limit
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> h = 0.5 * stability_limit(network, network.start_state)
    >>> backend = ann_dc.RecurrentBackend(step=ann_dc.FixedStep(step=h), limit=100)
    >>> run = backend.run(network)
    >>> bool(abs(run.status.time - 100 * h) < 1e-9)  # network time is steps times h
    True

    References
    ----------
    Paper equations (16), (17): lambda = h / tau.
    """

    step: float

    def __post_init__(self) -> None:
        require_positive(step=self.step)

    def begin(self, flow: Flow, like: torch.Tensor) -> StepState:
        """At full length; warns (`UserWarning`) above the stability limit."""
        limit = flow.layout.limit_at_start
        if 0 < limit < self.step:
            warnings.warn(above_limit(self.step, limit, flow.layout.network), stacklevel=2)
        return _begun(like, first=self.step, longest=self.step, window=0.0)

    def update(self, last: StepState, energy: torch.Tensor) -> tuple[StepState, torch.Tensor]:
        """Nothing changes."""
        return last, torch.zeros_like(last.limited)


@checked
@dataclass(frozen=True, kw_only=True)
class AdaptiveStep(StepRule):
    """As long as progress earns it; needs no solution.

    Attributes
    ----------
    share : float
        Longest step as a share of `dual_limit`: min rho tau over the duals.
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

    Raises
    ------
    NetworkError
        If one of them is not a positive number.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> wide, narrow = (
    ...     ann_dc.RecurrentBackend(step=ann_dc.AdaptiveStep(share=share), limit=100)
    ...     for share in (0.6, 0.2)
    ... )
    >>> narrow.run(network).status.time < wide.run(network).status.time  # of 100 steps each
    True
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

    def __post_init__(self) -> None:
        require_positive(**vars(self))

    def begin(self, flow: Flow, like: torch.Tensor) -> StepState:
        """With a short step, so that the start may be rough."""
        unit = float(dual_limit(flow))
        return _begun(like, first=self.first * unit, longest=self.share * unit, window=self.window)

    def update(self, last: StepState, energy: torch.Tensor) -> tuple[StepState, torch.Tensor]:
        """Longer after progress, shorter after a rise or an idle window."""
        age = last.age + 1
        over = age >= last.window
        idle = over & (last.best > self.progress * last.mark)
        cut = idle | (energy > self.rise * last.best)
        better = ~cut & (energy < last.best)
        # a power by its logarithm: torch's own differs in the last digit along a vector
        earned = torch.exp(self.earned * torch.log(last.best / energy))
        factor = torch.where(last.limited, earned, self.growth)
        factor = torch.where(cut, self.cut, torch.where(better, factor, 1.0))
        best = torch.where(cut | better, energy, last.best)
        return StepState(
            step=(last.step * factor).clamp(self.least * last.longest, last.longest),
            longest=last.longest,
            best=best,
            limited=last.limited | cut,
            age=torch.where(over | cut, 0.0, age),
            mark=torch.where(over | cut, best, last.mark),
            window=torch.where(idle, 1.5 * last.window, last.window),
        ), cut


def dual_limit(flow: Flow) -> torch.Tensor:
    """min rho tau over the PI duals, and not more than two time constants of the fastest mode.

    Beyond h = rho tau a dual integrates faster in a step than its proportional path damps. The
    fastest mode is estimated once, at the network's start.

    Parameters
    ----------
    flow : Flow

    Returns
    -------
    () tensor
        In units of network time.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> 0 < float(dual_limit(ann_dc.CellLayer(network).flow())) < 10
    True
    """
    cell, network = flow.layout, flow.layout.network
    limits = [flow.constants.rates.new_tensor(2.0 / cell.fastest_rate)]
    for dual in network.cell.duals:
        path, row = evaluator(network).edges.get(dual.path), network.neuron_index[dual.neuron]
        live = network.live[row]
        if path is not None and live.any():
            rho, rate = flow.constants.weights[path][live], flow.constants.rates[row][live]
            limits.append((rho / rate)[rho > 0].amin() if (rho > 0).any() else limits[0])
    return torch.stack(limits).amin().detach()


def _begun(like: torch.Tensor, *, first: float, longest: float, window: float) -> StepState:
    def full(value: float) -> torch.Tensor:
        return torch.full_like(like[(0,) * (like.ndim - 1)], value)

    return StepState(
        step=full(min(first, longest)),
        longest=full(longest),
        best=full(torch.inf),
        limited=full(0.0).bool(),
        age=full(0.0),
        mark=full(torch.inf),
        window=full(window),
    )
