"""Trajectories of a case as the bytes of an ``.npz`` file, with a strict reader."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ann_dc.errors import StoreError

BROKEN = (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, ValueError, TypeError,
          KeyError, MemoryError)  # fmt: skip
"""Exceptions that reading a damaged file may raise."""


def packed(arrays: Mapping[str, ArrayLike]) -> bytes:
    """Pack arrays of numbers or booleans into the bytes of one file.

    Equal arrays give equal bytes. Raises `StoreError` for an array of objects.

    >>> unpacked(packed({"time": [0.0, 1.0]}))
    {'time': array([0., 1.])}
    """
    stream = io.BytesIO()
    found = {name: np.asarray(values) for name, values in arrays.items()}
    for name, values in found.items():
        if values.dtype.hasobject:
            raise StoreError(f"curves: {name}: expected an array of numbers, got one of objects")
    np.savez(stream, **found)  # type: ignore[arg-type]
    return stream.getvalue()


def unpacked(content: bytes) -> dict[str, np.ndarray]:
    """Return the arrays by name from bytes written by `packed`, without unpickling.

    Raises `StoreError` if the bytes are not such a file or declare a larger size than they have.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            if sum(info.file_size for info in archive.infolist()) > len(content):
                raise StoreError("its entries claim to be larger than it is")
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except BROKEN as error:
        raise StoreError(f"curves: expected a stored .npz file of numbers: {error}") from error
