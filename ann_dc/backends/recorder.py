"""Takes a run down step by step: the same record from every backend that steps.

The residuals of every step are kept, since the settling time is their last exit. States are kept
up to `SAMPLES`: beyond that every second one is dropped, and only every second one taken from then
on, so that a run of any length has its shape in bounded memory.
"""

from __future__ import annotations

import numpy as np

from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling, settling_time
from ann_dc.backends.status import Status
from ann_dc.backends.trajectory import Trajectory
from ann_dc.network.network import Network

SAMPLES = 2000
"""States kept of a run; more are thinned to every second one."""


class Recorder:
    """Takes down a run: every residual, and the states, thinned where there are many."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.times: list[float] = []
        self.states: list[np.ndarray] = []
        self.residual_times: list[float] = []
        self.residuals: list[tuple[float, float]] = []
        self._stride = 1

    @property
    def steps(self) -> int:
        """Steps taken down so far; the start is none."""
        return len(self.residuals) - 1

    def record(self, now: float, x: np.ndarray, residuals: tuple[float, float]) -> None:
        """The start, or the state (n,) after one more step."""
        self.residual_times.append(now)
        self.residuals.append(residuals)
        if len(self.residual_times) % self._stride == 0:
            self._keep(now, x)

    def _keep(self, now: float, x: np.ndarray) -> None:
        if self.times and now == self.times[-1]:
            return
        self.times.append(now)
        self.states.append(x.copy())
        if len(self.times) > SAMPLES:
            self.times, self.states = self.times[::2], self.states[::2]
            self._stride *= 2

    def run(
        self, now: float, x: np.ndarray, status: Status, settling: Settling, evaluations: int
    ) -> Run:
        """The whole run, with its last state."""
        self._keep(now, x)
        trajectory = Trajectory(
            network=self.network,
            time=np.array(self.times),
            states=np.array(self.states),
            residual_time=np.array(self.residual_times),
            residuals=np.array(self.residuals),
        )
        settled = status.settled
        return Run(
            trajectory=trajectory,
            status=status,
            tolerance=settling.tolerance,
            settling_time=settling_time(trajectory, settling) if settled else float("nan"),
            verified="the residual stayed below tolerance and fell on to "
            f"{settling.confirm:g} of it"
            if settled
            else "not settled",
            steps=self.steps,
            evaluations=evaluations,
        )
