"""Reference vectors: walks that others can repeat."""

import json
import tracemalloc

import numpy as np
import pytest

import ann_dc
from ann_dc.errors import FileFormatError
from ann_dc.export.reference.vector import ReferenceVector, reference_vector
from ann_dc.network.cell import Cell, Connection, Limiter, Neuron
from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash, wiring_hash


@pytest.fixture(scope="module")
def network() -> Network:
    return ann_dc.design(ann_dc.plants.car()).network


@pytest.fixture(scope="module")
def vector(network) -> ReferenceVector:
    return reference_vector(network)


def test_a_walk_takes_the_steps_of_the_recurrent_backend(network, vector):
    """And ends after as many of them."""
    step = ann_dc.FixedStep(step=vector.step)
    for count, states in vector.early.items():
        run = ann_dc.RecurrentBackend(step=step, limit=count).run(network)
        np.testing.assert_allclose(network.unpack(run.trajectory.final), states, rtol=0, atol=1e-13)
    settling = ann_dc.Settling(tolerance=vector.tolerance)
    run = ann_dc.RecurrentBackend(step=step, settling=settling).run(network)
    assert np.flatnonzero(run.trajectory.kkt < vector.tolerance)[0] == vector.steps


def test_it_says_whose_walk_it_is(network, vector):
    assert (vector.wiring, vector.content) == (wiring_hash(network), content_hash(network))
    moved = network.with_inputs({"q_d.x": 4.0})
    assert wiring_hash(moved) == vector.wiring
    assert content_hash(moved) != vector.content


def test_json_keeps_every_bit(vector):
    again = ReferenceVector.from_json(vector.as_json())
    assert again.as_json() == vector.as_json()
    np.testing.assert_array_equal(again.end, vector.end)
    np.testing.assert_array_equal(again.early[50], vector.early[50])


def test_another_walk_is_refused(network, vector):
    other = reference_vector(network.with_inputs({"q_d.x": 4.0}))
    with pytest.raises(FileFormatError, match="differs from the exported one"):
        vector.check(lambda start, count: other.early[count])


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"start": [[1.0]]}, "shape"),
        ({"end": "x"}, "end"),
        ({"early": {"-1": [[0.0]]}}, "early"),
        ({"early": {}}, r"reference_vector\.json\.early: expected the states after 1 and 50"),
        ({"early": {"1": [[0.0]], "50": [[0.0]], "100000": [[0.0]]}}, "early"),
        ({"step": 0.0}, "step: expected a positive number"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"steps": 1.5}, "steps"),
        ({"schema": 2}, "schema"),
        ({"start": [[None]]}, "start"),
        ({"inputs": {"q_d.x": [1e999]}}, "q_d.x|Infinity"),
    ],
)
def test_what_is_no_vector_is_refused_by_name(vector, change, named):
    table = json.loads(vector.as_json()) | change
    with pytest.raises(FileFormatError, match=named):
        ReferenceVector.from_json(json.dumps(table).encode())


@pytest.mark.slow
def test_a_walk_that_starts_where_the_flow_repels_finds_its_step():
    network = ann_dc.design(ann_dc.plants.cart_pole()).network
    vector = reference_vector(network)
    assert vector.settles
    assert vector.residual < vector.tolerance


@pytest.mark.sampled(1)
@pytest.mark.parametrize("high", [np.inf, 1.0])
def test_a_start_where_nothing_moves_has_a_vector_too(high):
    """One neuron with a constant drive: alone, and at its rail."""
    neuron = Neuron(name="x", limiter=Limiter(high=high))
    cell = Cell(neurons=(neuron,), connections=(Connection(source="one", target="x"),))
    vector = reference_vector(Network(cell=cell, stages=1, start={"x": 1.0}))
    assert vector.settles == np.isfinite(high)
    assert vector.step > 0


@pytest.mark.parametrize(
    ("content", "why"),
    [(b"[" + b"[]," * 200_000, "200000 tables"), (b" " * 50_000_001, "50000000 letters")],
)
def test_what_would_take_memory_is_not_taken_apart(content, why):
    tracemalloc.start()
    with pytest.raises(FileFormatError, match=f"more than {why}"):
        ReferenceVector.from_json(content)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1.1 * len(content) + 100_000
