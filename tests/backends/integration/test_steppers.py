"""Integration of neurons that a grid couples, at rails: every method, by closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from ann_dc.backends import ode
from ann_dc.backends.ode import METHODS, OdeBackend
from ann_dc.network.cell import ONE, Cell, Connection, Limiter, Neuron, Role
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

LOWEST = -1.0
"""Where the drive of x would take it, below its rail at zero."""
EVERY = pytest.mark.parametrize("method", METHODS.values(), ids=lambda method: method.name)


def two_neurons() -> Network:
    """x' and y' from S^{-1} (a - x, b - y), S = (1, -1/2; -1/2, 1), x at least zero, from zero."""
    wires = [
        Connection(source=source, target=target, weight=weight)
        for source, target, weight in (
            ("x", "x", -1.0), (ONE, "x", LOWEST), ("y", "y", -1.0), ("b", "y", 1.0),
        )
    ]  # fmt: skip
    neurons = (
        Neuron(name="x", role=Role.PRIMAL, limiter=Limiter(low=0.0)),
        Neuron(name="y", role=Role.PRIMAL),
        Neuron(name="m", role=Role.DUAL),  # at rest at one: the size of residuals
    )
    cell = Cell(neurons=neurons, inputs=("b",), connections=tuple(wires))
    grid = ResistiveGrid(own=np.array([[[1.0, -0.5], [-0.5, 1.0]]]), following=np.zeros((0, 2, 2)))
    return Network(cell=cell, stages=1, inputs={"b": 5.0}, start={"m": 1.0}, preconditioner=grid)


def states_at(times: np.ndarray, b: float) -> np.ndarray:
    """(2, T): y pulls x off its rail against the drive of x, later x comes back and rests."""
    M, aim = np.array([[4.0, 2.0], [2.0, 4.0]]) / 3, np.array([LOWEST, b])
    free = lambda t: aim - expm(-M * t) @ aim  # noqa: E731
    back = brentq(lambda t: free(t)[0], 0.1, 10.0, xtol=1e-14)
    y = free(back)[1]
    return np.array(
        [free(t) if t < back else (0.0, b + (y - b) * np.exp(back - t)) for t in times]
    ).T


@EVERY
def test_neuron_pulled_off_its_rail_and_back_follows_the_closed_form(method):
    run = OdeBackend(method=method, verify=False).run(two_neurons())
    assert run.status.settled
    t = np.linspace(0.1, 8.0, 30)
    expected = states_at(t, 5.0)
    assert expected[0].max() > 0.1
    assert (expected[0] == 0).any()
    np.testing.assert_allclose(run.trajectory.at(t)[:, :2].T, expected, atol=1e-4)
    np.testing.assert_allclose(run.trajectory.final[:2], [0.0, 5.0], atol=1e-7)
    assert run.evaluations < 3000


def test_batch_at_rails_settles_as_its_samples_do_alone():
    network, b = two_neurons(), np.linspace(2.5, 6.0, 20)
    batch = OdeBackend().run_batch(network, {"b": b})
    assert batch.settled.all()
    for value, end, time in zip(b, batch.states, batch.settling_times):
        alone = OdeBackend(method=ode.COMPILED, verify=False).run(network.with_inputs({"b": value}))
        np.testing.assert_allclose(end, alone.trajectory.final, atol=1e-7)
        np.testing.assert_allclose(time, alone.settling_time, rtol=1e-2)
