"""Recording of a run step by step, identical for every stepping backend.

The residuals of every step are stored because the settling time is their last exit. Above `SAMPLES`
states every second one is dropped, and only every second step is recorded from then on.
"""

from __future__ import annotations

import numpy as np

from ann_dc.backends.integration.methods import Between, Known
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling, settling_time
from ann_dc.backends.status import Status, with_growth
from ann_dc.backends.trajectory import SAMPLES, Trajectory
from ann_dc.network.network import Network


class Recorder:
    """Recorder of a run: residuals of every step, and thinned states."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.residual_times: list[float] = []
        self.residuals: list[tuple[float, float]] = []
        self._curve: list[Known] = []
        self._kept, self._seen, self._stride = 0, 0, 1

    @property
    def steps(self) -> int:
        """Number of steps recorded so far, not counting the start."""
        return len(self.residuals) - 1

    def record(self, now: float, x: np.ndarray, residuals: tuple[float, float]) -> None:
        """Record the start or the state (n,) after one more step, with both residuals."""
        self.residual_times.append(now)
        self.residuals.append(residuals)
        self._keep(np.array([now]), np.array([x]))

    def record_all(self, times: np.ndarray, residuals: np.ndarray, states: np.ndarray) -> None:
        """Record several steps: times (steps,), residuals (steps, 2), states (steps, n)."""
        self.residual_times.extend(times.tolist())
        self.residuals.extend(map(tuple, residuals.tolist()))
        self._keep(times, states)

    def _keep(self, times: np.ndarray, states: np.ndarray) -> None:
        chosen = slice(-self._seen % self._stride, None, self._stride)
        self._seen += len(times)
        self._curve.append((times[chosen], states[chosen]))
        self._kept += len(self._curve[-1][0])
        while self._kept > SAMPLES:
            times, states = self._joined()
            self._curve, self._stride = [(times[::2], states[::2])], 2 * self._stride
            self._kept = len(self._curve[0][0])

    def last_states(self, steps: int) -> np.ndarray:
        """Return the stored states (T, n) of the given number of last steps."""
        times, states = self._joined()
        return states[times >= self.residual_times[-steps]]

    def _joined(self) -> Known:
        times, states = zip(*self._curve)
        return np.concatenate(times), np.concatenate(states)

    def run(
        self,
        now: float,
        x: np.ndarray,
        status: Status,
        settling: Settling,
        evaluations: int,
        *,
        between: Between | None = None,
        exit: float | None = None,
    ) -> Run:
        """Return the complete run with its last state (n,) and its number of right-hand sides.

        The settling time is nan unless the status is settled. ``exit`` is the last exit of the
        residual, located inside its step.
        """
        times, states = self._joined()
        if now != times[-1]:
            times, states = np.append(times, now), np.vstack([states, x])
        trajectory = Trajectory(
            network=self.network,
            time=times,
            states=states,
            residual_time=np.array(self.residual_times),
            residuals=np.array(self.residuals),
        )
        if between is not None:
            trajectory = trajectory.with_between(between, with_middles=self._stride == 1)
        settled, unmet = status.settled, trajectory.residuals[len(self.residuals) // 2 :, 0]
        status = with_growth(status, self.network, (times, states), float(np.min(unmet)))
        return Run(
            trajectory=trajectory,
            status=status,
            tolerance=settling.tolerance,
            settling_time=settling_time(trajectory, settling, exit) if settled else float("nan"),
            verified="the residual stayed below the tolerance and decreased to "
            f"{settling.confirm:g} of it"
            if settled
            else "not settled",
            steps=self.steps,
            evaluations=evaluations,
        )
