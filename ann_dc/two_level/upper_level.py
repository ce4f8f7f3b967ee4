"""The upper level: how the coordinator moves t and beta. Paper (17), (33), and a Newton step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.backends.recurrent.layers import torch
from ann_dc.backends.recurrent.layers.equilibrium import solve_jacobian
from ann_dc.errors import require_positive
from ann_dc.hints.checked import checked
from ann_dc.hints.words import such_as
from ann_dc.two_level.lower_level import Closed, Linearised, LowerLevel
from ann_dc.two_level.lyapunov import Distances, lyapunov_of
from ann_dc.two_level.oracle_gain import OracleGain
from ann_dc.two_level.rows import Rows


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
        self, flow: Flow, rows: Rows, state: torch.Tensor, drives: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """One move of the coordinator.

        Parameters
        ----------
        flow : Flow
        rows : Rows
            Of the network's levels.
        state, drives : (P, N, B) tensor
            The state after the lower level, and what arrives there; in network units.

        Returns
        -------
        state : (P, N, B) tensor
        gains : (2, B) tensor
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

    def move(self, flow, rows, state, drives):
        """Along the drives."""
        gains = state.new_tensor([self.lambda_t, self.lambda_beta])[:, None]
        return _along(rows, state, drives, gains.expand(2, state.shape[-1]))


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

    def move(self, flow, rows, state, drives):
        """Along the drives, as far as the oracle says."""
        found = distances_of(flow, rows, state, drives, self.gain.settled)
        gain = self.gain.of(found.lyapunov)
        return _along(rows, state, drives, torch.stack([gain, gain]))


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
    >>> run = ann_dc.TwoLevelLayer(network, upper=NewtonCoordinator(slew=1e6)).run()
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

    def move(self, flow, rows, state, drives):
        """A Newton step of the whole network, shortened to the slew."""
        x = flow.layout.pack(state)
        step = solve_jacobian(flow, x, flow.layout.pack(drives))
        moved = flow.layout.fill(x - step, flow.inputs) - state
        longest = moved[rows.chain].abs().amax((0, 1))
        share = (self.slew / longest.clamp(min=self.slew)).nan_to_num(0.0)
        gains = torch.full((2, state.shape[-1]), torch.nan).to(state)
        return state + share * moved, gains


def distances_of(
    flow: Flow, rows: Rows, state: torch.Tensor, drives: torch.Tensor, settled: np.ndarray
) -> Distances:
    """Errors (B,) of a state, given the solution.

    Parameters
    ----------
    flow : Flow
        For the inputs of the samples.
    rows : Rows
        Of the network's levels.
    state, drives : (P, N, B) tensor
        A state, and what arrives there; in network units.
    settled : (n,) or (B, n) array
        The solution, in network units.

    References
    ----------
    Paper equations (18), (19), (21).
    """
    solution = torch.atleast_2d(torch.as_tensor(settled)).to(state).expand(state.shape[-1], -1)
    error = state - flow.layout.fill(solution, flow.inputs)
    v, mu = (error[of].flatten(0, 1).norm(dim=0) for of in (rows.v, rows.mu))
    t, beta = (
        lyapunov_of(error[of].flatten(0, 1), drives[of].flatten(0, 1)) for of in (rows.t, rows.beta)
    )
    return Distances(v=v, mu=mu, t=t, beta=beta)


def _along(rows: Rows, state, drives, gains: torch.Tensor):
    moved = state.index_add(0, rows.t, gains[0] * drives[rows.t])
    return moved.index_add(0, rows.beta, gains[1] * drives[rows.beta]), gains
