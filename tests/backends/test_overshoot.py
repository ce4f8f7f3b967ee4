"""How far controls go beyond their end, on curves that are known."""

import numpy as np
import pytest

from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.overshoot import overshoot
from ann_dc.backends.trajectory import Trajectory
from ann_dc.network.cell import ONE, Cell, Connection, Neuron
from ann_dc.network.network import Network

NETWORK = Network(cell=Cell(neurons=(Neuron(name="u.a"), Neuron(name="u.b"))), stages=1)


def curve(a, b) -> Trajectory:
    states = np.column_stack([np.asarray(a, float), np.asarray(b, float)])
    time = np.arange(len(states), dtype=float)
    return Trajectory(
        network=NETWORK, time=time, states=states, residual_time=time, residuals=0 * states
    )


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        ([0, 1, 2], [0, 2, 4], 0.0),
        ([0, 3, 2], [0, 2, 4], 0.25),
        ([0, -3, -2], [0, 2, 4], 0.25),
        ([0, -3, 2], [0, 2, 4], 0.0),
        ([1, 3, 1], [0, 2, 4], 0.5),
        ([5, 1, 2], [0, 5, 4], 0.25),
    ],
    ids=["none", "above", "below", "away from its end", "back where it starts", "the largest"],
)
def test_it_is_the_largest_excursion_beyond_an_end(a, b, expected):
    assert overshoot(curve(a, b)) == expected


def test_it_does_not_depend_on_the_size_of_controls():
    a, b = np.array([0.0, 3.0, 2.0]), np.array([0.0, 2.0, 4.0])
    assert overshoot(curve(1e-6 * a, 1e-6 * b)) == pytest.approx(0.25)


def test_peak_between_steps_is_that_of_a_damped_oscillation():
    """u'' = -4 u' - 100 (u - 1) goes beyond one by e^(-pi z / sqrt(1 - z^2)), z = 0.2."""
    wires = [("v", "u.x", 1.0), ("u.x", "v", -100.0), ("v", "v", -4.0), (ONE, "v", 100.0)]
    cell = Cell(
        neurons=(Neuron(name="u.x"), Neuron(name="v")),
        connections=tuple(Connection(source=a, target=b, weight=w) for a, b, w in wires),
    )
    run = OdeBackend(verify=False).run(Network(cell=cell, stages=1, start={"u.x": 0.0}))
    expected = np.exp(-0.2 * np.pi / np.sqrt(1 - 0.2**2))
    assert overshoot(run.trajectory) == pytest.approx(expected, rel=3e-3)
