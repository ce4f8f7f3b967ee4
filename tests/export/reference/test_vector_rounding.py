"""Comparing walks whose last bits grow."""

import numpy as np
import pytest

from ann_dc.errors import FileFormatError
from ann_dc.export.reference.vector import ReferenceVector, compare, reference_vector
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network


@pytest.fixture(scope="module")
def vector() -> ReferenceVector:
    wire = Connection(source="x", target="x", weight=-1.0)
    cell = Cell(neurons=(Neuron(name="x"),), connections=(wire,))
    return reference_vector(Network(cell=cell, stages=1, start={"x": 1.0}))


def walk_of(vector, growth: float, error: float):
    """Another walk: the vector's, with an error, in which differences grow from step to step."""

    def walk(start, count):
        return vector.early[count] + (start - vector.start) * growth**count + error * growth**count

    return walk


def test_what_does_not_grow_has_to_be_equal(vector):
    assert compare(vector, walk_of(vector, 1.0, 1e-12)) == pytest.approx(1e-12, rel=1e-3)
    with pytest.raises(FileFormatError, match="the network differs"):
        compare(vector, walk_of(vector, 1.0, 1e-8))


def test_what_grows_may_grow_as_far_as_rounding_does(vector):
    """By 1.5 a step 1e-14 becomes 6e-6 in fifty, and 1e-11 is more than rounding."""
    assert compare(vector, walk_of(vector, 1.5, 1e-14)) > 1e-6
    with pytest.raises(FileFormatError):
        compare(vector, walk_of(vector, 1.5, 1e-11))


def test_one_step_is_compared_however_far_the_rest_grows(vector):
    with pytest.raises(FileFormatError):
        compare(vector, walk_of(vector, 30.0, 1e-6))


def test_a_walk_that_claims_that_anything_grows_is_not_believed(vector):
    """Infinite differences, and states that hang on the last bits of the start."""

    def infinite(start, count):
        return vector.early[count] + (7.0 if (start == vector.start).all() else np.inf)

    def broken(start, count):
        return start * 0 + (7.0 if (start == vector.start).all() else 9.0)

    def late(start, count):
        return vector.early[1] if count == 1 else broken(start, count)

    for walk in (infinite, broken, late):
        with pytest.raises(FileFormatError, match="the network differs"):
            compare(vector, walk)


def test_single_precision_has_coarser_last_bits(vector):
    """By 1.5 a step 1e-7 of the start is more than any state after fifty."""
    walk = walk_of(vector, 1.5, 1e-10)
    with pytest.raises(FileFormatError):
        compare(vector, walk)
    assert compare(vector, walk, "float32") > 1e-2


def test_what_is_no_number_is_not_equal(vector):
    with pytest.raises(FileFormatError):
        compare(vector, lambda start, count: start * np.nan)
