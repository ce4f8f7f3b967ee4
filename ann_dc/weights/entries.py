"""Named arrays in ``.npz`` and ``.safetensors`` files: writers and strict readers.

A file may come from an untrusted source. An entry is accepted only with the type and shape that the
reader requests, and entries that were never requested raise an error at the end.

The ``.npz`` reader does not unpickle, decompress or evaluate a header as Python; it accepts only
headers that match `SPELLING`. The memory that an entry claims may not exceed the size of the file.

In a ``.safetensors`` file, eight bytes (little-endian) give the length of the JSON header, and the
arrays follow without gaps in its order. The written bytes are those of the package ``safetensors``.

.. code-block:: json

    {"__metadata__": {"manifest": "..."},
     "tau/mu.x": {"dtype": "F64", "shape": [], "data_offsets": [0, 8]}}

References
----------
https://huggingface.co/docs/safetensors, section Format.
"""

from __future__ import annotations

import io
import json
import math
import re
import struct
import zipfile
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import NamedTuple, final

import numpy as np

from ann_dc.errors import FileFormatError, OutputError
from ann_dc.weights.manifest import MOST_TABLES, read_json, tables_in

NUMBER, BYTE = "float64", "uint8"
"""Array types that occur in the package's files."""
LONGEST = 1_000_000
"""Largest axis length of an array without elements."""

BROKEN = (
    zipfile.BadZipFile,
    zlib.error,
    struct.error,
    OSError,
    EOFError,
    OverflowError,
    RuntimeError,
    ValueError,
)
"""Exceptions that reading a damaged zip file may raise."""
MAGIC = b"\x93NUMPY\x01\x00"
SPELLING = re.compile(
    rb"\{'descr': '([<>|][biufcOSUV][0-9]{0,2})', 'fortran_order': (False|True), "
    rb"'shape': \(((?:[0-9]{1,18}, ?)*(?:[0-9]{1,18})?)\), \} *\n"
)
"""Pattern of an array header as written by NumPy."""
METADATA = "__metadata__"
PREFIX = 8
"""Bytes of the header length; the header length is a multiple of this number."""
MAX_HEADER = 4_000_000
"""Largest header size in bytes."""
KIND = "F64"
"""Only array type in the package's files."""


class Stored(NamedTuple):
    """Array as stored: NumPy's name of its type, and little-endian data in C order."""

    kind: str
    shape: tuple[int, ...]
    data: bytes | memoryview


class Entries(ABC):
    """Entries of a file, each taken once; those that remain at the end are invalid.

    ``taken`` are the numeric arrays that have been taken, by name.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._left = dict.fromkeys(names)
        self.taken: dict[str, np.ndarray] = {}
        odd = [name for name in self._left if not name.isprintable()]
        if odd:
            raise FileFormatError(f"entry {odd[0]!r:.80}: expected a printable name")

    @abstractmethod
    def stored(self, name: str) -> Stored:
        """Return the existing entry of the given name."""

    def _open(self, name: str, kind: str) -> tuple[tuple[int, ...], bytes | memoryview]:
        """Return the shape and data of an entry after checking its type."""
        if name not in self._left:
            raise FileFormatError(f"entry {name!r} is missing; save the network again")
        del self._left[name]
        found = self.stored(name)
        if found.kind != kind:
            raise FileFormatError(
                f"entry {name!r} holds {found.kind} values where {kind} is expected; "
                "objects are never unpickled"
            )
        return found.shape, found.data

    def array(self, name: str, *shapes: tuple[int | None, ...], limits: bool = False) -> np.ndarray:
        """Take a finite array with one of the given shapes (None: any length), as `numbers` does.

        Only the array ``limits`` may contain infinite values. Raises `FileFormatError` otherwise.
        """
        values = self.numbers(name, *shapes)
        if np.isnan(values).any() or not (limits or np.isfinite(values).all()):
            raise FileFormatError(f"entry {name!r} holds a value that is not finite")
        return values

    def numbers(self, name: str, *shapes: tuple[int | None, ...]) -> np.ndarray:
        """Take a float64 array with one of the given shapes, or raise `FileFormatError`."""
        shape, data = self._open(name, NUMBER)
        if not any(_fits(shape, given) for given in shapes) or len(data) != 8 * math.prod(shape):
            expected = " or ".join(map(str, shapes))
            raise FileFormatError(f"entry {name!r} has shape {shape}, expected {expected}")
        values = np.frombuffer(data, "<f8").reshape(shape).astype(float)
        self.taken[name] = values
        return values

    def one_or_each(self, name: str, stages: int) -> float | np.ndarray:
        """Take a single number or one number per stage, shape (N,)."""
        values = self.array(name, (), (stages,))
        return values if values.ndim else float(values)

    def finish(self) -> None:
        """Raise `FileFormatError` with the names of entries that were not taken."""
        if self._left:
            names = ", ".join(sorted(self._left))
            raise FileFormatError(f"unknown entries: {names:.300}; remove them")


def _fits(shape: tuple[int, ...], given: tuple[int | None, ...]) -> bool:
    """Return True if a shape matches; without elements, no axis may exceed `LONGEST`."""
    same = len(shape) == len(given) and all(b in (None, a) for a, b in zip(shape, given))
    return same and (0 not in shape or max(shape) <= LONGEST)


def packed_entries(text: Mapping[str, str], arrays: Mapping[str, object]) -> bytes:
    """Serialise texts and float arrays as one file; equal entries give equal bytes."""
    _check_printable(arrays)
    entries = {name: np.frombuffer(given.encode(), np.uint8) for name, given in text.items()}
    entries |= {name: np.array(value, "<f8", order="C") for name, value in arrays.items()}
    stream = io.BytesIO()
    np.savez(stream, **entries)  # type: ignore[arg-type]
    return stream.getvalue()


def _check_printable(names: Mapping[str, object]) -> None:
    """Raise `OutputError` if a name is not allowed in a file."""
    for name in names:
        if not name.isprintable():
            raise OutputError(f"entry {name!r}: expected a printable name; rename the node")


@final
class NpzEntries(Entries):
    """Entries of an ``.npz`` file of ``size`` bytes."""

    def __init__(self, archive: zipfile.ZipFile, size: int) -> None:
        infos = archive.infolist()
        if sum(info.file_size for info in infos) > size:
            raise FileFormatError(
                "its entries claim to be larger than the file; save the network again"
            )
        self._archive = archive
        self._infos = {info.filename.removesuffix(".npy"): info for info in infos}
        if len(self._infos) < len(infos):
            raise FileFormatError("an entry occurs twice; save the network again")
        super().__init__(self._infos)

    def stored(self, name: str) -> Stored:
        """Return the array of the given name, or raise `FileFormatError` if it is compressed."""
        info = self._infos[name]
        if info.compress_type != zipfile.ZIP_STORED:
            raise FileFormatError(f"entry {name!r} is compressed; save the network again")
        content = self._archive.read(info)
        start = len(MAGIC) + 2
        end = start + int.from_bytes(content[len(MAGIC) : start], "little")
        header = SPELLING.fullmatch(content, start, end)
        if not content.startswith(MAGIC) or header is None:
            raise FileFormatError(f"entry {name!r} is not a NumPy array as `save` writes it")
        kind, fortran, lengths = header.groups()
        shape = tuple(int(length) for length in lengths.split(b",") if length.strip())
        word = _word(kind.decode()) + (" (Fortran order)" if fortran == b"True" else "")
        return Stored(word, shape, memoryview(content)[end:])

    def text(self, name: str, largest: int) -> str:
        """Take UTF-8 text of at most ``largest`` bytes, or raise `FileFormatError`."""
        if name in self._infos and self._infos[name].file_size > largest:
            raise FileFormatError(f"entry {name!r} is larger than {largest} bytes")
        _, data = self._open(name, BYTE)
        try:
            return bytes(data).decode("utf-8")
        except UnicodeDecodeError as error:
            raise FileFormatError(f"entry {name!r} is not UTF-8 text: {error}") from error


def _word(kind: str) -> str:
    """Return NumPy's name of a type, or its letters if NumPy does not know the type."""
    try:
        found = np.dtype(kind)
    except TypeError:
        return kind
    return found.name if found.isnative else kind


def packed_tensors(manifest: str, arrays: Mapping[str, object]) -> bytes:
    """Serialise a text and float arrays as one file; equal inputs give equal bytes.

    Raises `OutputError` if the number of names exceeds the reader's limit.
    """
    _check_printable(arrays)
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
    """Arrays of a ``.safetensors`` file; ``manifest`` is the text in its header."""

    def __init__(self, content: bytes) -> None:
        length = int.from_bytes(content[:PREFIX], "little")
        if len(content) < PREFIX or not 2 <= length <= min(len(content) - PREFIX, MAX_HEADER):
            raise FileFormatError(
                "not a complete .safetensors file (the length of its header is invalid); save "
                "the network again"
            )
        header = _header(content[PREFIX : PREFIX + length])
        metadata = header.pop(METADATA, None)
        if not isinstance(metadata, dict) or not isinstance(metadata.get("manifest"), str):
            raise FileFormatError("its header has no manifest; the file may not be a saved network")
        if len(metadata) > 1:
            raise FileFormatError(
                "its header contains more than a manifest; save the network again"
            )
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
        raise FileFormatError("the header of a .safetensors file is not a table")
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
