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
        """Solve the lower level with fixed t and beta from a state x (n,) in network units.

        Returns the state and the number of inner steps.
        """

    @checked
    def check(self, network: Network) -> None:
        """Raise `NetworkError` if q of cell 0 is pinned: n equations for its m controls."""
        pinned = [pin.neuron for pin in network.fixed if pin.neuron.startswith("q.")]
        controls = [n for n in network.cell.neurons if n.population == "u"]
        if len(pinned) > len(controls):
            raise NetworkError(
                f"lower level: {', '.join(pinned)} of cell 0 is fixed, so that its stage has "
                "more equations than unknowns; close the chain with Form(start_is_neuron=True)"
            )


@checked
@dataclass(frozen=True, kw_only=True)
class Iterated(LowerLevel):
    """Forward Euler steps (16), corrected, on q, u and mu until their net inputs vanish.

    The step length is the fraction ``share`` of min rho tau over the duals. ``tolerance`` applies
    to the net inputs, in network units.
    """

    name: ClassVar[str] = "iterated"
    share: float = 0.6
    tolerance: float = 1e-9
    limit: int = 5_000

    def __post_init__(self) -> None:
        require_positive(share=self.share, tolerance=self.tolerance, limit=self.limit)

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
    """Stage-wise solution: (30), corrected, for linear equations, Newton otherwise.

    ``tolerance`` applies to the net inputs, in network units. In the first half of at most
    ``limit`` Newton steps no lower neuron changes by more than ``slew`` network units.

    >>> import ann_dc
    >>> from ann_dc.two_level import Closed, Gradient
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.synthesize(ann_dc.decompose(problem, ann_dc.Form(start_is_neuron=True)))
    >>> upper = Gradient(lambda_t=0.1, lambda_beta=0.1)
    >>> levels = ann_dc.TwoLevels(network, upper=upper, lower=Closed(slew=100.0))
    >>> levels.run(limit=1).inner.tolist()  # one step for a linear plant
    [1, 1]
    """

    name: ClassVar[str] = "closed"
    tolerance: float = 1e-11
    limit: int = 20
    slew: float = 0.5

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, limit=self.limit, slew=self.slew)

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


def _at_rest(drives: np.ndarray, tolerance: float) -> bool:
    """Return True if the net inputs (L,) have vanished or are not finite."""
    worst = np.abs(drives).max(initial=0.0)
    return bool(not np.isfinite(worst) or worst < max(tolerance, SMALLEST))
