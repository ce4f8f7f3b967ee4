"""The upper level: how the coordinator moves t and beta. Paper (17), (33), and a Newton step."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
import torch

from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.backends.recurrent.equilibrium import solve_jacobian
from ann_dc.errors import require_positive
from ann_dc.two_level.lower_level import Rows
from ann_dc.two_level.lyapunov import Lyapunov, lyapunov


class UpperLevel(ABC):
    """How the coordinator moves."""

    @abstractmethod
    def move(
        self, flow: Flow, levels: Rows, state: torch.Tensor, drives: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """The next state (P, N, B), and the gains (2, B) of t and beta that it took."""


@dataclass(frozen=True, kw_only=True)
class Gradient(UpperLevel):
    """Paper (17), corrected: t and beta along their drives, each with its own gain.

    `ann_dc.two_level.upper_gains.UpperMap.best` finds good ones. One common gain is slower, and
    hopeless in units that give t and beta reciprocal scales.

    Attributes
    ----------
    lambda_t, lambda_beta : float
        In network units.
    """

    lambda_t: float
    lambda_beta: float

    def __post_init__(self) -> None:
        require_positive(lambda_t=self.lambda_t, lambda_beta=self.lambda_beta)

    def move(self, flow, levels, state, drives):
        """Along the drives."""
        gains = state.new_tensor([self.lambda_t, self.lambda_beta])[:, None]
        return _along(levels, state, drives, gains.expand(2, state.shape[-1]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Oracle(UpperLevel):
    """Paper (33): lambda = share |B/A| for t and beta, from the solution; for studies only.

    Where B < 0, a share of 1/2 lowers Theta most, and a share of 1 leaves it as it is. Where B >= 0
    no lambda lowers it.

    Attributes
    ----------
    settled : (n,) array
        State vector of the solution.
    share : float
    high : float
        Largest lambda; |B/A| has no bound near the solution.
    """

    settled: np.ndarray
    share: float = 0.5
    high: float = 1e3

    def __post_init__(self) -> None:
        require_positive(share=self.share, high=self.high)

    def move(self, flow, levels, state, drives):
        """Along the drives, as far as the oracle says."""
        found = theta_of(flow, levels, state, drives, self.settled)
        gain = (self.share * found.bound.abs()).nan_to_num(0.0).clamp(max=self.high)
        return _along(levels, state, drives, torch.stack([gain, gain]))


@dataclass(frozen=True, kw_only=True)
class NewtonCoordinator(UpperLevel):
    """Solves the banded KKT system that the linearised stages report; the stages follow.

    In hardware: one linear network that settles once an outer iteration, with the stages'
    Jacobians as its weights; digitally, one banded factorisation.

    Attributes
    ----------
    slew : float
        Largest move of a q or t in an outer iteration; a longer step is shortened as a whole.
    """

    slew: float = 0.75

    def __post_init__(self) -> None:
        require_positive(slew=self.slew)

    def move(self, flow, levels, state, drives):
        """A Newton step of the whole network, shortened to the slew."""
        x = flow.layout.pack(state)
        step = solve_jacobian(flow, x, flow.layout.pack(drives))
        moved = flow.layout.fill(x - step, flow.inputs) - state
        longest = moved[levels.chain].abs().amax((0, 1))
        share = (self.slew / longest.clamp(min=self.slew)).nan_to_num(0.0)
        gains = torch.full((2, state.shape[-1]), torch.nan).to(state)
        return state + share * moved, gains


def theta_of(
    flow: Flow, levels: Rows, state: torch.Tensor, drives: torch.Tensor, settled: np.ndarray
) -> Lyapunov:
    """Theta, A and B (B,) of a state, given the solution (n,) or (B, n)."""
    solution = torch.atleast_2d(torch.as_tensor(settled)).to(state).expand(state.shape[-1], -1)
    error = state - flow.layout.fill(solution, flow.inputs)
    rows = torch.cat([levels.t, levels.beta])
    return lyapunov(error[rows].flatten(0, 1), drives[rows].flatten(0, 1))


def _along(levels: Rows, state, drives, gains: torch.Tensor):
    moved = state.index_add(0, levels.t, gains[0] * drives[levels.t])
    return moved.index_add(0, levels.beta, gains[1] * drives[levels.beta]), gains
