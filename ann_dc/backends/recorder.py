"""TODO: the idea."""

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

    def __init__(self, network: Network, x: np.ndarray, residuals: tuple[float, float]) -> None:
        self.network = network
        self.times, self.states = [0.0], [x.copy()]
        self.residual_times, self.residuals = [0.0], [residuals]
        self._stride = 1

    @property
    def steps(self) -> int:
        """Steps taken down so far."""
        return len(self.residuals) - 1

    def step(self, now: float, x: np.ndarray, residuals: tuple[float, float]) -> None:
        """The state (n,) after one more step."""
        self.residual_times.append(now)
        self.residuals.append(residuals)
        if len(self.residual_times) % self._stride == 0:
            self._keep(now, x)

    def _keep(self, now: float, x: np.ndarray) -> None:
        if now == self.times[-1]:
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
