"""What happened in a run: states and residuals over network time, and the controls among them.

States are thinned where there are many; residuals are those of every step, for the settling time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ann_dc.backends.curves import Curves, Tabulated
from ann_dc.hints.words import such_as
from ann_dc.network.network import Network


@such_as("solution.run.trajectory")
@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory(Tabulated):
    """States over network time.

    Attributes
    ----------
    network : Network
        Whose neurons the components are.
    time : (T,) array
        Network time of the samples (every integration step, thinned where there are many).
    states : (T, n) array
        State vectors, in network units.
    residual_time : (R,) array
        Network time of every integration step.
    residuals : (R, 2) array
        Relative constraint and stationarity residuals at every integration step.
    units : mapping of str to str
        Units of measure by the neuron's name, for tables; none where nobody has told them.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> trajectory = ann_dc.OdeBackend(verify=False).run(network).trajectory
    >>> trajectory["u.a"][-1].round().astype(int).tolist()  # the user's units
    [20, 10, 0, -10, -20]
    """

    network: Network
    time: np.ndarray
    states: np.ndarray
    residual_time: np.ndarray
    residuals: np.ndarray
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def final(self) -> np.ndarray:
        """The last state vector (n,), in network units."""
        return self.states[-1]

    @property
    def kkt(self) -> np.ndarray:
        """(R,) relative KKT residual: the larger of the two."""
        return self.residuals.max(axis=1)

    @property
    def controls(self) -> np.ndarray:
        """(T, live control neurons) in the user's units."""
        return self.network.user_units(self.states)[..., _controls(self.network)]

    @property
    def control_values(self) -> np.ndarray:
        """(T, live control neurons) in network units, in which all controls count alike."""
        return control_values(self.network, self.states)

    @property
    def curves(self) -> Curves:
        """Every neuron over network time, in the user's units."""
        names = self.network.neuron_index
        return Curves(
            time=self.time,
            time_unit="unit time constants",
            neurons={name: self[name] for name in names},
            live={name: self.network.live[row] for name, row in names.items()},
            units=self.units,
            residual_time=self.residual_time,
            residuals=self.residuals,
        )

    def __getitem__(self, name: str) -> np.ndarray:
        """A neuron's states (T, N) in the user's units, by name (``mu.phi``).

        Raises
        ------
        UnknownNameError
            If the network has no such neuron.
        """
        neuron = self.network.neuron(name)
        row = self.network.neuron_index[name]
        return neuron.scale.user(self.network.unpack(self.states)[:, row])


def control_values(network: Network, x: np.ndarray) -> np.ndarray:
    """(..., live control neurons) of state vectors (..., n), in network units.

    A network that is no optimiser has no controls; all its neurons count then.

    Parameters
    ----------
    network : Network
    x : (..., n) array
        In network units.
    """
    return np.asarray(x)[..., _controls(network)]


def _controls(network: Network) -> np.ndarray | slice:
    controls = network.of_population("u")
    return controls if controls.any() else slice(None)


def control_error(controls: np.ndarray, wanted: Trajectory) -> float:
    """Largest error of controls against the end of a run, over the largest one.

    Parameters
    ----------
    controls : (controls,) array
        In network units.
    wanted : Trajectory
        The run whose last controls are right.
    """
    end = wanted.control_values[-1]
    return float(np.abs(controls - end).max() / max(np.abs(end).max(), 1e-300))
