"""Saved networks: whether two are the same, and files with entries that someone changed."""

import io
import json
import zipfile
from dataclasses import fields, is_dataclass

import numpy as np
import pytest


def parts(thing) -> dict | None:
    """What a record, a tuple, a list or a mapping is made of; None of anything else."""
    if is_dataclass(thing):
        return {f".{f.name}": getattr(thing, f.name) for f in fields(thing)}
    if isinstance(thing, (tuple, list)):
        return {f"[{i}]": part for i, part in enumerate(thing)}
    return thing if isinstance(thing, dict) else None


def assert_same(a, b, place: str = "network") -> None:
    """Equal field by field, floats (also NumPy's) bit by bit, types included."""
    assert type(a) is type(b) or (isinstance(a, float) and isinstance(b, float)), place
    inside = parts(a)
    if inside is not None:
        others = parts(b) or {}
        assert inside.keys() == others.keys(), place
        for key, part in inside.items():
            assert_same(part, others[key], f"{place}{key}")
    elif isinstance(a, (float, np.ndarray)):
        p, q = np.asarray(a), np.asarray(b)
        assert (p.shape, p.dtype, p.tobytes()) == (q.shape, q.dtype, q.tobytes()), place
    else:
        assert a == b, place


def entry(array, **options) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.asarray(array), **options)
    return stream.getvalue()


def rewritten(path, change) -> None:
    """The file with its entries (name -> bytes) changed in place by ``change``."""
    with zipfile.ZipFile(path) as archive:
        entries = {
            info.filename.removesuffix(".npy"): archive.read(info) for info in archive.infolist()
        }
    change(entries)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in entries.items():
            archive.writestr(f"{name}.npy", data)


def with_manifest(change):
    """A change of entries from a change of the JSON table."""

    def changed(entries) -> None:
        table = json.loads(entries["manifest"][128:])
        table = change(table) or table
        text = table if isinstance(table, bytes) else json.dumps(table).encode()
        entries["manifest"] = entry(np.frombuffer(text, np.uint8))

    return changed


def setting(*keys_and_value):
    """Set one value deep inside the manifest."""
    *keys, last, value = keys_and_value

    def change(table) -> None:
        for key in keys:
            table = table[key]
        table[last] = value

    return with_manifest(change)


def put(name, data):
    return lambda entries: entries.__setitem__(name, data)


def drop(name):
    return lambda entries: entries.pop(name)


class Bomb:
    def __reduce__(self):
        return (pytest.fail, ("a pickle was executed",))


STILL = "tau/q.x"


OBJECTS = entry(np.array([Bomb()], object), allow_pickle=True)


HUGE = entry(np.zeros(1)).replace(b"(1,), }             ", b"(99999999999999,), }")
