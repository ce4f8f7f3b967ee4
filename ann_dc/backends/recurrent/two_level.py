r"""The paper's two-level algorithm: stages in an inner loop, their coordination in an outer one.

The same drives as everywhere, in another order of time. By equation number:

===========  =====================================================================================
(11)-(15)    the drives d of q, u, mu, t, beta: minus, minus, plus, minus, plus the gradient of L
(16)         lower level: q, u, mu += lambda d with t and beta held, until d vanishes (`Iterated`)
(30)         lower level in closed form: the stage equations solved (`Closed`). The printed one,
             its signs repaired, uses mu_0 = -beta_1 and q_1 = t_0, the coordinator's own
             equations: after it (28) and (29) are zero and t and beta never move (S15)
(17)         upper level: t += lambda_t d_t, beta += lambda_beta d_beta (`Gradient`)
(33)         lambda = |B/A| for both, which needs the solution (`Oracle`)
(19), (21)   Theta, A, B of every outer iteration, where the solution is known
===========  =====================================================================================

With one inner step a round and lambda = h/tau throughout, (16) and (17) are a recurrent layer that
moves (q, u, mu) first and (t, beta) on what they say; run to the end, the inner loop leaves t and
beta as the only state.

A cell whose q is pinned has n equations for its m controls: the lower level needs closing B, in
which q_0 is a neuron (``Form(start_is_neuron=True)``). The Newton coordinator does not.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import nn

from ann_dc.backends.recurrent.cell import CellLayer
from ann_dc.backends.recurrent.equilibrium import solve_jacobian
from ann_dc.backends.recurrent.flow import Flow
from ann_dc.backends.recurrent.steps import dual_limit
from ann_dc.errors import NetworkError, require_positive
from ann_dc.network.lyapunov import Lyapunov, lyapunov
from ann_dc.network.network import COORDINATION, Network


class Levels(NamedTuple):
    """Which rows of a state belong to which level; q, u and mu are the lower one."""

    lower: torch.Tensor
    t: torch.Tensor
    beta: torch.Tensor
    chain: torch.Tensor
    """Rows of q and t, whose moves a Newton step bounds."""


class LowerLevel(ABC):
    """What the stages do between two words of the coordinator."""

    @abstractmethod
    def solve(self, flow: Flow, levels: Levels, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """The state (P, N, B) with the lower level solved, and how many inner steps that took."""

    def check(self, network: Network) -> None:
        """Refuse a network whose lower level has no solution."""
        pinned = [pin.neuron for pin in network.pins if pin.neuron.startswith("q.")]
        controls = [n for n in network.cell.neurons if n.population == "u"]
        if len(pinned) > len(controls):
            raise NetworkError(
                f"lower level: {', '.join(pinned)} of cell 0 is pinned, so that its stage has more "
                "equations than unknowns; close the chain with Form(start_is_neuron=True)"
            )


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

    share: float = 0.6
    tolerance: float = 1e-9
    limit: int = 5_000

    def __post_init__(self) -> None:
        require_positive(share=self.share, tolerance=self.tolerance, limit=self.limit)

    def solve(self, flow: Flow, levels: Levels, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """Step until every sample is there."""
        step = self.share * float(dual_limit(flow))
        for done in range(self.limit):
            drives = flow.read(state).drives[levels.lower]
            if _at_rest(drives, self.tolerance):
                return state, done
            moves = step * drives * flow.constants.rates[levels.lower]
            state = flow.within_rails(state.index_add(0, levels.lower, moves))
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

    tolerance: float = 1e-11
    limit: int = 20
    slew: float = 0.5

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, limit=self.limit, slew=self.slew)

    def solve(self, flow: Flow, levels: Levels, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """All stages of all samples at once: one small linear system each."""
        for done in range(self.limit):
            drives = flow.read(state).drives[levels.lower]
            if _at_rest(drives, self.tolerance):
                return state, done
            move = _stage_steps(flow, levels, state, drives)
            if done < self.limit // 2:
                largest = move.abs().amax(0).clamp(min=self.slew)
                move = move * (self.slew / largest)
            state = state.index_add(0, levels.lower, move)
        return state, self.limit


@dataclass(frozen=True, kw_only=True)
class Linearised(LowerLevel):
    """The stages report their linearisation and move when the coordinator has solved for them."""

    def solve(self, flow: Flow, levels: Levels, state: torch.Tensor) -> tuple[torch.Tensor, int]:
        """Nothing to do before the coordinator."""
        return state, 0

    def check(self, network: Network) -> None:
        """Any network will do."""


class UpperLevel(ABC):
    """How the coordinator moves."""

    @abstractmethod
    def move(
        self, flow: Flow, levels: Levels, state: torch.Tensor, drives: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """The next state (P, N, B), and the gains (2, B) of t and beta that it took."""


@dataclass(frozen=True, kw_only=True)
class Gradient(UpperLevel):
    """Paper (17), corrected: t and beta along their drives, each with its own gain.

    `ann_dc.network.upper_map.UpperMap.best` finds good ones. One common gain is slower, and
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
        x = flow.cell.pack(state)
        step = solve_jacobian(flow, x, flow.cell.pack(drives))
        moved = flow.cell.fill(x - step, flow.inputs) - state
        longest = moved[levels.chain].abs().amax((0, 1))
        share = (self.slew / longest.clamp(min=self.slew)).nan_to_num(0.0)
        gains = torch.full((2, state.shape[-1]), torch.nan).to(state)
        return state + share * moved, gains


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoLevelRun:
    """What happened in J outer iterations of B samples.

    Attributes
    ----------
    states : (B, n) array
        State vectors at the end.
    residuals : (J + 1, B) array
        Relative KKT residual before every outer iteration, and at the end.
    gains : (J, 2, B) array
        lambda_t and lambda_beta; nan where the coordinator has none.
    inner : (J + 1,) integers
        Inner steps before every outer iteration.
    lyapunov : Lyapunov or None
        Theta, A and B, each (J + 1, B), where the solution was given.
    tolerance : float
    """

    states: np.ndarray
    residuals: np.ndarray
    gains: np.ndarray
    inner: np.ndarray
    lyapunov: Lyapunov | None
    tolerance: float

    @property
    def outer_iterations(self) -> np.ndarray:
        """(B,) outer iterations after which the residual stays below the tolerance, or -1."""
        above = ~(self.residuals < self.tolerance)
        last = len(above) - 1 - above[::-1].argmax(axis=0)
        count = np.where(above.any(axis=0), last + 1, 0)
        return np.where(above[-1], -1, count)

    @property
    def settled(self) -> np.ndarray:
        """(B,) booleans."""
        return self.outer_iterations >= 0


class TwoLevelLayer(nn.Module):
    """The two-level algorithm as a recurrent module.

    Parameters
    ----------
    network : Network
    upper : UpperLevel
        `Gradient`, `Oracle` or `NewtonCoordinator`.
    lower : LowerLevel, optional
        `Closed` by default, `Linearised` under a Newton coordinator; or `Iterated`.
    dtype, device
        See `CellLayer`.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> run = TwoLevelLayer(network, upper=NewtonCoordinator()).run()
    >>> int(run.outer_iterations[0]) < 10
    True

    References
    ----------
    Paper section IV.A, equations (16), (17), (30), (33), corrected.
    """

    def __init__(
        self,
        network: Network,
        *,
        upper: UpperLevel,
        lower: LowerLevel | None = None,
        dtype: torch.dtype = torch.float64,
        device: str | torch.device = "cpu",
    ) -> None:
        super().__init__()
        default = Linearised() if isinstance(upper, NewtonCoordinator) else Closed()
        self.upper, self.lower = upper, lower or default
        self.lower.check(network)
        self.cell = CellLayer(network, dtype=dtype, device=device)
        if self.cell.railed:
            raise NetworkError("two levels: a network with rails has no such algorithm yet")
        self._levels = _levels_of(network)

    @property
    def levels(self) -> Levels:
        """Rows of the levels, on the layer's device."""
        return Levels(*(rows.to(self.cell.live.device) for rows in self._levels))

    def forward(self, x: torch.Tensor, inputs: Mapping[str, object] | None = None) -> torch.Tensor:
        """State vectors (B, n) one outer iteration later."""
        flow, levels = self.cell.flow(inputs), self.levels
        first = self.cell.states_of(x, flow.inputs.shape[-1])
        state, _ = self.lower.solve(flow, levels, self.cell.fill(first, flow.inputs))
        state, _ = self.upper.move(flow, levels, state, flow.read(state).drives)
        return self.cell.pack(state)

    @torch.no_grad()
    def run(
        self,
        x: np.ndarray | torch.Tensor | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        settled: np.ndarray | None = None,
        tolerance: float = 1e-6,
        limit: int = 2_000,
        progress: Callable[[str], None] | None = None,
    ) -> TwoLevelRun:
        """Iterate until the KKT residual of every sample is below the tolerance.

        Parameters
        ----------
        x : (n,) or (B, n) array, optional
            Where to start; `CellLayer.starts` by default.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
        settled : (n,) or (B, n) array, optional
            The solution, for Theta, A and B.
        tolerance : float
        limit : int
            Largest number of outer iterations.
        progress : callable, optional
            Told one line an outer iteration.
        """
        flow, levels = self.cell.flow(inputs), self.levels
        x = self.cell.starts(inputs) if x is None else x
        state = self.cell.fill(self.cell.states_of(x, flow.inputs.shape[-1]), flow.inputs)
        residuals, gains, inner, thetas = [], [], [], []
        while True:
            state, steps = self.lower.solve(flow, levels, state)
            drives = flow.read(state).drives
            worst = flow.residuals(state, drives).amax(0)
            residuals.append(worst)
            inner.append(steps)
            if settled is not None:
                thetas.append(theta_of(flow, levels, state, drives, settled))
            if progress:
                progress(f"outer iteration {len(gains)}: KKT residual {float(worst.amax()):.1e}")
            running = worst.isfinite() & (worst >= tolerance)
            if len(gains) >= limit or not running.any():
                break
            state, taken = self.upper.move(flow, levels, state, drives)
            gains.append(taken)
        return TwoLevelRun(
            states=self.cell.pack(state).cpu().numpy(),
            residuals=torch.stack(residuals).cpu().numpy(),
            gains=np.array([g.cpu().numpy() for g in gains]).reshape(-1, 2, len(residuals[0])),
            inner=np.array(inner),
            lyapunov=_stacked(thetas) if thetas else None,
            tolerance=tolerance,
        )


def theta_of(
    flow: Flow, levels: Levels, state: torch.Tensor, drives: torch.Tensor, settled: np.ndarray
) -> Lyapunov:
    """Theta, A and B (B,) of a state, given the solution (n,) or (B, n)."""
    solution = torch.atleast_2d(torch.as_tensor(settled)).to(state).expand(state.shape[-1], -1)
    error = state - flow.cell.fill(solution, flow.inputs)
    rows = torch.cat([levels.t, levels.beta])
    return lyapunov(error[rows].flatten(0, 1), drives[rows].flatten(0, 1))


def _at_rest(drives: torch.Tensor, tolerance: float) -> bool:
    """Whether the drives (L, N, B) of every sample that is not lost have vanished."""
    worst = drives.abs().amax((0, 1))
    smallest = 100 * torch.finfo(drives.dtype).eps
    return bool((~worst.isfinite() | (worst < max(tolerance, smallest))).all())


def _stacked(found: list[Lyapunov]) -> Lyapunov:
    return Lyapunov(*(torch.stack(list(parts)).cpu().numpy() for parts in zip(*found)))


def _along(levels: Levels, state, drives, gains: torch.Tensor):
    moved = state.index_add(0, levels.t, gains[0] * drives[levels.t])
    return moved.index_add(0, levels.beta, gains[1] * drives[levels.beta]), gains


def _levels_of(network: Network) -> Levels:
    of = [neuron.population for neuron in network.cell.neurons]

    def rows(*populations: str) -> torch.Tensor:
        return torch.tensor([row for row, p in enumerate(of) if p in populations])

    missing = [name for name in ("q", "u", "mu", *COORDINATION) if name not in of]
    if missing:
        raise NetworkError(
            f"two levels: {network.title} has no {', '.join(missing)}; the algorithm needs the "
            "network of a problem"
        )
    return Levels(rows("q", "u", "mu"), rows("t"), rows("beta"), rows("q", "t"))


def _stage_steps(flow: Flow, levels: Levels, state: torch.Tensor, drives: torch.Tensor):
    """Newton steps (L, N, B) of the lower level, every stage by itself."""
    lower, stages, samples = levels.lower, state.shape[1], state.shape[2]
    place = torch.full((len(state),), -1, device=state.device)
    place[lower] = torch.arange(len(lower), device=state.device)
    neuron, stage = flow.cell.places // stages, flow.cell.places % stages
    row, column = flow.cell.entries[:, 0], flow.cell.entries[:, 1]
    inside = (place[neuron[row]] >= 0) & (place[neuron[column]] >= 0)
    inside &= stage[row] == stage[column]
    blocks = state.new_zeros(stages, len(lower), len(lower), samples)
    where = stage[row][inside], place[neuron[row]][inside], place[neuron[column]][inside]
    blocks[where] = flow.jacobian_entries(state)[inside]
    dead = (1 - flow.cell.live[lower, :, 0]).T  # a left-out neuron stays where it is
    blocks = blocks.permute(3, 0, 1, 2) + torch.diag_embed(dead)
    steps, _ = torch.linalg.solve_ex(blocks, -drives.permute(2, 1, 0))
    return steps.permute(2, 1, 0)
