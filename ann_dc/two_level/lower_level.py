"""The lower level: what the stages do between two words of their coordinator. Paper (16), (30)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ann_dc.errors import NetworkError, require_positive
from ann_dc.network.network import Network
from ann_dc.two_level.sample import Sample
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as

SMALLEST = 100 * float(np.finfo(float).eps)
"""Drives below which rounding decides."""


@such_as("ann_dc.two_level.Closed()")
class LowerLevel(ABC):
    """What the stages do between two words of the coordinator.

    Attributes
    ----------
    name : str
        As the command line has it.
    """

    name: ClassVar[str]

    @abstractmethod
    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Solve the lower level, with t and beta held.

        Parameters
        ----------
        sample : Sample
        x : (n,) array
            State vector, in network units.

        Returns
        -------
        x : (n,) array
        steps : int
            Inner steps that it took.
        """

    @abstractmethod
    def check(self, network: Network) -> None:
        """Refuse a network whose lower level has no solution.

        Raises
        ------
        NetworkError
            If a stage has more equations than unknowns.
        """


@checked
@dataclass(frozen=True, kw_only=True)
class Iterated(LowerLevel):
    """Forward Euler (16) on q, u and mu until their drives vanish.

    Attributes
    ----------
    name : str
        As the command line has it.
    share : float
        Step as a share of min rho tau over the duals.
    tolerance : float
        On the drives, in network units.
    limit : int
        Largest number of inner steps.

    Raises
    ------
    NetworkError
        If one of them is not a positive number.

    References
    ----------
    Paper equation (16), corrected.
    """

    name: ClassVar[str] = "iterated"
    share: float = 0.6
    tolerance: float = 1e-9
    limit: int = 5_000

    def __post_init__(self) -> None:
        require_positive(share=self.share, tolerance=self.tolerance, limit=self.limit)

    @checked
    def check(self, network: Network) -> None:
        """Every stage needs as many equations as unknowns."""
        _require_free_start(network)

    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Step until the drives have vanished."""
        x, lower = x.copy(), sample.lower
        step = self.share * sample.step_limit * sample.rates[lower]
        for done in range(self.limit):
            drives = sample.drives(x)[lower]
            if _at_rest(drives, self.tolerance):
                return x, done
            x[lower] += step * drives
        return x, self.limit


@checked
@dataclass(frozen=True, kw_only=True)
class Closed(LowerLevel):
    """The stage equations solved stage by stage: (30) where they are linear, Newton where not.

    Attributes
    ----------
    name : str
        As the command line has it.
    tolerance : float
        On the drives, in network units.
    limit : int
        Largest number of Newton steps.
    slew : float
        Largest move of a lower neuron in a Newton step, in network units, during the first half of
        the steps.

    Raises
    ------
    NetworkError
        If one of them is not a positive number.

    Examples
    --------
    A linear plant takes one step:

    >>> import ann_dc
    >>> from ann_dc.two_level import Closed, Gradient
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.synthesize(ann_dc.decompose(problem, ann_dc.Form(start_is_neuron=True)))
    >>> upper = Gradient(lambda_t=0.1, lambda_beta=0.1)
    >>> levels = ann_dc.TwoLevels(network, upper=upper, lower=Closed(slew=100.0))
    >>> levels.run(limit=1).inner.tolist()
    [1, 1]

    References
    ----------
    Paper equation (30), corrected.
    """

    name: ClassVar[str] = "closed"
    tolerance: float = 1e-11
    limit: int = 20
    slew: float = 0.5

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, limit=self.limit, slew=self.slew)

    @checked
    def check(self, network: Network) -> None:
        """Every stage needs as many equations as unknowns."""
        _require_free_start(network)

    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Newton steps of all stages, each a small linear system of its own."""
        x, lower = x.copy(), sample.lower
        for done in range(self.limit):
            drives = sample.drives(x)[lower]
            if _at_rest(drives, self.tolerance):
                return x, done
            move = sample.stage_steps(x, drives)
            if done < self.limit // 2:
                largest = np.full(sample.network.stages, self.slew)
                np.maximum.at(largest, sample.stage, np.abs(move))
                move *= (self.slew / largest)[sample.stage]
            x[lower] += move
        return x, self.limit


@dataclass(frozen=True, kw_only=True)
class Linearised(LowerLevel):
    """The stages report their linearisation and move when the coordinator has solved for them.

    Attributes
    ----------
    name : str
        As the command line has it.
    """

    name: ClassVar[str] = "linearised"

    def check(self, network: Network) -> None:
        """Any network will do."""

    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the state: there is nothing to do before the coordinator."""
        return x, 0


def _require_free_start(network: Network) -> None:
    """Cell 0 with a pinned q has n equations for its m controls."""
    pinned = [pin.neuron for pin in network.pins if pin.neuron.startswith("q.")]
    controls = [n for n in network.cell.neurons if n.population == "u"]
    if len(pinned) > len(controls):
        raise NetworkError(
            f"lower level: {', '.join(pinned)} of cell 0 is pinned, so that its stage has more "
            "equations than unknowns; close the chain with Form(start_is_neuron=True)"
        )


def _at_rest(drives: np.ndarray, tolerance: float) -> bool:
    """Return True if the drives (L,) have vanished, or are lost."""
    worst = np.abs(drives).max(initial=0.0)
    return bool(not np.isfinite(worst) or worst < max(tolerance, SMALLEST))
