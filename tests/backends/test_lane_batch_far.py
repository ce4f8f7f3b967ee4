"""Batches of networks with wires beyond neighbours: Lorenz-96 as an array and as a ring."""

import numpy as np
import pytest
from oscillators import reference
from scipy.integrate import solve_ivp

import ann_dc
from ann_dc.backends import ode
from ann_dc.backends.integration.systems import Cells
from ann_dc.backends.recurrent import backend as recurrent_backend
from ann_dc.backends.step_rules import ORDERS
from ann_dc.evaluation.variant_numbers import numbers_of
from ann_dc.hardware.nonidealities.numbers import mismatch
from ann_dc.network import Cell, Connection, Network, Neuron, Product, Sum, Waveform

OFFSETS = {"Lorenz-96": (1, -2, -1), "wide": (-5, 2, 4), "across": (7, -3, -9)}
TIGHT = ode.COMPILED.tighter(1e4)


def array(stages: int, offsets: tuple, *, is_ring: bool = False, more: float = 0.0) -> Network:
    """x_k' = (x_{k+a} - x_{k+b}) x_{k+c} - x_k + F; a ring reaches round the end of the row.

    With ``more``, x_k reads the product of x_{k+3} as well.
    """
    wires = [Connection(source="x", target="x", weight=-1.0), Connection(source="F", target="x")]
    wires += [Connection(source="p", target="x")]
    wires += [Connection(source="p", target="x", weight=more, template=3)] if more else []
    for offset, target, weight in zip(offsets, ("d", "d", "c"), (1.0, -1.0, 1.0)):
        rounds = (0, stages if offset < 0 else -stages) if is_ring else (0,)
        wires += [
            Connection(source="x", target=target, weight=weight, template=offset + turn)
            for turn in rounds
        ]
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("F",),
        blocks=(Sum(name="d"), Sum(name="c"), Product(name="p", a="d", b="c")),
        connections=tuple(wires),
    )
    start = 1.0 + 0.1 * np.arange(stages)
    return Network(
        cell=cell, stages=stages, inputs={"F": 2.0}, start={"x": start}, title="Lorenz-96"
    )


def scipys(network: Network, offsets, duration: float, x, force) -> np.ndarray:
    """End of an open array, by SciPy."""

    def at(x, offset):
        padded = np.pad(x, 10)
        return padded[10 + offset : 10 + offset + len(x)]

    def slope(_, x):
        a, b, c = (at(x, offset) for offset in offsets)
        return (a - b) * c - x + force

    tolerances = {"rtol": 1e-11, "atol": 1e-13}
    return solve_ivp(slope, (0, duration), x, "DOP853", **tolerances).y[:, -1]


@pytest.mark.sampled(6)
@pytest.mark.parametrize("stages", [2, 5, 8, 13])
@pytest.mark.parametrize("name", OFFSETS)
def test_arrays_are_scipys(name, stages):
    offsets, duration = OFFSETS[name], 1.5
    network = array(stages, offsets)
    forces = np.linspace(0.5, 2.5, 11)
    x = network.start_state * np.linspace(0.8, 1.1, 11)[:, None]
    backend = ann_dc.OdeBackend(duration=duration, method=TIGHT, cells=Cells.GENERATED)
    batch = backend.run_batch(network, {"F": forces}, x=x)
    for sample in range(0, 11, 5):
        wanted = scipys(network, offsets, duration, x[sample], forces[sample])
        np.testing.assert_allclose(batch.states[sample], wanted, rtol=1e-8, atol=1e-9)
    alone = backend.run(network).trajectory.final
    wanted = scipys(network, offsets, duration, network.start_state, 2.0)
    np.testing.assert_allclose(alone, wanted, rtol=1e-8, atol=1e-9)


def test_a_ring_is_scipys():
    network = array(8, OFFSETS["Lorenz-96"], is_ring=True).with_inputs({"F": 8.0})
    starts = 8.0 + 0.1 * np.random.default_rng(2).standard_normal((9, 8))
    batch = ann_dc.OdeBackend(duration=2.0, method=TIGHT).run_batch(network, {}, x=starts)
    for start, found in zip(starts, batch.states):
        np.testing.assert_allclose(found, reference(network, 2.0, start)(2.0), atol=5e-6)


def test_samples_have_numbers_and_waveforms_of_their_own():
    network = array(13, OFFSETS["wide"], more=0.2)
    networks = [mismatch(network, 0.05, seed=seed) for seed in range(3)]
    wave = Waveform(times=[0.0, 1.0], values=[[1.0, 2.0, 3.0], [2.0, 1.0, 0.0]])
    backend = ann_dc.OdeBackend(duration=1.5, method=TIGHT)
    batch = backend.run_batch(network, {"F": wave}, numbers=numbers_of(networks))
    for sample in range(3):
        alone = backend.run(batch.network_of(sample)).trajectory.final
        np.testing.assert_allclose(batch.states[sample], alone, rtol=1e-7)
    assert np.ptp(batch.states) > 0.1


@pytest.mark.parametrize("order", ORDERS.values(), ids=str)
def test_recurrent_steps_are_those_of_the_layers(monkeypatch, order):
    network = array(13, OFFSETS["wide"], more=0.2)
    backend = ann_dc.RecurrentBackend(order=order, step=ann_dc.FixedStep(step=0.02), limit=40)
    code = backend.run_batch(network, {"F": [0.5, 1.0, 2.0]})
    monkeypatch.setattr(recurrent_backend, "refusal", lambda *_: "no code")
    layers = backend.run_batch(network, {"F": [0.5, 1.0, 2.0]})
    np.testing.assert_allclose(code.states, layers.states, rtol=1e-10)
    np.testing.assert_allclose(code.residuals, layers.residuals, rtol=1e-9)
