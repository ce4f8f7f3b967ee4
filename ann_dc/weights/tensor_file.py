"""Named arrays in a ``.safetensors`` file, without a third-party package.

Format: eight bytes (little-endian) give the length of the header. The header is JSON. The arrays
follow without gaps, in the order of the header.

.. code-block:: json

    {"__metadata__": {"manifest": "..."},
     "tau/mu.x": {"dtype": "F64", "shape": [], "data_offsets": [0, 8]}}

The content is not executable. The written bytes are identical to the bytes that the package
``safetensors`` writes for the same arrays.

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
"""Bytes of the header length; the header length is a multiple of this number."""
MAX_HEADER = 4_000_000
"""Largest header size in bytes."""
KIND = "F64"
"""Only array type in the package's files."""


def packed_tensors(manifest: str, arrays: Mapping[str, object]) -> bytes:
    """Serialise a text and float arrays as one file; equal inputs give equal bytes.

    Raises `OutputError` if a name is not printable or the number of names exceeds the reader's
    limit.
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
    """Arrays of a ``.safetensors`` file.

    Raises `FileFormatError` if the content does not have this format, or if its arrays overlap,
    leave a gap or are invalid.

    Attributes
    ----------
    manifest : str
        Text in the header.
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
        """Check that every byte belongs to exactly one array."""
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
        """Return the array of the given name."""
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
    """Return the shape, first byte and end of an array from the header."""
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
