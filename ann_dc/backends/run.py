"""What a run gives back, whatever the backend."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ann_dc.backends.status import Status
from ann_dc.errors import require_positive
from ann_dc.network.network import Network

SAMPLES = 2000
"""States kept of a run; more are thinned to every second one."""


@dataclass(frozen=True, kw_only=True)
class Settling:
    """When a run counts as settled.

    Attributes
    ----------
    tolerance : float
        On the relative KKT residual; the settling time is the last exit from below it.
    confirm : float
        The run goes on until the residual is below this share of the tolerance.
    controls : float or None
        Additionally, every control must stay within this share of the largest final control.
    """

    tolerance: float = 1e-6
    confirm: float = 0.005
    controls: float | None = None

    def __post_init__(self) -> None:
        require_positive(tolerance=self.tolerance, confirm=self.confirm)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """States over network time.

    Attributes
    ----------
    network : Network
    time : (T,) array
        Network time of the samples (every integration step, thinned where there are many).
    states : (T, n) array
        State vectors.
    residual_time : (R,) array
    residuals : (R, 2) array
        Relative constraint and stationarity residuals at every integration step.
    """

    network: Network
    time: np.ndarray
    states: np.ndarray
    residual_time: np.ndarray
    residuals: np.ndarray

    @property
    def final(self) -> np.ndarray:
        """The last state vector (n,)."""
        return self.states[-1]

    @property
    def kkt(self) -> np.ndarray:
        """(R,) the larger of the two residuals."""
        return self.residuals.max(axis=1)

    @property
    def controls(self) -> np.ndarray:
        """(T, live control neurons) in the user's units."""
        return controls_of(self.network, self.states)

    def __getitem__(self, name: str) -> np.ndarray:
        """A neuron's states (T, N) in the user's units, by name (``mu.phi``)."""
        neuron = self.network.neuron(name)
        row = self.network.neuron_index[name]
        return self.network.unpack(self.states)[:, row] * neuron.unit


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One run of a network on a backend.

    Attributes
    ----------
    trajectory : Trajectory
    status : Status
    tolerance : float
        On the relative KKT residual.
    settling_time : float
        Network time after which the residual stays below the tolerance; nan if it never does.
    verified : str
        How the settling time was checked.
    steps, evaluations : int
        Integration or recurrent steps, and right-hand sides (a recurrent step counts as one).
    """

    trajectory: Trajectory
    status: Status
    tolerance: float
    settling_time: float
    verified: str
    steps: int
    evaluations: int

    @property
    def settling_steps(self) -> int | None:
        """Steps after which the residual stays below the tolerance; None if it never does."""
        if not np.isfinite(self.settling_time):
            return None
        return int((self.trajectory.residual_time < self.settling_time).sum())


class Backend(Protocol):
    """What runs a network from its start until it settles, or cannot."""

    def run(self, network: Network) -> Run:
        """The whole run, whatever its outcome."""
        ...


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


def settling_time(trajectory: Trajectory, settling: Settling) -> float:
    """The last exit of the residual, and of the controls where they are asked for."""
    found = last_exit(trajectory.residual_time, trajectory.kkt, settling.tolerance)
    if settling.controls is None:
        return found
    return max(found, control_settling(trajectory, settling.controls))


def controls_of(network: Network, x: np.ndarray) -> np.ndarray:
    """(..., live control neurons) of state vectors (..., n), in the user's units.

    A network that is no optimiser has no controls; all its neurons count then.
    """
    controls = network.of_population("u")
    return network.user_units(x)[..., controls if controls.any() else slice(None)]


def control_error(controls: np.ndarray, wanted: Trajectory) -> float:
    """Largest error of controls (controls,) against the end of a run, over the largest one."""
    end = wanted.controls[-1]
    return float(np.abs(controls - end).max() / max(np.abs(end).max(), 1e-300))


def control_settling(trajectory: Trajectory, share: float = 1e-3) -> float:
    """Network time after which every control stays within ``share`` of the largest final one."""
    controls = trajectory.controls
    error = np.abs(controls - controls[-1]).max(axis=1)
    return last_exit(trajectory.time, error / max(np.abs(controls[-1]).max(), 1e-300), share)


def last_exit(time: np.ndarray, residual: np.ndarray, tolerance: float) -> float:
    """The last time at which a residual was above tolerance; nan if it still is.

    Between samples the logarithm is interpolated.

    Examples
    --------
    >>> round(last_exit(np.array([0.0, 1.0, 2.0]), np.array([1.0, 1e-2, 1e-4]), 1e-3), 3)
    1.5
    """
    above = np.flatnonzero(~(residual < tolerance))
    if above.size == 0:
        return float(time[0])
    i = int(above[-1])
    if i == len(time) - 1:
        return float("nan")
    high, low = np.log(residual[i]), np.log(max(residual[i + 1], 1e-300))
    share = (high - np.log(tolerance)) / (high - low) if np.isfinite(high) else 1.0
    return float(time[i] + share * (time[i + 1] - time[i]))
