"""The loop to settling in onnxruntime: who stops when, and at what."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from onnx_runs import OnnxNetwork, Walk
from problems import SUITE
from random_networks import random_network
from reference import ipopt
from seeds import seeds

import ann_dc
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.cell import Cell, Connection, Function, Neuron
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind


def layer_steps(network: Network, x: np.ndarray, inputs, step: float, tolerance: float):
    """(States (B, n), steps) of the recurrent layer, stopped at the tolerance."""
    layer = ann_dc.RecurrentLayer(network, step=ann_dc.FixedStep(step=step))
    settling = ann_dc.Settling(tolerance=tolerance, confirm=1.0)
    end = layer.settle(torch.as_tensor(x), inputs, settling=settling)
    return end.states.numpy(), end.steps.numpy()


def cars(network: Network, count: int):
    """(Inputs by name, state vectors, states and inputs as tensors) of other starts and targets."""
    rng = np.random.default_rng(0)
    inputs = {"q_0.x": rng.uniform(-0.1, 0.1, count), "q_d.y": rng.uniform(4.5, 5, count)}
    every = input_batch(network, inputs)
    x = moved_starts(network, every)
    rows = [network.input_scale(name).network(every[name]) for name in network.cell.inputs]
    rows = [np.broadcast_to(row, (count, network.stages)).T for row in rows]
    return inputs, x, np.moveaxis(network.unpack(x), 0, -1), np.stack(rows)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "kind",
    [
        *(
            PreconditionerKind.MULTILEVEL,
            PreconditionerKind.RESISTIVE_GRID,
            PreconditionerKind.CYCLIC_REDUCTION,
        ),
        pytest.param(PreconditionerKind.DIAGONAL, marks=pytest.mark.slow),
        pytest.param(PreconditionerKind.COUPLED_MULTILEVEL, marks=pytest.mark.slow),
    ],
)
def test_cars_settle_after_the_steps_of_the_layer(kind):
    network = ann_dc.design(ann_dc.plants.car(), preconditioner=[kind]).network
    step, (inputs, x, states, given) = reference_vector(network).step, cars(network, 8)
    expected, steps = layer_steps(network, x, inputs, step / 2, 1e-3)
    onnx = OnnxNetwork(network)
    found, residual, counts = onnx.settle(states, step / 2, tolerance=1e-3, inputs=given)
    np.testing.assert_array_equal(counts, steps)
    assert len(set(steps)) > 1
    assert residual.max() < 1e-3
    packed = network.pack(np.moveaxis(found, -1, 0))
    np.testing.assert_allclose(packed, expected, rtol=0, atol=1e-10)


def test_in_float32_nearly_all_do(car, vector):
    inputs, x, states, given = cars(car, 200)
    expected, steps = layer_steps(car, x, inputs, vector.step, 1e-3)
    found, _, counts = OnnxNetwork(car, "float32").settle(
        states, vector.step, tolerance=1e-3, inputs=given
    )
    assert np.mean(counts == steps) >= 0.99
    packed = car.pack(np.moveaxis(found, -1, 0).astype(float))
    np.testing.assert_allclose(packed, expected, rtol=0, atol=1e-3)


@pytest.mark.parametrize(
    ("precision", "tolerance", "close"), [("float64", 1e-9, 1e-6), ("float32", 1e-5, 1e-3)]
)
def test_the_car_settles_at_ipopts_optimum(car, vector, precision, tolerance, close):
    states, residual, _ = OnnxNetwork(car, precision).settle(
        vector.start[..., None], vector.step, tolerance=tolerance
    )
    assert residual < tolerance
    factor, offset = car.cell.scales.T[:, :, None]
    values = dict(zip(car.neuron_index, offset + factor * states[..., 0]))
    optimum = ipopt(ann_dc.plants.car())
    found = np.array([values[name] for name in values if name.startswith("u.")])
    np.testing.assert_allclose(found, optimum.u, rtol=0, atol=close * np.abs(optimum.u).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", SUITE)
def test_the_suite_settles(name):
    network = ann_dc.design(SUITE[name].problem).network
    vector = reference_vector(network)
    scale = max(1.0, np.abs(vector.end).max())
    left = (
        1e-2 if network.preconditioner.kind is PreconditionerKind.RESISTIVE_GRID else 1e-4
    )  # a grid's moves amplify rounding
    precisions = ("float64", 1e-6, 1e-6, 1e-5), ("float32", 1e-4, left, 1e-2)
    for precision, tolerance, most, close in precisions:
        onnx = OnnxNetwork(network, precision)
        states, residual, _ = onnx.settle(vector.start[..., None], vector.step, tolerance=tolerance)
        assert residual < most
        assert np.abs(states[..., 0] - vector.end).max() < close * scale


CART = ann_dc.plants.double_integrator(N=5)
LIMITS = {CART.controls[0]: (-23.5, 23.5)}
PLACE, PACE = CART.states
SPECIAL = {
    "largest": replace(CART, cost=0, objectives=(CART.cost, PLACE**2)),
    "softened": replace(CART, cost=0, objectives=(CART.cost, PLACE**2), temperature=0.1),
    "held": replace(CART, constraints={"pace": PACE <= 2.7}, bounds=LIMITS),
    "priced": replace(
        CART,
        constraints={"pace": PACE <= 2.7},
        soft={"pace": ann_dc.Soft(weight=5, compliance=0.01)},
    ),
}
"""Shared neurons, diodes, rails."""


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    "name",
    [
        "largest",
        "priced",
        pytest.param("held", marks=pytest.mark.slow),
        pytest.param("softened", marks=pytest.mark.slow),
    ],
)
def test_shared_neurons_diodes_and_rails_settle(name):
    network = ann_dc.design(SPECIAL[name]).network
    vector = reference_vector(network)
    found, _, steps = OnnxNetwork(network).settle(vector.start[..., None], vector.step)
    assert steps == vector.steps > 0
    np.testing.assert_allclose(found[..., 0], vector.end, rtol=0, atol=1e-9)


@pytest.mark.sampled(3)
@seeds(6)
def test_samples_stop_one_by_one(seed):
    network = random_network(seed)
    rng = np.random.default_rng(seed)
    starts = network.start_state + rng.uniform(-0.1, 0.1, (4, network.size))
    states = np.moveaxis(network.unpack(starts), 0, -1)
    found, residual, steps = OnnxNetwork(network).settle(states, 0.1, tolerance=0.3, limit=40)
    for sample, start in enumerate(starts):
        walk = Walk(network, start, 0.1)
        end = walk.settle(0.3, 40)
        assert (steps[sample], residual[sample]) == (walk.count, pytest.approx(end, rel=1e-6))
        if np.isfinite(end):
            np.testing.assert_allclose(found[..., sample], walk.states, rtol=1e-8, atol=1e-8)


def test_a_limit_of_zero_says_how_far_the_start_is(car, vector):
    states, residual, steps = OnnxNetwork(car).settle(vector.start[..., None], 0.1, limit=0)
    np.testing.assert_array_equal(states[..., 0], vector.start)
    walk = Walk(car, car.start_state, 0.1)
    assert (steps, residual) == (0, pytest.approx(walk.residual(), rel=1e-12))


def drifting(function: str, rate: float, start: float = 1.0) -> OnnxNetwork:
    """x' = rate, and a neuron that reads g(x)."""
    cell = Cell(
        neurons=(Neuron(name="x"), Neuron(name="y")),
        blocks=(Function(name="value", function=function, x="x"),),
        connections=(
            Connection(source="one", target="x", weight=rate),
            Connection(source="value", target="y"),
        ),
    )
    return OnnxNetwork(Network(cell=cell, stages=2, start={"x": start}))


@pytest.mark.parametrize("function", ["log", "sqrt", "reciprocal"])
def test_a_sample_that_leaves_a_domain_stops_there(function):
    onnx = drifting(function, -0.4)
    states = np.array([[[1.0, 9.0]] * 2, [[0.0, 0.0]] * 2])
    found, residual, steps = onnx.settle(states, 1.0, limit=10)
    assert residual[0] == np.inf
    assert (found[0, 0, 0], steps[0]) == (pytest.approx(-0.2), 3)
    assert np.isfinite(residual[1])
    assert steps[1] == 10


def test_a_reciprocal_may_start_on_either_side_of_its_pole():
    onnx = drifting("reciprocal", -0.4, start=-1.0)
    _, residual, steps = onnx.settle(onnx.network.unpack(onnx.network.start_state)[..., None], 1.0,
                                     limit=10)  # fmt: skip
    assert np.isfinite(residual)
    assert steps == 10


def test_a_sample_that_diverges_stops(car):
    cell = Cell(
        neurons=(Neuron(name="x"),),
        connections=(Connection(source="x", target="x", weight=1.0),),
    )
    onnx = OnnxNetwork(Network(cell=cell, stages=1, start={"x": 1.0}))
    found, residual, steps = onnx.settle(np.array([[[1.0, 0.0]]]), 1.0)
    assert residual.tolist() == [np.inf, 0.0]
    assert steps.tolist() == [30, 0]
    assert found[0, 0].tolist() == [2.0**30, 0.0]


def test_a_pin_may_lie_beyond_the_rails():
    network = random_network(70)
    low = replace(network, inputs={name: np.full(network.stages, 5.0) for name in network.inputs})
    start = low.unpack(low.start_state)[..., None]
    following, _ = OnnxNetwork(low).step(start, 0.1)
    assert following[low.neuron_index["q.a"], 0, 0] == 5.0
