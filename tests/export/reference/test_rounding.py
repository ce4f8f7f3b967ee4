"""Tolerances for walks whose last bits grow."""

import numpy as np

from ann_dc.export.reference import EulerWalk, ReferenceVector, reference_vector, rounding_tolerance
from ann_dc.network import Cell, Connection, Network, Neuron


def vector_and_walk(weight: float) -> tuple[ReferenceVector, object]:
    wire = Connection(source="x", target="x", weight=weight)
    cell = Cell(neurons=(Neuron(name="x"),), connections=(wire,))
    network = Network(cell=cell, stages=1, start={"x": 1.0})
    vector = reference_vector(network)
    walker = EulerWalk(network, vector.step)
    return vector, lambda start, n: network.unpack(walker.after(network.pack(start), n))


def test_where_nothing_grows_it_is_the_least():
    assert rounding_tolerance(*vector_and_walk(-1.0)) == 1e-9


def test_what_grows_in_a_walk_grows_in_its_tolerance():
    """Of x' = x, every step multiplies by 1 + h; the states do so too, a bounded state does not."""
    vector, _ = vector_and_walk(-1.0)

    def repelled(start, count):
        return 1.3**count * (start - vector.start) + vector.early[count]

    expected = 1000 * 1.3**50 * 1e-15
    np.testing.assert_allclose(rounding_tolerance(vector, repelled), expected, rtol=0.3)


def test_it_has_a_limit():
    vector, _ = vector_and_walk(-1.0)
    assert rounding_tolerance(vector, lambda start, count: 1e30 * (start - vector.start)) == 1e-2
    assert rounding_tolerance(vector, lambda start, count: start * np.nan) == 1e-2
