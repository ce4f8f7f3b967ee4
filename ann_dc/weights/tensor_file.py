"""Named arrays in a ``.safetensors`` file, read and written with no other package.

The whole format: eight bytes (little-endian) say how long the header is; the header is JSON; the
arrays follow it, without gaps, in the order of the header.

.. code-block:: json

    {"__metadata__": {"manifest": "..."},
     "tau/mu.x": {"dtype": "F64", "shape": [], "data_offsets": [0, 8]}}

Nothing in it can be executed. What is written is, byte for byte, what the package ``safetensors``
writes of the same arrays.

References
----------
https://huggingface.co/docs/safetensors, section Format.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import final

import numpy as np

from ann_dc.errors import FileFormatError, OutputError
from ann_dc.weights.entries import NUMBER, Entries, Stored
from ann_dc.weights.manifest import MOST_TABLES, read_json, tables_in
from ann_dc.weights.npz import check_printable

METADATA = "__metadata__"
PREFIX = 8
"""Bytes that say how long the header is; and what its length is a multiple of."""
MAX_HEADER = 4_000_000
"""Longest header in bytes."""
KIND = "F64"
"""The only type of ours."""


def packed_tensors(manifest: str, arrays: Mapping[str, object]) -> bytes:
    """A text and float arrays as one file; equal ones give equal bytes.

    Parameters
    ----------
    manifest : str
    arrays : mapping of entry name to array

    Returns
    -------
    bytes

    Raises
    ------
    OutputError
        If a name is not printable, or there are more names than are read again.
    """
    check_printable(arrays)
    header: dict[str, dict] = {METADATA: {"manifest": manifest}}
    parts, end = [], 0
    for name in sorted(arrays, key=str.encode):
        values = np.array(arrays[name], "<f8", order="C")
        begin, end = end, end + values.nbytes
        header[name] = {"dtype": KIND, "shape": values.shape, "data_offsets": (begin, end)}
        parts.append(values.tobytes())
    words = json.dumps(header, ensure_ascii=False, separators=(",", ":"))
    text = words.encode()
    text += b" " * (-len(text) % PREFIX)
    if len(text) > MAX_HEADER or tables_in(words) > MOST_TABLES:
        raise OutputError(
            f"names and wires take {len(text)} bytes and {tables_in(words)} tables, a .safetensors "
            f"file may have {MAX_HEADER} and {MOST_TABLES}; save it as .npz"
        )
    return b"".join([len(text).to_bytes(PREFIX, "little"), text, *parts])


@final
class TensorEntries(Entries):
    """The arrays of a ``.safetensors`` file.

    Parameters
    ----------
    content : bytes
        Of the file.

    Attributes
    ----------
    manifest : str
        The text in its header.

    Raises
    ------
    FileFormatError
        If it is no such file, or its arrays overlap, leave a gap, or are none.
    """

    def __init__(self, content: bytes) -> None:
        length = int.from_bytes(content[:PREFIX], "little")
        if len(content) < PREFIX or not 2 <= length <= min(len(content) - PREFIX, MAX_HEADER):
            raise FileFormatError(
                "not a complete .safetensors file (the length of its header cannot be); save the "
                "network again"
            )
        header = _header(content[PREFIX : PREFIX + length])
        metadata = header.pop(METADATA, None)
        if not isinstance(metadata, dict) or not isinstance(metadata.get("manifest"), str):
            raise FileFormatError("its header has no manifest; is this a saved network?")
        if len(metadata) > 1:
            raise FileFormatError("its header says more than a manifest; save the network again")
        self.manifest = metadata["manifest"]
        self._data = memoryview(content)[PREFIX + length :]
        self._places = {name: _place(name, given) for name, given in header.items()}
        self._check_order()
        super().__init__(self._places)

    def _check_order(self) -> None:
        """Every byte belongs to one array: none is hidden, none is read twice."""
        end = 0
        for first, last in sorted((first, last) for _, first, last in self._places.values()):
            if first != end:
                raise FileFormatError("its arrays overlap or leave a gap; save the network again")
            end = last
        if end != len(self._data):
            raise FileFormatError(
                f"its arrays have {end} bytes, but {len(self._data)} follow the header; save the "
                "network again"
            )

    def stored(self, name: str) -> Stored:
        """The array of a name."""
        shape, first, last = self._places[name]
        return Stored(NUMBER, shape, self._data[first:last])


def _header(text: bytes) -> dict:
    try:
        header = read_json(text.decode("utf-8"))
    except (UnicodeDecodeError, FileFormatError) as error:
        raise FileFormatError(f"the header of a .safetensors file: {error}") from error
    if not isinstance(header, dict):
        raise FileFormatError("the header of a .safetensors file is no table")
    return header


def _place(name: str, given: object) -> tuple[tuple[int, ...], int, int]:
    """Shape, first byte and end of an array, as the header says."""
    if not isinstance(given, dict) or set(given) != {"dtype", "shape", "data_offsets"}:
        raise FileFormatError(f"entry {name!r:.80}: expected dtype, shape and data_offsets")
    if given["dtype"] != KIND:
        raise FileFormatError(
            f"entry {name!r:.80} holds {given['dtype']!r:.20} values where {KIND!r} is expected"
        )
    shape, offsets = given["shape"], given["data_offsets"]
    if not (_are_lengths(shape) and _are_lengths(offsets) and len(shape) <= 3):
        raise FileFormatError(f"entry {name!r:.80}: shape and data_offsets are lists of lengths")
    if len(offsets) != 2 or offsets[1] - offsets[0] != 8 * math.prod(shape):
        raise FileFormatError(f"entry {name!r:.80}: data_offsets {offsets!r:.60} do not fit")
    return tuple(shape), offsets[0], offsets[1]


def _are_lengths(given: object) -> bool:
    return isinstance(given, list) and all(type(n) is int and 0 <= n < 2**60 for n in given)
