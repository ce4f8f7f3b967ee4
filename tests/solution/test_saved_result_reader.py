"""JSON data as records, by the types that their annotations declare."""

import enum
import io
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from network_files import assert_same

from ann_dc.errors import AnnDcError, FileFormatError, NetworkError, UnknownNameError
from ann_dc.network.cell import Cell, Neuron
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import Preconditioner
from ann_dc.network.preconditioners.diagonal import Diagonal
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.solution.saved_result import Reader, Writer
from ann_dc.weights.entries import NpzEntries, packed_entries

NETWORK = Network(cell=Cell(neurons=(Neuron(name="x"),), connections=()), stages=2)


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Inner:
    numbers: tuple[float, ...]
    colour: Colour = Colour.RED


@dataclass(frozen=True, kw_only=True, eq=False)
class Outer:
    network: Network
    inner: tuple[Inner, ...]
    array: np.ndarray
    maybe: np.ndarray | None
    said: Mapping[str, bool] = field(default_factory=dict)
    preconditioner: Preconditioner = field(default_factory=Diagonal)


def through_a_file(record, hint=Outer):
    writer = Writer()
    table = writer.value(record, "outer")
    content = packed_entries({}, writer.arrays)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = NpzEntries(archive, len(content))
        again = Reader(entries, NETWORK).value(hint, table, "outer")
        entries.finish()
    return again


NUMBERS = st.one_of(st.floats(allow_nan=False), st.just(math.nan))
INNERS = st.builds(
    Inner, numbers=st.lists(NUMBERS, max_size=4).map(tuple), colour=st.sampled_from(Colour)
)
ARRAYS = st.lists(NUMBERS, min_size=1, max_size=5).map(np.array)


@settings(max_examples=40, deadline=None)
@given(
    st.builds(
        Outer,
        network=st.just(NETWORK),
        inner=st.lists(INNERS, max_size=3).map(tuple),
        array=st.one_of(ARRAYS, ARRAYS.map(lambda a: np.stack([a, a]) + 0j)),
        maybe=st.one_of(st.none(), ARRAYS),
        said=st.dictionaries(st.text(st.characters(categories=["L"]), max_size=5), st.booleans()),
    )
)
def test_a_record_comes_back_field_by_field(record):
    with np.errstate(invalid="ignore"):  # nan + 0j
        assert_same(through_a_file(record), record)


def test_a_field_with_a_default_may_be_missing():
    assert Reader(None, None).value(Inner, {"numbers": [1]}, "r").colour is Colour.RED


BAD = {
    "a list for a table": (Inner, [], FileFormatError, r"^r: expected a table, got \[\]"),
    "a table for a list": (tuple[int, ...], {}, FileFormatError, "^r: expected a list"),
    "a wrong part": (tuple[int, ...], [1, "2"], FileFormatError, "^r/1: expected int, got '2'"),
    "a bool for a float": (float, False, FileFormatError, "^r: expected float, got False"),
    "an int for a bool": (bool, 1, FileFormatError, "^r: expected bool, got 1"),
    "nan for an int": (int, "nan", FileFormatError, "^r: expected int"),
    "nothing for a word": (str, None, FileFormatError, "^r: expected str, got None"),
    "no such member": (Colour, "GREEN", UnknownNameError, "'GREEN'.*RED, BLUE"),
    "a number for a member": (Colour, 1, UnknownNameError, "RED, BLUE"),
    "a member by attribute": (Colour, "__class__", UnknownNameError, "RED, BLUE"),
    "missing": (Inner, {}, FileFormatError, "^r/numbers: missing"),
    "unknown": (Inner, {"numbers": [], "x": 1, "a": 2}, FileFormatError, "^r: unknown key a, x"),
    "a preconditioner of no kind": (
        Preconditioner,
        {"type": "Network"},
        UnknownNameError,
        "Diagonal",
    ),
    "a preconditioner that is none": (Preconditioner, {}, UnknownNameError, "Multilevel"),
    "no levels": (Preconditioner, {"type": "Multilevel", "gains": []}, NetworkError, "got none"),
}


@pytest.mark.parametrize(("hint", "table", "kind", "message"), BAD.values(), ids=BAD)
def test_bad_data_is_refused_by_its_place(hint, table, kind, message):
    with pytest.raises(kind, match=message):
        Reader(None, NETWORK).value(hint, table, "r")


def test_a_preconditioner_of_another_network_is_refused():
    with pytest.raises(AnnDcError, match="chains"):
        through_a_file(Multilevel(gains=(np.zeros((2, 3, 3)),)), Preconditioner)


def test_words_for_numbers_that_are_not_finite():
    read = Reader(None, None).value(tuple[float, ...], ["nan", "inf", "-inf", 2], "r")
    assert math.isnan(read[0])
    assert read[1:] == (math.inf, -math.inf, 2.0)
