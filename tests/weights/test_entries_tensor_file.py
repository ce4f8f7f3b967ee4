"""Safetensors: as the package of that name writes and reads them, and hostile ones refused."""

import json
import math

import numpy as np
import pytest
from designs import designed, small
from network_files import assert_same

from ann_dc.errors import FileFormatError, OutputError
from ann_dc.weights.entries import packed_tensors
from ann_dc.weights.network_file import load, save

safetensors = pytest.importorskip("safetensors")
from safetensors import numpy as theirs  # noqa: E402


@pytest.fixture
def path(tmp_path):
    return tmp_path / "car.safetensors"


def split(data: bytes) -> tuple[dict, bytes]:
    length = int.from_bytes(data[:8], "little")
    return json.loads(data[8 : 8 + length]), data[8 + length :]


def joined(header: dict | bytes, body: bytes) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text + body


def test_the_package_writes_the_same_bytes(path):
    save(designed("car").network, path)
    header, _ = split(path.read_bytes())
    arrays = theirs.load(path.read_bytes())
    assert theirs.save(arrays, metadata=header["__metadata__"]) == path.read_bytes()


def test_the_package_reads_every_number(path):
    network = designed("car").network
    save(network, path)
    with safetensors.safe_open(path, "np") as file:
        manifest = json.loads(file.metadata()["manifest"])
        assert set(file.keys()) == set(manifest["tensors"])
        for connection in network.cell.connections:
            found = file.get_tensor(f"weight/{connection.name}")
            assert found.dtype == np.float64
            np.testing.assert_array_equal(found, connection.weight)
        np.testing.assert_array_equal(file.get_tensor("stiffness/own"), network.preconditioner.own)


def test_what_another_program_wrote_is_read(path):
    """With the arrays in another order, as they may stand in the header."""
    network = small("car")
    save(network, path)
    header, body = split(path.read_bytes())
    turned = {name: header[name] for name in reversed(header)}
    path.write_bytes(joined(turned, body))
    assert_same(network, load(path))


def test_the_end_of_a_name_says_the_form(tmp_path):
    for name in ("a.SafeTensors", "b.npz", "c"):
        save(small("car"), tmp_path / name)
        assert_same(small("car"), load(tmp_path / name))
    assert (tmp_path / "c").read_bytes() == (tmp_path / "b.npz").read_bytes()
    (tmp_path / "a.SafeTensors").rename(tmp_path / "d.npz")
    with pytest.raises(FileFormatError, match=r"not a complete .npz file"):
        load(tmp_path / "d.npz")


def setting(name: str, key: str, value):
    def change(header: dict, body: bytes) -> bytes:
        header[name][key] = value
        return joined(header, body)

    return change


def with_text(change):
    """A change of the header's text."""
    return lambda header, body: joined(change(json.dumps(header)).encode(), body)


def longer(header: dict, body: bytes) -> bytes:
    """A gap behind the first array."""
    for given in header.values():
        if "data_offsets" in given and given["data_offsets"][0] > 0:
            given["data_offsets"] = [place + 8 for place in given["data_offsets"]]
    return joined(header, body + bytes(8))


def one_bit(place: int):
    def change(header: dict, body: bytes) -> bytes:
        changed = bytearray(body)
        changed[place] ^= 1
        return joined(header, bytes(changed))

    return change


def in_manifest(before: str, after: str):
    def change(header: dict, body: bytes) -> bytes:
        text = header["__metadata__"]["manifest"]
        assert before in text
        header["__metadata__"]["manifest"] = text.replace(before, after, 1)
        return joined(header, body)

    return change


def dropped(header: dict, body: bytes) -> bytes:
    """Without its last array."""
    name = max(header, key=lambda n: header[n].get("data_offsets", [-1])[0])
    begin, _ = header.pop(name)["data_offsets"]
    return joined(header, body[:begin])


STILL = "tau/q.x"
HOSTILE = {
    "empty": (lambda header, body: b"", "length of its header is invalid"),
    "a short prefix": (lambda header, body: b"\1\0\0", "length of its header is invalid"),
    "an endless header": (lambda h, b: b"\xff" * 8 + joined(h, b)[8:], "length of its header"),
    "no JSON": (lambda header, body: joined(b"{'a': 1}", body), "header.*not JSON"),
    "no UTF-8": (lambda header, body: joined(b'{"\xff": 1}', body), "header.*can't decode"),
    "a list": (lambda header, body: joined(b"[1, 2]", body), "is not a table"),
    "deeply nested": (lambda h, body: joined(b"[" * 100_000, body), "header.*not JSON"),
    "many tables": (lambda h, body: joined(b"[" * 300_000, body), "more than 200000 tables"),
    "a key twice": (with_text(lambda t: t.replace("{", '{"a": 1, "a": 2,', 1)), "'a' occurs twi"),
    "no metadata": (lambda h, b: joined({k: h[k] for k in list(h)[1:]}, b), "has no manifest"),
    "metadata of numbers": (setting("__metadata__", "manifest", 3), "has no manifest"),
    "more metadata": (setting("__metadata__", "format", "pt"), "contains more than a manifest"),
    "an array of another type": (setting(STILL, "dtype", "F32"), "'F32' values where 'F64' is"),
    "objects": (setting(STILL, "dtype", ["O"]), r"holds .* values where 'F64' is"),
    "a shape that is none": (setting(STILL, "shape", [True]), "are lists of lengths"),
    "a negative shape": (setting(STILL, "shape", [-1]), "are lists of lengths"),
    "many axes": (setting(STILL, "shape", [1] * 40), "are lists of lengths"),
    "a shape beyond the data": (setting(STILL, "shape", [2**40]), "do not fit"),
    "a shape without end": (setting(STILL, "shape", [2**70]), "are lists of lengths"),
    "three offsets": (setting(STILL, "data_offsets", [0, 8, 8]), "do not fit"),
    "offsets in words": (setting(STILL, "data_offsets", ["0", "8"]), "are lists of lengths"),
    "overlapping": (setting("tau/q.y", "data_offsets", [0, 8]), "overlap or leave a gap"),
    "a gap": (longer, "overlap or leave a gap"),
    "more at the end": (lambda h, b: joined(h, b + bytes(8)), "bytes follow|follow the header"),
    "cut short": (lambda h, b: joined(h, b[:-8]), "follow the header"),
    "an array more": (
        lambda h, b: joined(
            h | {"evil": {"dtype": "F64", "shape": [1], "data_offsets": [len(b), len(b) + 8]}},
            b + bytes(8),
        ),
        "unknown entries: evil",
    ),
    "an array less": (dropped, "is missing"),
    "a field more": (setting(STILL, "pickle", "yes"), "expected dtype, shape and data_offsets"),
    "an array that is none": (lambda h, b: joined(h | {STILL: 3}, b), "expected dtype, shape"),
    "an odd name": (
        lambda h, b: joined(
            h | {"a\n": {"dtype": "F64", "shape": [0], "data_offsets": [0, 0]}}, b
        ),
        "printable name",
    ),
    "one bit of a number": (one_bit(800), "manifest.hashes.content: the file was changed"),
    "another title": (in_manifest('"title": "car"', '"title": "cab"'), "hashes.manifest: the file"),
    "another word": (in_manifest("time constant of", "half of"), "hashes.manifest: the file was"),
    "another role": (in_manifest('"role": "dual"', '"role": "state"'), "hashes.wiring: the file"),
    "no hash": (in_manifest('"content": "', '"kontent": "'), "hashes: unknown key kontent"),
    "hashes of schema 1": (in_manifest('"schema": 3', '"schema": 1'), "schema: expected 3, got 1"),
    "another schema": (in_manifest('"schema": 3', '"schema": 4'), "schema: expected 3, got 4"),
    "a stage less": (in_manifest('"stages": 4', '"stages": 3'), "expected"),
}  # fmt: skip


@pytest.mark.sampled(10)
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_files(case, path):
    change, message = HOSTILE[case]
    save(small("car"), path)
    path.write_bytes(change(*split(path.read_bytes())))
    with pytest.raises(FileFormatError, match=message) as refusal:
        load(path)
    assert str(refusal.value).startswith(f"{path}: ")


def test_every_bit_of_the_numbers_counts(path):
    save(small("double_integrator"), path)
    good = path.read_bytes()
    _, body = split(good)
    for place in range(0, 8 * len(body), 97):
        data = bytearray(good)
        data[len(good) - len(body) + place // 8] ^= 1 << place % 8
        path.write_bytes(data)
        with pytest.raises(FileFormatError):
            load(path)


def test_equal_arrays_give_equal_bytes():
    arrays = {"b": [1.0, math.inf], "a": 2.0}
    assert packed_tensors("x", arrays) == packed_tensors("x", dict(reversed(arrays.items())))
    assert packed_tensors("", {})[:8] == (len(b'{"__metadata__":{"manifest":""}}')).to_bytes(
        8, "little"
    )


def test_more_names_than_a_header_may_have():
    with pytest.raises(OutputError, match=r"take 50000\d\d bytes.*save it as .npz"):
        packed_tensors("a" * 5_000_000, {})
