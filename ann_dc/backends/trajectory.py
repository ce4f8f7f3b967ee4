"""What happened in a run: states and residuals over network time, and the controls among them.

States are thinned where there are many; residuals are those of every step, for the settling time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.network.network import Network


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
