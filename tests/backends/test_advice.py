"""Advice in messages: a network can follow it, and where it is followed the run settles."""

import pytest

from ann_dc import OdeBackend, RecurrentBackend, SpiceBackend, ode
from ann_dc.backends import Outcome
from ann_dc.errors import NetworkError
from ann_dc.network import ONE, Cell, Connection, Function, Network, Neuron, Product


def wire(source: str, target: str, weight: float = 1.0) -> Connection:
    return Connection(source=source, target=target, weight=weight)


def stiff(fast: float) -> Network:
    """A lag of one time constant, followed by one that is much faster."""
    wires = wire("x", "x", -fast), wire("y", "x", fast), wire("y", "y", -1.0), wire(ONE, "y")
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), connections=wires)
    return Network(cell=cell, stages=1, title="stiff")


def limit_cycle() -> Network:
    """Van der Pol's oscillator, which never settles."""
    blocks = Product(name="xx", a="x", b="x"), Product(name="xxy", a="xx", b="y")
    wires = wire("y", "x"), wire("x", "y", -1.0), wire("y", "y"), wire("xxy", "y", -1.0)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), blocks=blocks, connections=wires)
    return Network(cell=cell, stages=1, start={"x": 0.1}, title="limit cycle")


@pytest.mark.parametrize("method", [ode.COMPILED, ode.DOP853], ids=lambda method: method.name)
def test_stiff_network_is_told_of_an_implicit_method_that_settles(method):
    run = OdeBackend(method=method, limit=1e9, most_steps=9000, verify=False).run(stiff(1e6))
    assert run.status.outcome is Outcome.STALLED
    assert "take an implicit method: method=ann_dc.ode.RADAU or --method Radau" in str(run.status)
    assert OdeBackend(method=ode.RADAU, limit=1e9, most_steps=9000).run(stiff(1e6)).status.settled


def test_network_without_duals_is_not_told_of_a_design_or_a_pyramid():
    run = OdeBackend(limit=1e6, most_steps=9000, verify=False).run(limit_cycle())
    assert run.status.outcome is Outcome.STALLED
    assert "start elsewhere" in str(run.status)
    assert "design" not in str(run.status)
    with pytest.raises(NetworkError, match="has to settle") as error:
        SpiceBackend().run(limit_cycle())
    assert "PYRAMID" not in str(error.value)


def test_network_without_duals_is_not_told_of_more_penalty():
    """x' = -1 from 0.5 leaves the domain of sqrt; from further up it would, too, but later."""
    blocks = (Function(name="root", function="sqrt", x="x"),)
    wires = wire(ONE, "x", -1.0), wire("root", "x", 0.01)
    cell = Cell(neurons=(Neuron(name="x"),), blocks=blocks, connections=wires)
    run = RecurrentBackend().run(Network(cell=cell, stages=1, start={"x": 0.5}, title="root"))
    assert run.status.outcome is Outcome.LEFT_DOMAIN
    assert "start closer" in str(run.status)
    assert "penalty" not in str(run.status)
