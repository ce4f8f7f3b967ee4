"""The lower level: what the stages do between two words of their coordinator. Paper (16), (30)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ann_dc.backends.recurrent import torch
from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.backends.recurrent.steps import dual_limit
from ann_dc.errors import NetworkError, require_positive
from ann_dc.network.network import Network
from ann_dc.two_level.rows import Rows


class LowerLevel(ABC):
    """What the stages do between two words of the coordinator."""

    name: ClassVar[str]

    @abstractmethod
    def solve(self, flow: Flow, rows: Rows, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """The state (P, N, B) with the lower level solved, and how many inner steps that took."""

    @abstractmethod
    def check(self, network: Network) -> None:
        """Refuse a network whose lower level has no solution, with a `NetworkError`."""


@dataclass(frozen=True, kw_only=True)
class Iterated(LowerLevel):
    """Forward Euler (16) on q, u and mu until their drives vanish.

    Attributes
    ----------
    share : float
        Step as a share of min rho tau over the duals.
    tolerance : float
        On the drives.
    limit : int
        Largest number of inner steps.
    """

    name: ClassVar[str] = "iterated"
    share: float = 0.6
    tolerance: float = 1e-9
    limit: int = 5_000

    def __post_init__(self) -> None:
        require_positive(share=self.share, tolerance=self.tolerance, limit=self.limit)

    def check(self, network: Network) -> None:
        """Every stage needs as many equations as unknowns."""
        _require_free_start(network)

    def solve(self, flow: Flow, rows: Rows, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """Step until every sample is there."""
        step = self.share * float(dual_limit(flow))
        for done in range(self.limit):
            drives = flow.read(state).drives[rows.lower]
            if _at_rest(drives, self.tolerance):
                return state, done
            moves = step * drives * flow.constants.rates[rows.lower]
            state = flow.within_rails(state.index_add(0, rows.lower, moves))
        return state, self.limit


@dataclass(frozen=True, kw_only=True)
class Closed(LowerLevel):
    """The stage equations solved stage by stage: (30) where they are linear, Newton where not.

    Attributes
    ----------
    tolerance : float
        On the drives.
    limit : int
        Largest number of Newton steps.
    slew : float
        Largest move of a lower neuron in a Newton step, in network units, during the first half of
        the steps.
    """

    name: ClassVar[str] = "closed"
    tolerance: float = 1e-11
    limit: int = 20
    slew: float = 0.5

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, limit=self.limit, slew=self.slew)

    def check(self, network: Network) -> None:
        """Every stage needs as many equations as unknowns."""
        _require_free_start(network)

    def solve(self, flow: Flow, rows: Rows, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """All stages of all samples at once: one small linear system each."""
        for done in range(self.limit):
            drives = flow.read(state).drives[rows.lower]
            if _at_rest(drives, self.tolerance):
                return state, done
            move = _stage_steps(flow, rows, state, drives)
            if done < self.limit // 2:
                largest = move.abs().amax(0).clamp(min=self.slew)
                move = move * (self.slew / largest)
            state = state.index_add(0, rows.lower, move)
        return state, self.limit


@dataclass(frozen=True, kw_only=True)
class Linearised(LowerLevel):
    """The stages report their linearisation and move when the coordinator has solved for them."""

    name: ClassVar[str] = "linearised"

    def check(self, network: Network) -> None:
        """Any network will do."""

    def solve(self, flow: Flow, rows: Rows, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """Nothing to do before the coordinator."""
        return state, 0


def _require_free_start(network: Network) -> None:
    """Cell 0 with a pinned q has n equations for its m controls."""
    pinned = [pin.neuron for pin in network.pins if pin.neuron.startswith("q.")]
    controls = [n for n in network.cell.neurons if n.population == "u"]
    if len(pinned) > len(controls):
        raise NetworkError(
            f"lower level: {', '.join(pinned)} of cell 0 is pinned, so that its stage has more "
            "equations than unknowns; close the chain with Form(start_is_neuron=True)"
        )


def _at_rest(drives: torch.Tensor, tolerance: float) -> bool:
    """Whether the drives (L, N, B) of every sample that is not lost have vanished."""
    worst = drives.abs().amax((0, 1))
    smallest = 100 * torch.finfo(drives.dtype).eps
    return bool((~worst.isfinite() | (worst < max(tolerance, smallest))).all())


def _stage_steps(flow: Flow, rows: Rows, state: torch.Tensor, drives: torch.Tensor):
    """Newton steps (L, N, B) of the lower level, every stage by itself."""
    lower, stages, samples = rows.lower, state.shape[1], state.shape[2]
    place = torch.full((len(state),), -1, device=state.device)
    place[lower] = torch.arange(len(lower), device=state.device)
    neuron, stage = flow.layout.places // stages, flow.layout.places % stages
    row, column = flow.layout.entries[:, 0], flow.layout.entries[:, 1]
    inside = (place[neuron[row]] >= 0) & (place[neuron[column]] >= 0)
    inside &= stage[row] == stage[column]
    blocks = state.new_zeros(stages, len(lower), len(lower), samples)
    where = stage[row][inside], place[neuron[row]][inside], place[neuron[column]][inside]
    blocks[where] = flow.jacobian_entries(state)[inside]
    dead = (1 - flow.layout.live[lower, :, 0]).T  # a left-out neuron stays where it is
    blocks = blocks.permute(3, 0, 1, 2) + torch.diag_embed(dead)
    steps, _ = torch.linalg.solve_ex(blocks, -drives.permute(2, 1, 0))
    return steps.permute(2, 1, 0)
