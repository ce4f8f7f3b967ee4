"""Samples with weights and time constants of their own: each as its own network, run alone."""

from dataclasses import replace

import minimax
import numpy as np
import pytest
from designs import designed, wired_with
from random_preconditioners import with_stiffness

import ann_dc
from ann_dc.backends.batch import BatchRun
from ann_dc.backends.ode import BATCHES
from ann_dc.backends.status import Outcome
from ann_dc.backends.step_rules import ORDERS
from ann_dc.errors import NetworkError
from ann_dc.evaluation.variant_numbers import Numbers, numbers_of
from ann_dc.hardware.nonidealities.numbers import detuned, leak, mismatch, offset
from ann_dc.hardware.nonidealities.parts import extra_pole, saturation, slew
from ann_dc.network.cell import Cell, Connection, Function, Neuron, Sum
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

STEP = ann_dc.FixedStep(step=1e-3)


def drawn(network: Network, count: int, size: float = 0.02) -> list[Network]:
    return [mismatch(detuned(network, size, seed=s), size, seed=s) for s in range(count)]


def spoiled(name: str) -> Network:
    """With parts that the design did not have: leaks, offsets, poles, clipped drives, rails."""
    network = offset(leak(wired_with(name, PreconditionerKind.DIAGONAL), 1e3), 1e-3, seed=4)
    return saturation(slew(extra_pole(network, 50.0), 20.0), 50.0)


def shared() -> Network:
    """Three cells with neurons on a bus."""
    return ann_dc.synthesize(minimax.small(3))


def by_hand() -> Network:
    """x' = 1 / (x - 0.1 y) - x and y' = x - y; weights are plus and minus one, or not."""
    wires = (("x", "s", 1.0), ("y", "s", -0.1), ("g", "x", 1.0), ("x", "x", -1.0), ("x", "y", 1.0))
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y", tau=(0.5, 0.7))),
        blocks=(Sum(name="s"), Function(name="g", function="reciprocal", x="s")),
        connections=(
            *(Connection(source=s, target=t, weight=w) for s, t, w in wires),
            Connection(source="y", target="y", weight=np.array([-1.0, -2.0])),
        ),
    )
    return Network(cell=cell, stages=2, start={"x": 2.0, "y": 1.0})


NETWORKS = {
    "time constants": lambda: wired_with("van_der_pol", PreconditionerKind.DIAGONAL),
    "pyramid": lambda: wired_with("pendulum", PreconditionerKind.MULTILEVEL),
    "coupled pyramid": lambda: wired_with("unicycle", PreconditionerKind.COUPLED_MULTILEVEL),
    "grid": lambda: wired_with("car", PreconditionerKind.RESISTIVE_GRID),
    "tree, odd": lambda: with_stiffness(
        ann_dc.synthesize(ann_dc.plants.cart_pole(N=3)), PreconditionerKind.CYCLIC_REDUCTION
    ),
    "long pyramid": lambda: designed("car_N36").network,
    "defects": lambda: spoiled("double_integrator"),
    "bus": shared,
    "by hand": by_hand,
}


LONG = ("defects", "pyramid", "coupled pyramid", "long pyramid", "tree, odd")
"""Networks whose every order takes seconds."""

ORDERED = [
    pytest.param(name, order, marks=pytest.mark.slow if name in LONG else ())
    for name in NETWORKS
    for order in ORDERS.values()
    if (name, order) != ("bus", ann_dc.STAGE_BY_STAGE)  # what is on a bus has no order by stages
]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "order"), ORDERED, ids=str)
def test_every_step_is_that_of_the_network_alone_to_rounding(name, order):
    network = NETWORKS[name]()
    networks = drawn(network, 3)
    backend = ann_dc.RecurrentBackend(order=order, step=STEP, limit=20)
    batch = backend.run_batch(network, {}, numbers=numbers_of(networks))
    scale = np.abs(batch.states).max()
    apart = np.abs(batch.states - backend.run_batch(network, {}).states).max(axis=1)
    for sample, own in enumerate(networks):
        alone = backend.run_batch(own, {})
        np.testing.assert_allclose(batch.states[sample], alone.states[0], atol=1e-12 * scale)
        np.testing.assert_allclose(batch.residuals[sample], alone.residuals[0], rtol=1e-8)
        assert apart[sample] > 1e-8 * scale


@pytest.mark.parametrize("name", ["car", "pendulum"])
def test_a_sample_settles_as_alone(name):
    network = designed(name).network
    networks = drawn(network, 3)
    backend = ann_dc.OdeBackend(curves=20)
    batch = backend.run_batch(network, {}, numbers=numbers_of(networks))
    assert batch.settled.all()
    for sample, own in enumerate(networks):
        alone = ann_dc.OdeBackend(method=BATCHES, verify=False).run(own)
        assert batch.settling_times[sample] == pytest.approx(alone.settling_time, rel=2e-3)
        scale = np.abs(alone.trajectory.final).max()
        np.testing.assert_allclose(batch.states[sample], alone.trajectory.final, atol=1e-7 * scale)
        both = numbers_of([own, batch.network_of(sample)]).weights
        np.testing.assert_array_equal(both[0], both[1])
        np.testing.assert_array_equal(batch.trajectory(sample).final, batch.states[sample])


def same(a: BatchRun, b: BatchRun, of=slice(None)) -> None:
    """Bit for bit, of some samples of the first."""
    for name in ("states", "steps", "settling_steps", "settling_times", "residuals"):
        np.testing.assert_array_equal(getattr(a, name)[of], getattr(b, name), err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("make", [ann_dc.OdeBackend, ann_dc.RecurrentBackend])
def test_the_bits_of_a_sample_depend_on_nothing_beside_it(make):
    network = designed("double_integrator").network
    numbers = ann_dc.nonidealities.drawn_numbers(
        network, range(150), weights=0.01, time_constants=0.01
    )
    whole = make().run_batch(network, {}, numbers=numbers)
    assert whole.settled.mean() > 0.9
    same(whole, make().run_batch(network, {}, numbers=numbers[40:53]), slice(40, 53))
    same(whole, make().run_batch(network, {}, numbers=numbers[::-1]), slice(None, None, -1))
    if make is ann_dc.OdeBackend:
        for threads in (1, 2):
            same(whole, make(threads=threads).run_batch(network, {}, numbers=numbers))


def test_a_sample_that_fails_leaves_nothing_behind():
    """One whose weights make it diverge, in a row with a cell more on one side."""
    network = wired_with("car", PreconditionerKind.RESISTIVE_GRID)
    numbers = numbers_of([network, *drawn(network, 19)])
    wild = numbers.weights.copy()
    wild[3] *= -1e3
    good = np.setdiff1d(np.arange(20), [3])
    backend = ann_dc.OdeBackend(threads=1, most_steps=500)
    batch = backend.run_batch(network, {}, numbers=Numbers(weights=wild, rates=numbers.rates))
    same(batch, backend.run_batch(network, {}, numbers=numbers[good]), good)
    assert not batch.settled[3]


@pytest.mark.slow
def test_numbers_go_with_inputs_and_starts():
    network = designed("double_integrator").network
    (own,) = drawn(network, 1, size=0.05)
    targets = {"q_d.x": np.array([0.5, 1.0, 1.5])}
    backend = ann_dc.OdeBackend()
    batch = backend.run_batch(network, targets, numbers=numbers_of([own]))
    alone = backend.run_batch(own, targets)
    np.testing.assert_allclose(batch.states, alone.states, atol=1e-7 * np.abs(alone.states).max())
    np.testing.assert_array_equal(batch.network_of(-1).inputs["q_d.x"], 1.5)
    with pytest.raises(NetworkError, match="numbers: sizes of the batch differ"):
        backend.run_batch(network, targets, numbers=numbers_of([network, own]))


def test_a_side_is_that_of_the_samples_own_weights():
    """1 / s with s = w x: the sample of the other sign begins on the other side of the pole."""
    wires = (("x", "s", 1.0), ("g", "x", 0.2), ("x", "x", -1.0), ("one", "x", 1.0))
    cell = Cell(
        neurons=(Neuron(name="x"),),
        blocks=(Sum(name="s"), Function(name="g", function="reciprocal", x="s")),
        connections=tuple(Connection(source=s, target=t, weight=w) for s, t, w in wires),
    )
    network = Network(cell=cell, stages=1, start={"x": 1.0})
    turned = replace(cell.connections[0], weight=-1.0)
    other = replace(network, cell=replace(cell, connections=(turned, *cell.connections[1:])))
    batch = ann_dc.OdeBackend().run_batch(network, {}, numbers=numbers_of([network, other]))
    assert list(batch.outcomes) == [Outcome.SETTLED] * 2
    rest = [(1 + np.sqrt(1 + 0.8)) / 2, (1 + np.sqrt(1 - 0.8)) / 2]
    np.testing.assert_allclose(batch.states[:, 0], rest, atol=1e-6)


def test_layers_take_no_numbers():
    network = designed("double_integrator").network
    backend = ann_dc.RecurrentBackend(acceleration=ann_dc.Anderson())
    with pytest.raises(NetworkError, match="numbers: only generated code"):
        backend.run_batch(network, {}, numbers=numbers_of([network]))
