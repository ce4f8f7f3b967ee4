"""Predicted settling: closed forms of hand-wired networks, then runs of plants and their chips."""

import numpy as np
import pytest
from designs import designed
from scipy.optimize import brentq

from ann_dc.analysis.predicted_settling import predicted_settling
from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import NetworkError
from ann_dc.hardware.nonidealities.numbers import detuned, mismatch
from ann_dc.network.cell import Cell, Connection, Function, Limiter, Neuron, Product, Sum, Template
from ann_dc.network.network import Network

TOLERANCE = 1e-6


def wire(source: str, target: str, weight=1.0, template=Template.SELF) -> Connection:
    return Connection(source=source, target=target, weight=weight, template=template)


def row(*connections: Connection, names=("x",), stages=1, blocks=(), **fields) -> Network:
    neurons = tuple(Neuron(name=name) for name in names)
    cell = Cell(neurons=neurons, connections=connections, blocks=blocks)
    return Network(cell=cell, stages=stages, **fields)


def test_one_neuron_settles_as_an_exponential():
    network = row(wire("x", "x", -2.0))
    found = predicted_settling(network, np.zeros(1), np.ones(1), TOLERANCE)
    assert found == pytest.approx(np.log(2 / TOLERANCE) / 2, rel=2e-3)
    assert found > predicted_settling(network, np.zeros(1), np.ones(1), 1e-3) > 0


def test_an_oscillation_exits_at_its_last_peak():
    """x' = -0.1 x + y, y' = -x - 0.1 y: the state turns and shrinks."""
    wires = (wire("x", "x", -0.1), wire("y", "x"), wire("x", "y", -1.0), wire("y", "y", -0.1))
    network = row(*wires, names=("x", "y"))
    found = predicted_settling(network, np.zeros(2), np.array([1.0, 0.0]), TOLERANCE)
    times = np.linspace(0, 300, 3_000_001)
    state = np.exp(-0.1 * times) * np.array([np.cos(times), -np.sin(times)])
    drives = np.array([-0.1 * state[0] + state[1], -state[0] - 0.1 * state[1]])
    expected = times[np.flatnonzero(np.abs(drives).max(axis=0) >= TOLERANCE)[-1]]
    assert found == pytest.approx(expected, rel=5e-3)


def test_modes_that_cannot_be_told_apart():
    """A chain of lags has one eigenvalue and one vector: drives are e^{-t} t^k / k!."""
    chain = row(wire("x", "x", -1.0), wire("x", "x", template=Template.PREVIOUS), stages=3)
    found = predicted_settling(chain, np.zeros(3), np.array([1.0, 0.0, 0.0]), TOLERANCE)
    slopes = lambda t: np.exp(-t) * np.array([1, t - 1, t**2 / 2 - t])  # noqa: E731
    expected = brentq(lambda t: np.abs(slopes(t)).max() - TOLERANCE, 10.0, 40.0)
    assert found == pytest.approx(expected, rel=5e-3)


def bent(x0: float) -> tuple[Network, float]:
    """x' = -x - x^2 and its settling: x = x_0 e^{-t} / (1 + x_0 (1 - e^{-t}))."""
    network = row(
        wire("x", "x", -1.0), wire("xx", "x", -1.0), blocks=(Product(name="xx", a="x", b="x"),)
    )
    state = lambda t: x0 * np.exp(-t) / (1 + x0 * (1 - np.exp(-t)))  # noqa: E731
    return network, brentq(lambda t: abs(state(t) + state(t) ** 2) - TOLERANCE, 5.0, 30.0)


@pytest.mark.parametrize("x0", [-0.7, 0.3, 3.0, 50.0])
def test_a_way_that_is_not_linear_leaves_less_or_more(x0):
    """Of x_0 e^{-t} it leaves the share 1 / (1 + x_0)."""
    network, expected = bent(x0)
    linear = predicted_settling(network, np.zeros(1), np.array([x0]), linear=True)
    assert linear - expected == pytest.approx(np.log(1 + x0), abs=0.02)
    found = predicted_settling(network, np.zeros(1), np.array([x0]))
    assert found - expected == pytest.approx(0.0, abs=0.02)


def test_steps_that_leave_a_domain_are_not_believed():
    """x' = -x + 9 log(1 + x / 10), begun at -9.9."""
    wires = (
        wire("x", "x", -1.0), wire("x", "inside", 0.1), wire("one", "inside"),
        wire("log", "x", 9.0),
    )  # fmt: skip
    blocks = (Sum(name="inside"), Function(name="log", function="log", x="inside"))
    network = row(*wires, blocks=blocks)
    found = [
        predicted_settling(network, np.zeros(1), np.array([-9.9]), linear=linear)
        for linear in (True, False)
    ]
    assert found[0] == found[1] > 0
    assert np.isnan(predicted_settling(network, np.zeros(1), np.array([-10.1])))


def test_a_neuron_at_its_rail_takes_no_part():
    neurons = (Neuron(name="x"), Neuron(name="y", limiter=Limiter(high=1.0)))
    wires = (wire("x", "x", -1.0), wire("one", "y", 0.01))
    network = Network(cell=Cell(neurons=neurons, connections=wires), stages=1)
    found = predicted_settling(network, np.array([0.0, 1.0]), np.array([1.0, 1.0]), TOLERANCE)
    assert found == pytest.approx(np.log(1 / TOLERANCE), rel=2e-3)


def test_what_does_not_settle_has_no_time():
    network = row(wire("x", "x", 1.0))
    assert np.isnan(predicted_settling(network, np.zeros(1), np.ones(1)))
    settled = row(wire("x", "x", -1.0))
    assert predicted_settling(settled, np.zeros(1), np.zeros(1)) == 0.0
    long = row(wire("x", "x", -1.0), stages=1501)
    with pytest.raises(NetworkError, match="got 1501"):
        predicted_settling(long, np.zeros(1501), np.ones(1501))


@pytest.mark.parametrize(
    ("name", "close"),
    [
        ("double_integrator", 0.01),
        pytest.param("unicycle", 0.02, marks=pytest.mark.slow),
        pytest.param("car", 0.05, marks=pytest.mark.slow),
        pytest.param("pendulum", 0.1, marks=pytest.mark.slow),
    ],
)
def test_runs_take_about_as_long(name, close):
    """The farther from linear the way is, the less is known; `bench.studies` has more of them."""
    network = designed(name).network
    for seed in range(3):
        chip = mismatch(detuned(network, 0.02, seed=seed), 0.005, seed=seed)
        run = OdeBackend(verify=False).run(chip)
        found = predicted_settling(chip, run.trajectory.final, chip.start_state)
        assert found == pytest.approx(run.settling_time, rel=close)
