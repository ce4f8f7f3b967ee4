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

    @abstractmethod
    def suited(self) -> LowerLevel:
        """Return the lower level that suits the coordinator."""

    @abstractmethod
    def move(
        self, sample: Sample, x: np.ndarray, drives: np.ndarray
    ) -> tuple[np.ndarray, tuple[float, float]]:
        """Move the coordination variables once.

        The state x (n,) is the state after the lower level, and the net inputs (n,) are taken at
        this state, both in network units. Returns the new state and the gains of t and beta (nan if
        the coordinator has no gains).
        """


@checked
@dataclass(frozen=True, kw_only=True)
class Gradient(UpperLevel):
    """Gradient coordinator (17), corrected: t and beta with separate gains.

    t and beta move along their net inputs. `UpperMap.best` finds good gains. A common gain is
    slower, and unusable in units that give t and beta reciprocal scales.

    Attributes
    ----------
    name : str
        Name on the command line.
    lambda_t, lambda_beta : float
        Gains in network units.

    Raises
    ------
    NetworkError
        If a gain is not a positive number.

    References
    ----------
    Paper equation (17), corrected.
    """

    name: ClassVar[str] = "gradient"
    lambda_t: float
    lambda_beta: float

    def __post_init__(self) -> None:
        require_positive(lambda_t=self.lambda_t, lambda_beta=self.lambda_beta)

    def suited(self) -> LowerLevel:
        """Return the `Closed` lower level, which solves the stage equations."""
        return Closed()

    def move(self, sample, x, drives):
        """Move t and beta along their net inputs."""
        return _along(sample.rows, x, drives, (self.lambda_t, self.lambda_beta))


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleCoordinator(UpperLevel):
    """Coordinator (33) with one gain from the solution; for studies only.

    t and beta move along their net inputs.

    Attributes
    ----------
    name : str
        Name on the command line.
    gain : OracleGain
        Gain rule with the solution.

    References
    ----------
    Paper equation (33), corrected.
    """

    name: ClassVar[str] = "oracle"
    gain: OracleGain

    def suited(self) -> LowerLevel:
        """Return the `Closed` lower level, which solves the stage equations."""
        return Closed()

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

    Raises
    ------
    NetworkError
        If ``slew`` is not a positive number.

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
    slew: float = 0.1

    def __post_init__(self) -> None:
        require_positive(slew=self.slew)

    def suited(self) -> LowerLevel:
        """Return the `Linearised` lower level, which follows the coordinator."""
        return Linearised()

    def move(self, sample, x, drives):
        """Take a Newton step of the whole network, shortened to the slew."""
        step = sample.newton_step(x, drives)
        longest = np.abs(step[sample.rows.chain]).max()
        return x + self.slew / max(longest, self.slew) * step, (np.nan, np.nan)


def distances_of(rows: Rows, error: np.ndarray, drives: np.ndarray) -> Distances:
    """Return the errors of a state relative to the solution.

    ``error`` (n,) is state minus solution and ``drives`` (n,) are the net inputs at the state, both
    in network units.

    References
    ----------
    Paper equations (18), (19), (21).
    """
    t, beta = (lyapunov_of(error[of], drives[of]) for of in (rows.t, rows.beta))
    norm = np.linalg.norm
    return Distances(v=norm(error[rows.v]), mu=norm(error[rows.mu]), t=t, beta=beta)


def _along(rows: Rows, x: np.ndarray, drives: np.ndarray, gains: tuple[float, float]):
    moved = x.copy()
    for of, gain in zip((rows.t, rows.beta), gains):
        moved[of] += gain * drives[of]
    return moved, gains
