"""The lower level: what the stages do between two words of their coordinator. Paper (16), (30)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from ann_dc.backends.recurrent.cell.flow import Flow
from ann_dc.backends.recurrent.layers import torch
from ann_dc.backends.recurrent.layers.steps import dual_limit
from ann_dc.errors import NetworkError, require_positive
from ann_dc.hints.checked import checked
from ann_dc.hints.words import such_as
from ann_dc.network.network import Network
from ann_dc.two_level.rows import Rows


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
    def solve(self, flow: Flow, rows: Rows, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """Solve the lower level, with t and beta held.

        Parameters
        ----------
        flow : Flow
        rows : Rows
            Of the network's levels.
        state : (P, N, B) tensor
            In network units.

        Returns
        -------
        state : (P, N, B) tensor
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
    >>> layer = ann_dc.TwoLevelLayer(network, upper=upper, lower=Closed(slew=100.0))
    >>> layer.run(limit=1).inner.tolist()
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
    """The stages report their linearisation and move when the coordinator has solved for them.

    Attributes
    ----------
    name : str
        As the command line has it.
    """

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
