"""Trajectory of a run: states, residuals and controls over network time.

States are thinned if there are many; residuals are those of every step, for the settling time.
States between steps are computed only when they are read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ann_dc.backends.curves import Curves, Tabulated
from ann_dc.backends.integration.methods import Between, Known
from ann_dc.dataclass_pickling import Record
from ann_dc.errors import NetworkError, such_as
from ann_dc.evaluation.rules import size_in_words, size_of
from ann_dc.network.network import Network
from ann_dc.summaries import summarised

SAMPLES = 2000
"""Number of states stored per run; larger records are thinned to every second state."""


@such_as("solution.run.trajectory")
@summarised(
    lambda self: {
        "network": self.network.title,
        "neurons": self.states.shape[-1],
        "times": len(self.time),
        "end": f"{self.time[-1]:.4g}" if len(self.time) else "",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory(Record, Tabulated):
    """States over network time.

    Attributes
    ----------
    network : Network
        Network whose neurons are the state components.
    time : (T,) array
        Network time of the samples: every integration step and its middle, or thinned steps alone
        if there are many.
    states : (T, n) array
        State vectors in network units.
    residual_time : (R,) array
        Network time of every integration step.
    residuals : (R, 2) array
        Relative constraint and stationarity residuals at every integration step.
    units : mapping of str to str
        Units of measure by neuron name, for tables; empty if no units were given.

    Examples
    --------
    >>> import ann_dc
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=5)).network
    >>> trajectory = ann_dc.OdeBackend(verify=False).run(network).trajectory
    >>> trajectory["u.a"][-1].round().astype(int).tolist()  # the user's units
    [20, 10, 0, -10, -20]
    >>> trajectory.at([0.0, 1.0]).shape == (2, network.size)  # whenever a step was
    True
    """

    network: Network
    time: np.ndarray
    states: np.ndarray
    residual_time: np.ndarray
    residuals: np.ndarray
    units: Mapping[str, str] = field(default_factory=dict)

    def with_between(self, between: Between, *, with_middles: bool = False) -> Trajectory:
        """Return the trajectory with states that are known at every time; see `at`.

        If ``with_middles`` is true, rows in the middle of steps are added when rows are first read.
        """
        made = object.__new__(type(self))
        vars(made).update(vars(self), _between=between, _known=self.known)
        if with_middles and 1 < len(self.time) <= SAMPLES // 2:
            del vars(made)["time"], vars(made)["states"]
            vars(made)["_rows"] = {}  # shared by copies that differ in units
        return made

    def measured_in(self, units: Mapping[str, str]) -> Trajectory:
        """Return the trajectory with units of measure, by neuron name."""
        made = object.__new__(type(self))
        vars(made).update(vars(self), units=units)
        return made

    def __getattr__(self, name: str) -> Any:
        """Return rows for which the middles of steps have not been computed yet."""
        if name not in ("time", "states") or "_rows" not in vars(self):
            raise AttributeError(name)
        rows = vars(self)["_rows"]
        if not rows:
            time, states = self.known
            middles = 0.5 * (time[:-1] + time[1:])
            between = vars(self)["_between"]((time, states), middles)
            is_found = np.isfinite(between).all(axis=1)
            middles, between = middles[is_found], between[is_found]
            order = np.argsort(np.concatenate([time, middles]), kind="stable")
            made = np.concatenate([time, middles])[order], np.concatenate([states, between])[order]
            rows.update(time=made[0], states=made[1])  # at once: other threads read them
        return rows[name]

    @property
    def known(self) -> Known:
        """Times and states without interpolation, at the integration steps."""
        return vars(self).get("_known") or (self.time, self.states)

    @property
    def is_dense(self) -> bool:
        """True if states are known at every time; see `at`."""
        return "_between" in vars(self) and len(self.known[0]) > 1

    def at(self, times: np.ndarray | list[float]) -> np.ndarray:
        """Return the states (K, n) at any network times (K,) of the run, in network units.

        The states are as accurate as those at the steps: gaps are integrated again by the method of
        the run, and states inside a step are those of its continuous extension. No state exceeds a
        saturation limit. A state is nan if the method fails before it in its gap.

        Raises `NetworkError` if a time is outside the run, or if only rows are known, as for a
        circuit, for recurrent steps, and for a copied or saved trajectory.
        """
        times, (known, states) = np.asarray(times, float), self.known
        if not self.is_dense:
            raise NetworkError(
                "at: the trajectory has samples only (a circuit, recurrent steps, a copy or a "
                "file); use its time and states, or run the network with OdeBackend"
            )
        if times.ndim != 1 or not ((times >= known[0]) & (times <= known[-1])).all():
            raise NetworkError(
                f"at: expected times (K,) from {known[0]:g} to {known[-1]:g}, got {times!r:.80}"
            )
        order = np.argsort(times, kind="stable")
        found = np.empty((len(times), states.shape[1]))
        if len(times):
            found[order] = vars(self)["_between"]((known, states), times[order])
        last = np.searchsorted(known, times, side="right") - 1
        is_known = known[last] == times
        found[is_known] = states[last[is_known]]
        return found

    def sampled(self, count: int = SAMPLES // 2) -> Trajectory:
        """Return the trajectory with more samples, at ``count`` equal intervals.

        They suit smooth curves and extrema. A trajectory of which only rows are known is returned
        unchanged; see `at`.
        """
        if not self.is_dense:
            return self
        between = np.linspace(self.known[0][0], self.known[0][-1], count + 1)
        time = np.union1d(self.time, between)
        return replace(self, time=time, states=self.at(time))

    @property
    def final(self) -> np.ndarray:
        """Last state vector (n,), in network units."""
        return self.known[1][-1]

    @property
    def kkt(self) -> np.ndarray:
        """Relative KKT residual (R,): the larger of the two residuals."""
        return self.residuals.max(axis=1)

    @property
    def controls(self) -> np.ndarray:
        """Controls (T, live control neurons) in the user's units."""
        return self.network.user_units(self.states)[..., _controls(self.network)]

    @property
    def control_values(self) -> np.ndarray:
        """Controls (T, live control neurons) in network units, equally weighted."""
        return control_values(self.network, self.states)

    @property
    def control_reach(self) -> float:
        """Largest magnitude of a control during the run, in network units."""
        return float(np.abs(control_values(self.network, self.known[1])).max(initial=0.0))

    @property
    def control_size(self) -> float:
        """Reference size for errors of the final controls; see `size_of`."""
        return size_of(control_values(self.network, self.final), self.control_reach)

    @property
    def size_in_words(self) -> str:
        """Description of the reference size for errors of the final controls."""
        end = control_values(self.network, self.final)
        return size_in_words(end, self.control_reach, self._offsets)

    @property
    def _offsets(self) -> str:
        """Offsets of the controls' scales with their units; empty if all are zero."""
        neurons = self.network.cell.neurons
        controls = [n for n in neurons if n.population == "u"] or neurons
        if not any(neuron.scale.offset for neuron in controls):
            return ""
        units = {n.name: self.units.get(n.name, "").removeprefix("1") for n in controls}
        reported = (f"{n.name} {n.scale.offset:.4g} {units[n.name]}".rstrip() for n in controls)
        return ", ".join(reported)

    @property
    def curves(self) -> Curves:
        """Values of every neuron over network time, in the user's units."""
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
        """Return a neuron's states (T, N) in the user's units, by name (``mu.phi``).

        Raises `UnknownNameError` if the network has no such neuron.
        """
        network, neuron = self.network, self.network.neuron(name)
        values = network.unpack(self.states)[:, network.neuron_index[name]]
        for pin in network.fixed:
            waveform = network.waveforms.get(pin.input)
            if pin.neuron == name and waveform is not None:
                given = [np.broadcast_to(waveform.at(t), network.stages) for t in self.time]
                scale = network.input_scale(pin.input)
                values[:, pin.stage] = scale.network(np.array(given)[:, pin.stage])
        return neuron.scale.user(values)


def control_values(network: Network, x: np.ndarray) -> np.ndarray:
    """Return the controls (..., live control neurons) of states (..., n), in network units.

    For a network that is not an optimiser, the result contains all its neurons.
    """
    return np.asarray(x)[..., _controls(network)]


def _controls(network: Network) -> np.ndarray | slice:
    controls = network.of_population("u")
    return controls if controls.any() else slice(None)


def control_error(controls: np.ndarray, wanted: Trajectory) -> float:
    """Return the largest error of controls against the end of the run ``wanted``.

    The error is relative to `size_of` the last controls. All are in network units.
    """
    end = control_values(wanted.network, wanted.final)
    return float(np.abs(controls - end).max() / wanted.control_size)
