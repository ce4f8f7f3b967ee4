"""What a run gives back: outcomes are data, whatever the backend."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from ann_dc.network.network import Network


class Outcome(enum.Enum):
    """How a run ended; the value is the sentence that a user reads."""

    SETTLED = "settled: the KKT residual stays below tolerance"
    NOT_SETTLED = "not settled within the time given"
    DIVERGED = "diverged"
    LEFT_DOMAIN = "left the domain of a function block"


@dataclass(frozen=True, kw_only=True, eq=False)
class Status:
    """How a run ended, where and when.

    Attributes
    ----------
    outcome : Outcome
    message : str
        The whole sentence, with names and numbers.
    neuron : str or None
        The neuron (or block) that diverged or left its domain.
    time : float
        Network time at which the run ended.
    """

    outcome: Outcome
    message: str
    neuron: str | None
    time: float

    @property
    def settled(self) -> bool:
        """Whether the run settled."""
        return self.outcome is Outcome.SETTLED

    def __str__(self) -> str:
        return self.message


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
        Integration steps and right-hand sides.
    """

    trajectory: Trajectory
    status: Status
    tolerance: float
    settling_time: float
    verified: str
    steps: int
    evaluations: int


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
