"""Implicit methods where neurons reach their limits and leave them, by closed forms."""

import numpy as np
import pytest

from ann_dc import ode
from ann_dc.backends.ode import OdeBackend
from ann_dc.network.cell import ONE, Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network

IMPLICIT = [ode.RADAU, ode.BDF, ode.LSODA]


def wire(source: str, target: str, weight: float = 1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


def network(rail: float, *wires: Connection, names=("x", "y"), **start: float) -> Network:
    limited = Limiter(low=-rail, high=rail)
    neurons = tuple(Neuron(name=name, limiter=limited) for name in names)
    cell = Cell(neurons=neurons, connections=wires)
    return Network(cell=cell, stages=1, start=start, title="limits")


@pytest.mark.parametrize("method", IMPLICIT, ids=lambda method: method.name)
@pytest.mark.parametrize("rail", [0.7, 1.0, 15.0])
def test_double_integrator_with_implicit_steps_settles_at_its_limits(method, rail):
    """x' = y, y' = 1 from 0: y saturates at t = rail, x at rail^2 / 2 or after its last stretch."""
    run = OdeBackend(method=method).run(network(rail, wire("y", "x"), wire(ONE, "y")))
    assert run.status.settled
    np.testing.assert_array_equal(run.trajectory.final, [rail, rail])
    meets = np.sqrt(2 * rail) if rail < 2 else rail
    last = max(rail, meets if meets <= rail else rail + (rail - rail**2 / 2) / rail)
    np.testing.assert_allclose(run.settling_time, last, rtol=1e-4)
    assert "does NOT agree" not in run.verified


@pytest.mark.parametrize("method", IMPLICIT, ids=lambda method: method.name)
def test_integrator_with_implicit_steps_leaves_its_limit_when_its_input_turns(method):
    """x' = y, y' = -y/4 - 1/4 from (0, 1): y = 2 e^{-t/4} - 1 turns at t = 4 ln 2, x follows."""
    wires = wire("y", "x"), wire("y", "y", -0.25), wire(ONE, "y", -0.25)
    run = OdeBackend(method=method, limit=1e4).run(network(1.0, *wires, y=1.0))
    curve = run.trajectory
    t = np.linspace(4 * np.log(2) + 0.1, 4 * np.log(2) + 1.5, 8)
    expected = 1 + 8 * (0.5 - np.exp(-t / 4)) - (t - 4 * np.log(2))
    np.testing.assert_allclose(curve.at(t)[:, 0], expected, atol=100 * method.rtol)
    assert curve.states[:, 0].max() == 1.0
    np.testing.assert_array_equal(curve.final[0], -1.0)
