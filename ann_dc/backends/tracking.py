"""Tracking error of a network that follows inputs over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.trajectory import Trajectory, control_values
from ann_dc.evaluation.rules import size_of
from ann_dc.network.network import Network
from ann_dc.validation import Count, checked

SAMPLES = 100
"""Number of times at which the optimum of the moment is computed."""


class Tracking(NamedTuple):
    """Network times (K,) and errors (K,) of the controls, relative to the optimum of the time."""

    time: np.ndarray
    error: np.ndarray

    @property
    def rms(self) -> float:
        """Root mean square of the error over the second half of the times, without the approach."""
        late = self.error[self.time >= 0.5 * self.time[-1]]
        return float(np.sqrt((late**2).mean()))


@checked
def tracking_error(
    trajectory: Trajectory, samples: Count = SAMPLES, *, ideal: Network | None = None
) -> Tracking:
    """Return the errors of the controls against the optimum of every moment's inputs.

    The optimum is the equilibrium of the network with the constant inputs of that time, found by
    Newton's method from the end backward. An error is the largest
    difference of a control, relative to the largest control of the optimum; see `size_of`.

    Parameters
    ----------
    trajectory : Trajectory
        Run of a network, with inputs over time.
    samples : int
        Number of times, evenly spread over the run. Default 100.
    ideal : Network, optional
        Network of equal size whose equilibria are the optimum, for a run of one with
        non-idealities; by default the network that ran.

    Raises
    ------
    NetworkError
        If Newton's method finds no equilibrium at a time.

    Examples
    --------
    A low-pass follows a ramp with a lag of one time constant:

    >>> import ann_dc
    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = (
    ...     Connection(source="x", target="x", weight=-1.0), Connection(source="u", target="x")
    ... )
    >>> cell = Cell(neurons=(Neuron(name="x"),), inputs=("u",), connections=wires)
    >>> ramp = ann_dc.Waveform(times=[0.0, 20.0], values=[10.0, 30.0])
    >>> network = Network(cell=cell, stages=1, inputs={"u": 10.0}, start={"x": 10.0})
    >>> run = ann_dc.OdeBackend(duration=20.0).run(network.with_inputs({"u": ramp}))
    >>> found = tracking_error(run.trajectory)
    >>> float(round(found.error[-1] * 30, 6))
    1.0
    """
    network, grid = (
        ideal or trajectory.network,
        np.linspace(0, trajectory.time[-1], samples + 1)[1:],
    )
    states, errors = _states_at(trajectory, grid), []
    best = states[-1]
    if ideal is not None:
        best = OdeBackend(verify=False).run(ideal.at_time(float(grid[-1]))).trajectory.final
    for time, x in zip(grid[::-1], states[::-1]):
        now = network.at_time(float(time))
        best = equilibrium(now, best)
        end = control_values(now, best)
        size = size_of(end, float(np.abs(end).max(initial=0.0)))
        errors.append(np.abs(control_values(now, x) - end).max() / size)
    return Tracking(grid, np.array(errors[::-1]))


def _states_at(trajectory: Trajectory, times: np.ndarray) -> np.ndarray:
    """Return states (K, n) at times (K,); interpolated between rows for a circuit."""
    if trajectory.is_dense:
        return trajectory.at(times)
    return np.array([np.interp(times, trajectory.time, x) for x in trajectory.states.T]).T
