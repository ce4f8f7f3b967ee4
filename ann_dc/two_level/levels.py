"""Two-level algorithm of the paper: stages in an inner loop, coordination outside.

The net inputs are those of the network, in another temporal order. By equation number:

===========  =====================================================================================
(11)-(15)    net inputs d of q, u, mu, t, beta: minus, minus, plus, minus, plus the gradient of L
(16)         lower level: q, u, mu += lambda d with t and beta fixed, until d vanishes (`Iterated`)
(30)         lower level in closed form: the stage equations solved (`Closed`). The printed one,
             with corrected signs, uses mu_0 = -beta_1 and q_1 = t_0, the equations of the
             coordinator: then (28) and (29) are zero and t and beta never move (S15). As
             printed, mu_0 = beta_1 and q_1 = t_0 / 0.99, they drive each other and grow (S17)
(17)         upper level: t += lambda_t d_t, beta += lambda_beta d_beta (`Gradient`)
(33)         lambda = |B/A| for both, which needs the solution (`OracleCoordinator`)
(18), (19),  errors of both levels, Theta, A, B of every outer iteration, if the solution is
(21)         known (`Distances`)
===========  =====================================================================================

A cell with a pinned q has n equations for its m controls. The lower level therefore needs closing
B, in which q_0 is a neuron (``Form(start_is_neuron=True)``). The Newton coordinator does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.network.waveforms import check_constant
from ann_dc.progress import Progress, silent
from ann_dc.two_level.lower_level import LowerLevel
from ann_dc.two_level.lyapunov import Distances, Lyapunov
from ann_dc.two_level.run import TwoLevelRun
from ann_dc.two_level.sample import Sample, rows_of
from ann_dc.two_level.upper_level import UpperLevel, distances_of
from ann_dc.validation import Shape, checked


@checked
class TwoLevels:
    """Two-level algorithm on a network.

    Parameters
    ----------
    network : Network
        Network of a problem, without inequalities and saturation limits.
    upper : UpperLevel
        `Gradient`, `OracleCoordinator` or `NewtonCoordinator`.
    lower : LowerLevel, optional
        `Closed`, `Iterated` or `Linearised`; the default is the one that suits the coordinator.

    Raises
    ------
    NetworkError
        If the lower level has no solution (pinned q_0), a population is missing, or the network has
        inequalities or saturation limits.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> from ann_dc.two_level import NewtonCoordinator
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> run = TwoLevels(network, upper=NewtonCoordinator()).run()
    >>> int(run.outer_iterations[0]) < 10
    True

    References
    ----------
    Paper section IV.A, equations (16), (17), (30), (33), corrected.
    """

    def __init__(
        self, network: Network, *, upper: UpperLevel, lower: LowerLevel | None = None
    ) -> None:
        check_constant(network.waveforms)
        self.network, self.upper, self.lower = network, upper, lower or upper.suited()
        self._rows = rows_of(network)
        self.lower.check(network)

    @checked
    def step(self, x: np.ndarray, inputs: Mapping[str, object] | None = None) -> np.ndarray:
        """Return the states (B, n) after one outer iteration.

        Parameters
        ----------
        x : (n,) or (B, n) array
            States in network units.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
            Inputs that replace those of ``network.inputs``.
        """
        samples, states = self._samples(x, inputs)
        for sample in filter(None, samples):
            solved, _ = self.lower.solve(sample, states[sample.number])
            moved, _ = self.upper.move(sample, solved, sample.drives(solved))
            states[sample.number] = moved
        return states

    @checked
    def run(
        self,
        x: np.ndarray | None = None,
        inputs: Mapping[str, object] | None = None,
        *,
        settled: Annotated[np.ndarray, Shape("...", "self.network.size")] | None = None,
        tolerance: float = 1e-6,
        limit: int = 2_000,
        progress: Progress = silent,
    ) -> TwoLevelRun:
        """Iterate until the KKT residual of every sample is below the tolerance.

        Parameters
        ----------
        x : (n,) or (B, n) array, optional
            Initial states in network units; by default the network's initial guess, moved with its
            ends.
        inputs : mapping of input name to number, (B,) or (B, N) array, optional
            Inputs that replace those of ``network.inputs``.
        settled : (n,) or (B, n) array, optional
            Solution in network units; required for the errors of both levels, Theta, A and B.
        tolerance : float
            Tolerance on the relative KKT residual.
        limit : int
            Largest number of outer iterations.
        progress : Progress
            Receives one line per outer iteration.
        """
        samples, states = self._samples(x, inputs)
        known = None if settled is None else np.broadcast_to(settled, states.shape)
        residuals, gains, inner, distances = [], [], [], []
        with np.errstate(all="ignore"):
            while True:
                worst, steps = np.full(len(samples), np.inf), 0
                drives = np.full(states.shape, np.nan)
                for sample in filter(None, samples):
                    b = sample.number
                    states[b], done = self.lower.solve(sample, states[b])
                    drives[b], worst[b] = sample.drives(states[b]), sample.residual(states[b])
                    steps = max(steps, done)
                residuals.append(worst)
                inner.append(steps)
                if known is not None:
                    of_all = zip(states - known, drives)
                    distances.append([distances_of(self._rows, *found) for found in of_all])
                progress(f"outer iteration {len(gains)}: KKT residual {worst.max():.1e}")
                running = np.isfinite(worst) & (worst >= tolerance)
                if len(gains) >= limit or not running.any():
                    break
                taken = np.full((2, len(samples)), np.nan)
                for sample in filter(None, samples):
                    b = sample.number
                    states[b], taken[:, b] = self.upper.move(sample, states[b], drives[b])
                gains.append(taken)
        return TwoLevelRun(
            states=states,
            residuals=np.array(residuals),
            gains=np.array(gains).reshape(-1, 2, len(samples)),
            inner=np.array(inner),
            distances=_stacked(distances) if distances else None,
            tolerance=tolerance,
        )

    def _samples(
        self, x: np.ndarray | None, inputs: Mapping[str, object] | None
    ) -> tuple[list[Sample | None], np.ndarray]:
        """Return the samples, None for an input that is not finite, and their states (B, n)."""
        network = self.network
        every = input_batch(network, inputs or {})
        states = np.atleast_2d(moved_starts(network, every) if x is None else np.array(x, float))
        given = max((len(values) for values in every.values()), default=1)
        count = max(len(states), given)
        if states.ndim != 2 or states.shape[1] != network.size or {len(states), given} - {1, count}:
            raise NetworkError(
                f"x: expected state vectors of {network.size} neurons for {given} samples, got an "
                f"array of shape {states.shape}"
            )
        states = np.broadcast_to(states, (count, network.size)).copy()
        samples: list[Sample | None] = []
        for b in range(count if inputs else 0):
            own = {name: values[b if len(values) > 1 else 0] for name, values in every.items()}
            finite = all(np.isfinite(values).all() for values in own.values())
            samples.append(Sample(network.with_inputs(own), b) if finite else None)
        return samples or [self._own.numbered(b) for b in range(count)], states

    @cached_property
    def _own(self) -> Sample:
        return Sample(self.network)


def _stacked(found: list[list[Distances]]) -> Distances:
    """Stack the distances of all outer iterations and samples to arrays (J + 1, B)."""

    def column(of: Callable[[Distances], Any]) -> Any:
        return np.array([[of(one) for one in row] for row in found])

    t, beta = (Lyapunov(*np.moveaxis(column(lambda one, k=k: one[k]), -1, 0)) for k in (2, 3))
    return Distances(v=column(lambda one: one.v), mu=column(lambda one: one.mu), t=t, beta=beta)
