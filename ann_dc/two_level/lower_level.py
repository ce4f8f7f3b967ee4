"""Lower level: stage solvers between two updates of the coordinator, (16), (30)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ann_dc.errors import NetworkError, require_positive, such_as
from ann_dc.network.network import Network
from ann_dc.two_level.sample import Sample
from ann_dc.validation import checked

SMALLEST = 100 * float(np.finfo(float).eps)
"""Net inputs below which rounding dominates."""


@such_as("ann_dc.two_level.Closed()")
class LowerLevel(ABC):
    """Base class of the stage solvers between two coordinator updates."""

    name: ClassVar[str]

    @abstractmethod
    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Solve the lower level with fixed t and beta.

        The state x (n,) is in network units. Returns the state and the number of inner steps.
        """

    @abstractmethod
    def check(self, network: Network) -> None:
        """Raise `NetworkError` if a stage has more equations than unknowns.

        The lower level of such a network has no solution.
        """


@checked
@dataclass(frozen=True, kw_only=True)
class Iterated(LowerLevel):
    """Forward Euler steps (16) on q, u and mu until their net inputs vanish.

    Attributes
    ----------
    name : str
        Name on the command line.
    share : float
        Step length as a fraction of min rho tau over the duals.
    tolerance : float
        Tolerance on the net inputs, in network units.
    limit : int
        Largest number of inner steps.

    Raises
    ------
    NetworkError
        If ``share``, ``tolerance`` or ``limit`` is not a positive number.

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
        """Raise `NetworkError` if a stage has more equations than unknowns."""
        _require_free_start(network)

    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Step until the net inputs have vanished."""
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
    """Stage-wise solution: (30) for linear equations, Newton otherwise.

    Attributes
    ----------
    name : str
        Name on the command line.
    tolerance : float
        Tolerance on the net inputs, in network units.
    limit : int
        Largest number of Newton steps.
    slew : float
        Largest change of a lower neuron in a Newton step, in network units, during the first half
        of the steps.

    Raises
    ------
    NetworkError
        If ``tolerance``, ``limit`` or ``slew`` is not a positive number.

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
        """Raise `NetworkError` if a stage has more equations than unknowns."""
        _require_free_start(network)

    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Take Newton steps of all stages, each with a separate small linear system."""
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
    """Lower level that reports its linearisation and follows the coordinator's solve."""

    name: ClassVar[str] = "linearised"

    def check(self, network: Network) -> None:
        """Accept any network."""

    def solve(self, sample: Sample, x: np.ndarray) -> tuple[np.ndarray, int]:
        """Return the state unchanged; the coordinator solves first."""
        return x, 0


def _require_free_start(network: Network) -> None:
    """Raise `NetworkError` if q of cell 0 is pinned: n equations for its m controls."""
    pinned = [pin.neuron for pin in network.fixed if pin.neuron.startswith("q.")]
    controls = [n for n in network.cell.neurons if n.population == "u"]
    if len(pinned) > len(controls):
        raise NetworkError(
            f"lower level: {', '.join(pinned)} of cell 0 is pinned, so that its stage has more "
            "equations than unknowns; close the chain with Form(start_is_neuron=True)"
        )


def _at_rest(drives: np.ndarray, tolerance: float) -> bool:
    """Return True if the net inputs (L,) have vanished or are not finite."""
    worst = np.abs(drives).max(initial=0.0)
    return bool(not np.isfinite(worst) or worst < max(tolerance, SMALLEST))
