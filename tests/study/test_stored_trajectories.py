"""Curves in a store are taken for what they are: bytes that anyone may have written."""

import io
import zipfile

import numpy as np
import pytest
from hypothesis import given, strategies as st

from ann_dc.errors import StoreError
from ann_dc.study.stored_trajectories import packed, unpacked

GOOD = packed({"time": np.linspace(0, 1, 5), "settled": [True, False]})


def test_packing_and_unpacking_is_the_identity():
    found = unpacked(GOOD)
    assert [*found] == ["time", "settled"]
    np.testing.assert_array_equal(found["time"], np.linspace(0, 1, 5))
    assert found["settled"].tolist() == [True, False]
    assert packed(found) == GOOD


def test_no_objects_go_in():
    with pytest.raises(StoreError, match="curves: odd: expected an array of numbers"):
        packed({"odd": np.array([{}])})


def pickled():
    stream = io.BytesIO()
    np.savez(stream, odd=np.array([{}], dtype=object))
    return stream.getvalue()


def bomb():
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("time.npy", bytes(10_000_000))
    return stream.getvalue()


@pytest.mark.parametrize("content", [b"", b"PK", GOOD[:-5], pickled(), bomb()])
def test_what_is_no_file_of_curves(content):
    with pytest.raises(StoreError, match=r"curves: expected a stored \.npz file of numbers"):
        unpacked(content)


@given(st.integers(0, len(GOOD) - 1), st.integers(0, 255))
def test_a_damaged_byte_is_an_error_of_ours_or_none(place, value):
    content = bytearray(GOOD)
    content[place] = value
    try:
        found = unpacked(bytes(content))
    except StoreError:
        return
    assert all(values.dtype.hasobject is False for values in found.values())
