"""Copies of a network that differ in their inputs, and where they start."""

import numpy as np
import pytest
from designs import small
from hypothesis import given, settings, strategies as st

from ann_dc.decomposition.equations import decompose
from ann_dc.decomposition.form import CORRECTED, SWITCHES
from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.inputs import input_batch, moved_starts
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.problem.scales import scales_of
from ann_dc.solver import synthesize

# ---- inputs ------------------------------------------------------------------------------------


def test_every_input_of_every_sample():
    network = small("double_integrator")
    stages = np.arange(8.0).reshape(2, 4)
    whole = input_batch(network, {"q_0.x": [0.1, 0.2], "q_d.v": stages, "q_0.v": 3.0})
    assert set(whole) == set(network.cell.inputs)
    np.testing.assert_array_equal(whole["q_0.x"], [[0.1] * 4, [0.2] * 4])
    np.testing.assert_array_equal(whole["q_d.v"], stages)
    np.testing.assert_array_equal(whole["q_0.v"], np.full((2, 4), 3.0))
    np.testing.assert_array_equal(whole["q_d.x"], np.full((2, 4), 1.0))  # the network's own


def test_one_sample_fits_every_batch():
    network = small("double_integrator")
    whole = input_batch(network, {"q_0.x": [[5.0]], "q_d.x": [1.0, 2.0, 3.0], "q_d.v": [7.0]})
    assert {array.shape for array in whole.values()} == {(3, 4)}
    assert (whole["q_0.x"] == 5.0).all()
    assert (whole["q_d.v"] == 7.0).all()


def test_without_inputs_one_sample():
    network = small("car")
    for given_inputs in ({}, {"q_d.x": 2.0}):
        whole = input_batch(network, given_inputs)
        assert {array.shape for array in whole.values()} == {(1, 4)}


def test_inputs_of_a_network_may_change_from_stage_to_stage():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("current", "bias"),
        connections=(Connection(source="current", target="x"),),
    )
    network = Network(cell=cell, stages=3, inputs={"current": [1.0, 2.0, 3.0], "bias": 0.0})
    whole = input_batch(network, {"bias": [4.0, 5.0]})
    np.testing.assert_array_equal(whole["current"], [[1.0, 2.0, 3.0]] * 2)


def test_what_is_no_number_may_pass():
    """It costs its own sample only, and the backend says so."""
    whole = input_batch(small("car"), {"q_d.x": [1.0, np.nan, np.inf]})
    assert np.isfinite(whole["q_d.x"]).all(axis=1).tolist() == [True, False, False]


WRONG = {
    "a name that does not exist": (
        {"q_d.z": 1.0},
        UnknownNameError,
        r"input 'q_d.z' does not exist; choose one of: .*q_d.phi",
    ),
    "sizes that do not agree": (
        {"q_d.x": [1.0, 2.0], "q_d.y": 1.0, "q_0.x": np.zeros((3, 4))},
        NetworkError,
        "sizes of the batch differ: q_d.x has 2, q_0.x has 3 samples",
    ),
    "another number of stages": (
        {"q_d.x": np.zeros((2, 5))},
        NetworkError,
        r"inputs\[q_d.x\]: .* or one per sample and stage, \(B, 4\), got an array of shape .2, 5",
    ),
    "too many axes": (
        {"q_d.x": np.zeros((2, 4, 1))},
        NetworkError,
        r"inputs\[q_d.x\]: .* got an array of shape \(2, 4, 1\)",
    ),
    "no sample": ({"q_d.x": []}, NetworkError, r"inputs\[q_d.x\]: the batch is empty"),
    "words": (
        {"q_d.x": ["near", "far"]},
        NetworkError,
        r"inputs\[q_d.x\]: expected numbers, got \['near', 'far'\]",
    ),
    "a ragged list": ({"q_d.x": [[1.0], [1.0, 2.0]]}, NetworkError, "expected numbers"),
}


@pytest.mark.parametrize(("inputs", "error", "message"), WRONG.values(), ids=WRONG)
def test_refused(inputs, error, message):
    with pytest.raises(error, match=message):
        input_batch(small("car"), inputs)


# ---- starts ------------------------------------------------------------------------------------

NUMBERS = st.floats(-3.0, 3.0)


def started(network: Network, inputs) -> tuple[np.ndarray, np.ndarray]:
    """Neurons (B, P, N) where the samples start, pins in place, and who belongs to a chain."""
    whole = input_batch(network, inputs)
    states = moved_starts(network, whole)
    samples = [
        network.with_inputs({name: array[i] for name, array in whole.items()}).unpack(x)
        for i, x in enumerate(states)
    ]
    chains = [network.neuron_index[name] for pair in network.cell.chains for name in pair]
    return np.array(samples), np.isin(np.arange(len(network.cell.neurons)), chains)


TABLE = {
    "car": plants.car(N=4),
    "unicycle": plants.unicycle(N=5),
    "double_integrator": plants.double_integrator(N=1),
    "car, heading free": plants.car(N=4, q_d=(5, 5, None, None)),
    "double_integrator, all free": plants.double_integrator(N=4, q_d=(None, None)),
}


@pytest.mark.parametrize("form", [CORRECTED, SWITCHES["S14"]], ids=str)
@pytest.mark.parametrize("problem", TABLE.values(), ids=TABLE)
def test_chains_start_as_those_of_the_other_problem(problem, form):
    """The network of the problem with other ends starts on the same line."""
    network, rng = synthesize(decompose(problem, form)), np.random.default_rng(1)
    q_0 = rng.uniform(-3.0, 3.0, problem.n)
    q_d = tuple(None if old is None else rng.uniform(-3.0, 3.0) for old in problem.q_d)
    inputs = {f"q_0.{s}": v for s, v in zip(problem.states, q_0)}
    inputs |= {f"q_d.{s}": v for s, v in zip(problem.states, q_d) if v is not None}
    values, chain = started(network, inputs)
    moved = decompose(problem.with_inputs(q_0=q_0, q_d=q_d), form)
    other = synthesize(moved, scales=scales_of(problem))
    expected = other.unpack(other.start_state)
    np.testing.assert_allclose(values[0][chain], expected[chain], rtol=1e-12, atol=1e-12)
    own = network.unpack(network.start_state)
    np.testing.assert_array_equal(values[0][~chain], own[~chain])


@settings(max_examples=20, deadline=None)
@given(ends=st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=5))
def test_a_straight_line_stays_one(ends):
    network = small("car")
    q_0, q_d = np.transpose(ends)
    values, _ = started(network, {"q_0.y": q_0, "q_d.y": q_d})
    q, t = (
        network.neuron(name).scale.user(values[:, network.neuron_index[name]])
        for name in ("q.y", "t.y")
    )
    line = np.linspace(q_0, q_d, 5, axis=1)
    np.testing.assert_allclose(q, line[:, :-1], atol=1e-12)
    np.testing.assert_allclose(t, line[:, 1:], atol=1e-12)
    x, own = network.neuron_index["q.x"], network.unpack(network.start_state)
    np.testing.assert_array_equal(values[:, x], np.broadcast_to(own[x], (len(ends), 4)))


def test_a_chain_with_a_free_end_moves_as_a_whole():
    network = synthesize(plants.double_integrator(N=4, q_d=(None, 0)))
    values, _ = started(network, {"q_0.x": [0.0, 0.7]})
    own = network.unpack(network.start_state)
    x = [network.neuron_index[name] for name in ("q.x", "t.x")]
    np.testing.assert_array_equal(values[0], own)
    factor = network.neuron("q.x").scale.factor
    np.testing.assert_allclose(factor * values[1][x], factor * own[x] + 0.7, rtol=1e-12)


def test_what_is_no_line_keeps_its_shape():
    """Whatever the start is, q and t move by their share of what the ends move."""
    network = small("double_integrator")
    bent = network.with_start(np.random.default_rng(1).standard_normal(network.size))
    values, _ = started(bent, {"q_d.x": [1.0, 3.0], "q_0.x": [0.0, 1.0]})
    moved = values[1] - values[0]
    np.testing.assert_allclose(moved[network.neuron_index["q.x"]], [1.0, 1.25, 1.5, 1.75])
    np.testing.assert_allclose(moved[network.neuron_index["t.x"]], [1.25, 1.5, 1.75, 2.0])
    still = np.ones(len(moved), bool)
    still[[network.neuron_index[name] for name in ("q.x", "t.x")]] = False
    assert not moved[still].any()


def test_the_end_is_where_the_pin_reads():
    """q_d is read by the last stage alone, q_0 by the first."""
    network = small("double_integrator")
    values, _ = started(network, {"q_d.x": [[9.0, 9.0, 9.0, 2.0]], "q_0.x": [[1.0, 9.0, 9.0, 9.0]]})
    np.testing.assert_allclose(values[0][network.neuron_index["q.x"]], [1.0, 1.25, 1.5, 1.75])


def test_the_networks_own_inputs_leave_its_start_alone():
    network = small("car")
    starts = moved_starts(network, input_batch(network, {"q_d.x": [5.0, 5.0]}))
    np.testing.assert_array_equal(starts, np.array([network.start_state] * 2))


def test_networks_without_chains_start_where_they_start():
    cell = Cell(
        neurons=(Neuron(name="x"),),
        inputs=("current",),
        connections=(Connection(source="current", target="x"),),
    )
    network = Network(cell=cell, stages=2, inputs={"current": 0.0}, start={"x": [1.0, 2.0]})
    starts = moved_starts(network, input_batch(network, {"current": [1.0, 2.0, 3.0]}))
    np.testing.assert_array_equal(starts, [[1.0, 2.0]] * 3)
