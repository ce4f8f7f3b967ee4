"""Named arrays in an ``.npz`` file: writer and strict reader.

The reader does not unpickle, decompress or evaluate a header as Python; it accepts only headers
that match `SPELLING`. The memory that an entry claims may not exceed the size of the file.
"""

from __future__ import annotations

import io
import re
import struct
import zipfile
import zlib
from collections.abc import Mapping
from typing import final

import numpy as np

from ann_dc.errors import FileFormatError, OutputError
from ann_dc.weights.entries import BYTE, Entries, Stored

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


def packed_entries(text: Mapping[str, str], arrays: Mapping[str, object]) -> bytes:
    """Serialise texts and float arrays as one file; equal entries give equal bytes.

    Raises `OutputError` if a name is not printable.
    """
    check_printable(arrays)
    entries = {name: np.frombuffer(given.encode(), np.uint8) for name, given in text.items()}
    entries |= {name: np.array(value, "<f8", order="C") for name, value in arrays.items()}
    stream = io.BytesIO()
    np.savez(stream, **entries)  # type: ignore[arg-type]
    return stream.getvalue()


def check_printable(names: Mapping[str, object]) -> None:
    """Raise `OutputError` if a name is not allowed in a file."""
    for name in names:
        if not name.isprintable():
            raise OutputError(f"entry {name!r}: a file has printable names only; rename the node")


@final
class NpzEntries(Entries):
    """Entries of an ``.npz`` file.

    Raises `FileFormatError` if the entries claim more memory than the file has bytes (``size``), or
    if an entry occurs twice.
    """

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
        """Return the array of the given name.

        Raises `FileFormatError` if the header differs from NumPy's notation or the entry is
        compressed.
        """
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
        """Take UTF-8 text of at most ``largest`` bytes.

        Raises `FileFormatError` if the entry is missing, larger, or not UTF-8 text.
        """
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
