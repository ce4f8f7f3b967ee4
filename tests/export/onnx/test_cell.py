"""Steps of random networks in onnxruntime, against NumPy's evaluator."""

import numpy as np
import pytest
from clamped_runs import (
    OF_RUNS,
    rails_of,
    resting_at_rails,
    run_with_changes,
    unrailed,
    with_limits,
)
from designs import wired_with
from hypothesis import given, settings, strategies as st
from onnx_runs import OnnxNetwork, Walk
from random_networks import far_wired, random_network

from ann_dc.evaluation.reference import evaluator
from ann_dc.export.onnx.check import onnx_check
from ann_dc.export.onnx.files import onnx_files
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

STEP = 0.1
SEEDS = st.integers(0, 2**32 - 1)


def some_states(network: Network, seed: int, samples: int) -> np.ndarray:
    """State vectors (B, n) between the rails."""
    rng = np.random.default_rng(seed)
    limits = [(neuron.limiter.low, neuron.limiter.high) for neuron in network.cell.neurons]
    low, high = np.array(limits)[network.places[:, 0]].T
    spread = rng.uniform(-0.8, 0.8, (samples, network.size))
    return np.clip(network.start_state + spread, low, high)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, kind=st.sampled_from(PreconditionerKind))
def test_a_step_is_the_networks(seed, kind):
    network = random_network(seed, kind)
    onnx, starts = OnnxNetwork(network), some_states(network, seed, 3)
    states = np.moveaxis(network.unpack(starts), 0, -1)
    following, residual = onnx.step(states, STEP)
    for sample, start in enumerate(starts):
        walk = Walk(network, start, STEP)
        expected = walk.residual()
        assert residual[sample] == pytest.approx(expected, rel=1e-9)
        if np.isfinite(expected):
            walk.advance()
            np.testing.assert_allclose(following[..., sample], walk.states, rtol=0, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("kind", OF_RUNS, ids=lambda kind: kind.name.lower())
def test_steps_follow_the_rule_of_rails_where_the_held_set_changes_a_hundred_times(kind):
    """All states of a run at once, each with neurons of its own that are held."""
    network, states, changes = run_with_changes(kind)
    assert changes >= 100
    step = 0.2 / evaluator(unrailed(network)).fastest_rate(network.start_state)
    onnx, given = OnnxNetwork(network), np.moveaxis(network.unpack(states), 0, -1)
    found = network.pack(np.moveaxis(onnx.step(given, step)[0], -1, 0)) - states
    low, high = rails_of(network)
    derivatives = step * np.array([evaluator(network).rhs(x) for x in states])
    expected = (states + derivatives).clip(low, high) - states
    rounding = np.finfo(float).eps * np.abs(states).max(axis=1)
    off = np.abs(found - expected).max(axis=1)
    assert (off <= 1e-12 * np.abs(expected).max(axis=1) + rounding).all()


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("kind", "population"),
    [(PreconditionerKind.MULTILEVEL, "q"), (PreconditionerKind.RESISTIVE_GRID, "u")],
)
def test_files_of_clamped_networks_settle_where_their_vector_does(kind, population):
    size, _ = resting_at_rails("lq_unst", population)
    network = with_limits(wired_with("lq_unst", kind), size, population)
    vector = reference_vector(network)
    low, high = rails_of(network)
    end = network.pack(vector.end)
    assert ((end == low) | (end == high)).any()
    assert "settled after" in onnx_check(onnx_files(network, vector))


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(seed=SEEDS, kind=st.sampled_from(PreconditionerKind))
def test_float32_is_close(seed, kind):
    network = random_network(seed, kind)
    states = np.moveaxis(network.unpack(some_states(network, seed, 4)), 0, -1)
    double, single = (OnnxNetwork(network, p).step(states, STEP) for p in ("float64", "float32"))
    assert single[0].dtype == np.float32
    for sample in np.flatnonzero(np.isfinite(double[1])):
        scale = max(1.0, np.abs(double[0][..., sample]).max())
        np.testing.assert_allclose(
            single[0][..., sample] / scale, double[0][..., sample] / scale, rtol=0, atol=1e-4
        )


def test_sources_beyond_the_neighbours_are_read():
    network = far_wired(3)
    x = network.start_state
    found, _ = OnnxNetwork(network).step(network.unpack(x)[..., None], STEP)
    walk = Walk(network, x, STEP)
    walk.advance()
    np.testing.assert_allclose(found[..., 0], walk.states, rtol=0, atol=1e-12)


def test_nothing_is_read_where_there_is_no_neuron():
    network = random_network(0)
    onnx, states = OnnxNetwork(network), network.unpack(network.start_state)[..., None]
    elsewhere = states.copy()
    elsewhere[~network.live] = 99.0
    for found, expected in zip(onnx.step(elsewhere, STEP), onnx.step(states, STEP)):
        np.testing.assert_array_equal(found, expected)


def test_every_sample_has_inputs_of_its_own():
    network = random_network(1)
    onnx, states = OnnxNetwork(network), network.unpack(network.start_state)[..., None]
    inputs = onnx.inputs()
    both = np.concatenate([inputs, inputs + 0.1], axis=-1)
    following, _ = onnx.step(np.repeat(states, 2, axis=-1), STEP, both)
    for sample in range(2):
        alone, _ = onnx.step(states, STEP, both[..., sample : sample + 1])
        # one rounding error apart: onnxruntime computes the ends of rows with other instructions
        np.testing.assert_allclose(following[..., sample], alone[..., 0], rtol=0, atol=5e-16)
    assert np.abs(following[..., 0] - following[..., 1]).max() > 1e-3
