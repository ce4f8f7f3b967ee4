"""The upper level: how the coordinator moves t and beta. Paper (17), (33), and a Newton step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ann_dc.errors import require_positive
from ann_dc.two_level.lower_level import Closed, Linearised, LowerLevel
from ann_dc.two_level.lyapunov import Distances, Lyapunov, lyapunov_of
from ann_dc.two_level.oracle_gain import OracleGain
from ann_dc.two_level.sample import Rows, Sample
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as


@such_as("ann_dc.two_level.NewtonCoordinator()")
class UpperLevel(ABC):
    """How the coordinator moves.

    Attributes
    ----------
    name : str
        As the command line has it.
    """

    name: ClassVar[str]

    @abstractmethod
    def suited(self) -> LowerLevel:
        """The lower level that suits this coordinator."""

    @abstractmethod
    def move(
        self, sample: Sample, x: np.ndarray, drives: np.ndarray
    ) -> tuple[np.ndarray, tuple[float, float]]:
        """One move of the coordinator.

        Parameters
        ----------
        sample : Sample
        x, drives : (n,) array
            The state after the lower level, and what arrives there; in network units.

        Returns
        -------
        x : (n,) array
        gains : tuple of two float
            Of t and beta; nan where the coordinator has none.
        """


@checked
@dataclass(frozen=True, kw_only=True)
class Gradient(UpperLevel):
    """Paper (17), corrected: t and beta along their drives, each with its own gain.

    `UpperMap.best` finds good ones. One common gain is slower, and hopeless in units that give t
    and beta reciprocal scales.

    Attributes
    ----------
    name : str
        As the command line has it.
    lambda_t, lambda_beta : float
        In network units.

    Raises
    ------
    NetworkError
        If one of them is not a positive number.

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
        """The stage equations, solved."""
        return Closed()

    def move(self, sample, x, drives):
        """Move t and beta along their drives."""
        return _along(sample.rows, x, drives, (self.lambda_t, self.lambda_beta))


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class OracleCoordinator(UpperLevel):
    """Paper (33): t and beta along their drives with one gain, from the solution; for studies only.

    Attributes
    ----------
    name : str
        As the command line has it.
    gain : OracleGain
        Says how far, and knows the solution.

    References
    ----------
    Paper equation (33), corrected.
    """

    name: ClassVar[str] = "oracle"
    gain: OracleGain

    def suited(self) -> LowerLevel:
        """The stage equations, solved."""
        return Closed()

    def move(self, sample, x, drives):
        """Move t and beta along their drives, as far as the oracle says."""
        known = np.atleast_2d(self.gain.settled)
        settled = known[sample.number if len(known) > 1 else 0]
        found = distances_of(sample.rows, x - settled, drives).lyapunov
        gain = float(self.gain.of(Lyapunov(*map(np.atleast_1d, found)))[0])
        return _along(sample.rows, x, drives, (gain, gain))


@checked
@dataclass(frozen=True, kw_only=True)
class NewtonCoordinator(UpperLevel):
    """Solves the banded KKT system that the linearised stages report; the stages follow.

    In hardware: one linear network that settles once an outer iteration, with the stages'
    Jacobians as its weights; digitally, one banded factorisation.

    Attributes
    ----------
    name : str
        As the command line has it.
    slew : float
        Largest move of a q or t in an outer iteration, in network units; a longer step is shortened
        as a whole.

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
        """Stages that follow the coordinator."""
        return Linearised()

    def move(self, sample, x, drives):
        """Take a Newton step of the whole network, shortened to the slew."""
        step = sample.newton_step(x, drives)
        longest = np.abs(step[sample.rows.chain]).max()
        return x + self.slew / max(longest, self.slew) * step, (np.nan, np.nan)


def distances_of(rows: Rows, error: np.ndarray, drives: np.ndarray) -> Distances:
    """Return the errors of a state, given the solution.

    Parameters
    ----------
    rows : Rows
        Of the network's levels.
    error, drives : (n,) array
        State less solution, and what arrives at the state; in network units.

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
