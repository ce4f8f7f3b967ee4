"""Upper level: coordinators that move t and beta, paper (17), (33), and Newton."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ann_dc.errors import require_positive, such_as
from ann_dc.two_level.lower_level import Closed, Linearised, LowerLevel
from ann_dc.two_level.lyapunov import Distances, Lyapunov, lyapunov_of
from ann_dc.two_level.oracle_gain import OracleGain
from ann_dc.two_level.sample import Rows, Sample
from ann_dc.validation import checked


@such_as("ann_dc.two_level.NewtonCoordinator()")
class UpperLevel(ABC):
    """Base class of the coordinators; ``name`` is the name on the command line."""

    name: ClassVar[str]
    suited: ClassVar[type[LowerLevel]]
    """Lower level that suits the coordinator."""

    @abstractmethod
    def move(
        self, sample: Sample, x: np.ndarray, drives: np.ndarray
    ) -> tuple[np.ndarray, tuple[float, float]]:
        """Move the coordination variables once, in network units.

        The net inputs (n,) are taken at the state x (n,) after the lower level. Returns the new
        state and the gains of t and beta (nan if the coordinator has no gains).
        """


@checked
@dataclass(frozen=True, kw_only=True)
class Gradient(UpperLevel):
    """Gradient coordinator (17), corrected: t and beta with separate gains.

    t and beta move along their net inputs by ``lambda_t`` and ``lambda_beta``, in network units.
    `UpperMap.best` finds good gains. A common gain is slower, and unusable in units that give t and
    beta reciprocal scales. ``name`` is the name on the command line. Raises `NetworkError` if a
    gain is not positive.
    """

    name: ClassVar[str] = "gradient"
    suited = Closed
    lambda_t: float
    lambda_beta: float

    def __post_init__(self) -> None:
        require_positive(lambda_t=self.lambda_t, lambda_beta=self.lambda_beta)

    def move(self, sample, x, drives):
        """Move t and beta along their net inputs."""
        return _along(sample.rows, x, drives, (self.lambda_t, self.lambda_beta))


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleCoordinator(UpperLevel):
    """Coordinator (33), corrected, with one gain from the solution; for studies only.

    t and beta move along their net inputs by the ``gain`` rule. ``name`` is the name on the command
    line.
    """

    name: ClassVar[str] = "oracle"
    suited = Closed
    gain: OracleGain

    def move(self, sample, x, drives):
        """Move t and beta along their net inputs by the oracle gain."""
        known = np.atleast_2d(self.gain.settled)
        settled = known[sample.number if len(known) > 1 else 0]
        found = distances_of(sample.rows, x - settled, drives).lyapunov
        gain = float(self.gain.of(Lyapunov(*map(np.atleast_1d, found)))[0])
        return _along(sample.rows, x, drives, (gain, gain))


@checked
@dataclass(frozen=True, kw_only=True)
class NewtonCoordinator(UpperLevel):
    """Coordinator that solves the banded KKT system of the linearised stages.

    The stages follow the coordinator. In hardware, this is one linear network that settles once per
    outer iteration, with the Jacobians of the stages as weights. In software, it is one banded
    factorisation.

    Attributes
    ----------
    name : str
        Name on the command line.
    slew : float
        Largest change of a q or t in an outer iteration, in network units; a longer step is
        shortened as a whole.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.two_level import NewtonCoordinator
    >>> network = ann_dc.synthesize(ann_dc.plants.double_integrator(N=5))
    >>> run = ann_dc.TwoLevels(network, upper=NewtonCoordinator(slew=1e6)).run()
    >>> run.rounds  # a linear-quadratic problem takes one full step
    1
    """

    name: ClassVar[str] = "newton"
    suited = Linearised
    slew: float = 0.1

    def __post_init__(self) -> None:
        require_positive(slew=self.slew)

    def move(self, sample, x, drives):
        """Take a Newton step of the whole network, shortened to the slew."""
        step = sample.newton_step(x, drives)
        longest = np.abs(step[sample.rows.chain]).max()
        return x + self.slew / max(longest, self.slew) * step, (np.nan, np.nan)


def distances_of(rows: Rows, error: np.ndarray, drives: np.ndarray) -> Distances:
    """Return the errors (18), (19), (21) of a state minus the solution (n,)."""
    t, beta = (lyapunov_of(error[of], drives[of]) for of in (rows.t, rows.beta))
    norm = np.linalg.norm
    return Distances(v=norm(error[rows.v]), mu=norm(error[rows.mu]), t=t, beta=beta)


def _along(rows: Rows, x: np.ndarray, drives: np.ndarray, gains: tuple[float, float]):
    moved = x.copy()
    for of, gain in zip((rows.t, rows.beta), gains):
        moved[of] += gain * drives[of]
    return moved, gains
