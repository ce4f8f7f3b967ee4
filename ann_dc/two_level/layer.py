r"""The paper's two-level algorithm: stages in an inner loop, their coordination in an outer one.

The same drives as everywhere, in another order of time. By equation number:

===========  =====================================================================================
(11)-(15)    the drives d of q, u, mu, t, beta: minus, minus, plus, minus, plus the gradient of L
(16)         lower level: q, u, mu += lambda d with t and beta held, until d vanishes (`Iterated`)
(30)         lower level in closed form: the stage equations solved (`Closed`). The printed one,
             its signs repaired, uses mu_0 = -beta_1 and q_1 = t_0, the coordinator's own
             equations: after it (28) and (29) are zero and t and beta never move (S15). To the
             letter, mu_0 = beta_1 and q_1 = t_0 / 0.99, they drive each other and grow (S17)
(17)         upper level: t += lambda_t d_t, beta += lambda_beta d_beta (`Gradient`)
(33)         lambda = |B/A| for both, which needs the solution (`OracleCoordinator`)
(18), (19),  the errors of both levels, Theta, A, B of every outer iteration, where the solution is
(21)         known (`Distances`)
===========  =====================================================================================

With one inner step a round and lambda = h/tau throughout, (16) and (17) are a recurrent layer that
moves (q, u, mu) first and (t, beta) on what they say; run to the end, the inner loop leaves t and
beta as the only state.

A cell whose q is pinned has n equations for its m controls: the lower level needs closing B, in
which q_0 is a neuron (``Form(start_is_neuron=True)``). The Newton coordinator does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from ann_dc.backends.recurrent.cell.layer import CellLayer
from ann_dc.backends.recurrent.layers import torch
from ann_dc.hints.checked import checked
from ann_dc.hints.values import Shape
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.two_level.lower_level import LowerLevel
from ann_dc.two_level.lyapunov import Distances, Lyapunov
from ann_dc.two_level.rows import Rows, rows_of
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.two_level.upper_level import UpperLevel, distances_of


@checked
class TwoLevelLayer(torch.nn.Module):
    """The two-level algorithm as a recurrent module.

    Parameters
    ----------
    network : Network
        Of a problem, without rails.
    upper : UpperLevel
        `Gradient`, `OracleCoordinator` or `NewtonCoordinator`.
    lower : LowerLevel, optional
        `Closed`, `Iterated` or `Linearised`; by default the one that suits the coordinator.
    dtype, device
        See `CellLayer`.

    Raises
    ------
    NetworkError
        If the lower level has no solution (a pinned q_0), a population is missing, or the network
        has inequalities or rails.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> from ann_dc.two_level import NewtonCoordinator
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
        self.upper, self.lower = upper, lower or upper.suited()
        self._rows = rows_of(network)
        self.lower.check(network)
        self.cell = CellLayer(network, dtype=dtype, device=device)

    @property
    def rows(self) -> Rows:
        """Rows of the levels, on the layer's device."""
        return self._rows.to(self.cell.layout.live.device)

    @checked
    def forward(self, x: torch.Tensor, inputs: Mapping[str, object] | None = None) -> torch.Tensor:
        """State vectors (B, n) one outer iteration later.

        Parameters
        ----------
        x : (n,) or (B, n) tensor
            In network units.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
            As in ``network.inputs``, from which the rest is taken.

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, or sizes do not agree.
        """
        flow, rows = self.cell.flow(inputs), self.rows
        first = self.cell.states_of(x, flow.inputs.shape[-1])
        state, _ = self.lower.solve(flow, rows, self.cell.fill(first, flow.inputs))
        state, _ = self.upper.move(flow, rows, state, flow.read(state).drives)
        return self.cell.pack(state)

    @checked
    @torch.no_grad()
    def run(
        self,
        x: np.ndarray | torch.Tensor | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        settled: Annotated[np.ndarray, Shape("...", "self.cell.network.size")] | None = None,
        tolerance: float = 1e-6,
        limit: int = 2_000,
        progress: Progress = silent,
    ) -> TwoLevelRun:
        """Iterate until the KKT residual of every sample is below the tolerance.

        Parameters
        ----------
        x : (n,) or (B, n) array, optional
            Where to start, in network units; `CellLayer.starts` by default.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
            As in ``network.inputs``, from which the rest is taken.
        settled : (n,) or (B, n) array, optional
            The solution, in network units, for the errors of both levels, Theta, A and B.
        tolerance : float
            On the relative KKT residual.
        limit : int
            Largest number of outer iterations.
        progress : Progress
            Told one line an outer iteration.

        Returns
        -------
        TwoLevelRun

        Raises
        ------
        UnknownNameError, NetworkError
            If an input does not exist, or sizes do not agree.
        """
        flow, rows = self.cell.flow(inputs), self.rows
        x = self.cell.starts(inputs) if x is None else x
        state = self.cell.fill(self.cell.states_of(x, flow.inputs.shape[-1]), flow.inputs)
        residuals, gains, inner, distances = [], [], [], []
        while True:
            state, steps = self.lower.solve(flow, rows, state)
            drives = flow.read(state).drives
            worst = flow.residuals(state, drives).amax(0)
            residuals.append(worst)
            inner.append(steps)
            if settled is not None:
                distances.append(distances_of(flow, rows, state, drives, settled))
            progress(f"outer iteration {len(gains)}: KKT residual {float(worst.amax()):.1e}")
            running = worst.isfinite() & (worst >= tolerance)
            if len(gains) >= limit or not running.any():
                break
            state, taken = self.upper.move(flow, rows, state, drives)
            gains.append(taken)
        return TwoLevelRun(
            states=self.cell.pack(state).cpu().numpy(),
            residuals=torch.stack(residuals).cpu().numpy(),
            gains=np.array([g.cpu().numpy() for g in gains]).reshape(-1, 2, len(residuals[0])),
            inner=np.array(inner),
            distances=_stacked(distances) if distances else None,
            tolerance=tolerance,
        )


def _stacked(found: list[Distances]) -> Distances:
    v, mu, t, beta = zip(*found)
    of_t, of_beta = (Lyapunov(*map(_arrays, zip(*parts))) for parts in (t, beta))
    return Distances(v=_arrays(v), mu=_arrays(mu), t=of_t, beta=of_beta)


def _arrays(parts: tuple[torch.Tensor, ...]) -> np.ndarray:
    return torch.stack(parts).cpu().numpy()
