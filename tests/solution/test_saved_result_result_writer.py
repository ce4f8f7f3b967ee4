"""Records as JSON data and arrays."""

import json
import math
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
import pytest

from ann_dc.backends.status import Outcome
from ann_dc.dataclass_pickling import WHERE_GIVEN
from ann_dc.errors import OutputError
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.solution.saved_result import Writer

NETWORK = Network(cell=Cell(neurons=(Neuron(name="x"),), connections=()), stages=1)


@dataclass(frozen=True)
class Pair:
    network: Network
    values: tuple


@dataclass(frozen=True)
class Told:
    always: float | None = None
    where_given: float | None = field(default=None, metadata={WHERE_GIVEN: True})


def test_a_field_may_ask_to_be_left_out_where_it_is_none():
    assert Writer().value(Told(), "place") == {"always": None}
    assert Writer().value(Told(1.0, 2.0), "place") == {"always": 1.0, "where_given": 2.0}


def test_plain_data_stays_what_it_is():
    writer = Writer()
    given = {"a": 1, "b": (True, None, "word"), "c": [np.int64(3), np.float64(0.5)]}
    written = writer.value(MappingProxyType(given), "place")
    assert written == {"a": 1, "b": [True, None, "word"], "c": [3, 0.5]}
    assert json.loads(json.dumps(written, allow_nan=False)) == written
    assert writer.arrays == {}


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_a_number_that_is_not_finite_is_a_word(value):
    assert Writer().value(np.float64(value), "place") == str(value)


def test_an_outcome_is_its_name_and_a_network_is_left_out():
    assert Writer().value(Outcome.SETTLED, "place") == "SETTLED"
    assert Writer().value(Pair(NETWORK, (1.0,)), "place") == {"values": [1.0]}


def test_arrays_gather_by_their_places():
    writer = Writer()
    grid = ResistiveGrid(own=np.ones((1, 1, 1)), following=np.zeros((0, 1, 1)))
    assert writer.value(grid, "preconditioner") == {
        "type": "ResistiveGrid",
        "own": "float",
        "following": "float",
    }
    assert [*writer.arrays] == ["preconditioner/own", "preconditioner/following"]
    assert writer.value(np.array([1 + 2j]), "z") == "complex"
    np.testing.assert_array_equal(writer.arrays["z"], [[1.0, 2.0]])


@pytest.mark.parametrize("thing", [object(), np.array([1]), np.array(["a"]), 1j, {1, 2}, b"x"])
def test_what_cannot_be_read_back_is_not_written(thing):
    with pytest.raises(OutputError, match=r"run/0: .*cannot be saved"):
        Writer().value((thing,), "run")
