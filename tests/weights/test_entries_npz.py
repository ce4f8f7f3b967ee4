"""Files that are no archive of arrays, or a broken one."""

import pickle
import re
import zipfile

import numpy as np
import pytest
from designs import small
from hypothesis import given, settings, strategies as st
from network_files import (
    STILL,
    Bomb,
    assert_same,
    entry,
)

from ann_dc.errors import FileFormatError
from ann_dc.weights.network_file import load, save


@pytest.mark.parametrize("place", ["missing.npz", "", "\0", "/dev/zero", "."])
def test_no_file(place):
    with pytest.raises(FileFormatError, match=r"use the path of a saved network \(\.npz or"):
        load(place)


@pytest.mark.parametrize("data", [b"", b"hello", b"PK\x03\x04", pickle.dumps(Bomb())])
def test_no_zip(path, data):
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match=re.escape(f"{path}: not a complete .npz file")):
        load(path)


def test_an_npz_of_something_else(path):
    np.savez(path, weights=np.ones(3))
    with pytest.raises(FileFormatError, match="entry 'manifest' is missing"):
        load(path)


def test_an_entry_twice(path):
    save(small("car"), path)
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr(f"{STILL}.npy", entry(2.0))
    with pytest.raises(FileFormatError, match="an entry occurs twice"):
        load(path)


def test_a_zip_bomb(path):
    save(small("car"), path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("evil.npy", bytes(10_000_000))
    with pytest.raises(FileFormatError, match="claim to be larger than the file"):
        load(path)


@pytest.fixture(scope="module")
def good_bytes(tmp_path_factory):
    path = tmp_path_factory.mktemp("good") / "car.npz"
    save(small("double_integrator"), path)
    return path.read_bytes()


@settings(max_examples=40, deadline=None)
@given(share=st.floats(0, 0.9999))
def test_truncated_anywhere(tmp_path_factory, good_bytes, share):
    path = tmp_path_factory.getbasetemp() / "short.npz"
    path.write_bytes(good_bytes[: int(share * len(good_bytes))])
    with pytest.raises(FileFormatError, match=re.escape(str(path))):
        load(path)


@settings(max_examples=150, deadline=None)
@given(place=st.integers(0, 2**31), value=st.integers(1, 255))
def test_one_wrong_byte_anywhere(tmp_path_factory, good_bytes, place, value):
    path = tmp_path_factory.getbasetemp() / "wrong.npz"
    data = bytearray(good_bytes)
    data[place % len(data)] ^= value
    path.write_bytes(data)
    try:
        loaded = load(path)
    except FileFormatError:
        return
    # a byte that says nothing, such as the date of an entry
    assert_same(small("double_integrator"), loaded)
