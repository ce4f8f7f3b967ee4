"""Named arrays in an ``.npz`` file, written whole and read with distrust.

A file may come from anyone: an entry is taken only with the type and shape that the reader asks
for, nothing is unpickled, and no entry may claim more memory than the file has bytes.
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping

import numpy as np

from ann_dc.errors import FileFormatError, OutputError

BROKEN = (zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, ValueError)
"""What reading a damaged zip file may raise."""


def packed_entries(text: Mapping[str, str], arrays: Mapping[str, object]) -> bytes:
    """Text and float arrays as entries of one file; equal entries give equal bytes.

    Parameters
    ----------
    text, arrays : mapping of entry name to str and to array

    Returns
    -------
    bytes

    Raises
    ------
    OutputError
        If a name is not printable.
    """
    for name in arrays:
        if not name.isprintable():
            raise OutputError(f"entry {name!r}: a file has printable names only; rename the node")
    entries = {name: np.frombuffer(given.encode(), np.uint8) for name, given in text.items()}
    entries |= {name: np.array(value, "<f8", order="C") for name, value in arrays.items()}
    stream = io.BytesIO()
    np.savez(stream, **entries)  # type: ignore[arg-type]
    return stream.getvalue()


class Entries:
    """The entries of a file, each taken once; what is left at the end does not belong there.

    Parameters
    ----------
    archive : zipfile.ZipFile
    size : int
        Bytes of the file: entries that claim more are refused.

    Raises
    ------
    FileFormatError
        If the entries claim to be larger than the file, or one occurs twice.
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

    def _open(self, name: str, dtype: str) -> tuple[tuple[int, ...], bytes]:
        """Shape and data of an entry, whose header has to say what `save` writes."""
        info = self._infos.pop(name, None)
        if info is None:
            raise FileFormatError(f"entry {name!r} is missing; save the network again")
        stream = io.BytesIO(self._archive.read(info))
        try:
            version = np.lib.format.read_magic(stream)
            shape, fortran, found = np.lib.format.read_array_header_1_0(stream)
        except ValueError as error:
            raise FileFormatError(f"entry {name!r} is not a NumPy array: {error}") from error
        if version != (1, 0) or fortran or found != np.dtype(dtype):
            raise FileFormatError(
                f"entry {name!r} holds {found} values where {np.dtype(dtype)} is expected; "
                "objects are never unpickled"
            )
        return shape, stream.read()

    def array(self, name: str, *shapes: tuple[int | None, ...], rails: bool = False) -> np.ndarray:
        """Take an array of one of the shapes (None: any); only ``rails`` may be infinite.

        Raises
        ------
        FileFormatError
            If the entry is missing, is no array of float64 of such a shape, or not finite.
        """
        values = self.numbers(name, *shapes)
        if np.isnan(values).any() or not (rails or np.isfinite(values).all()):
            raise FileFormatError(f"entry {name!r} holds a value that is not finite")
        return values

    def numbers(self, name: str, *shapes: tuple[int | None, ...]) -> np.ndarray:
        """Take an array of one of the shapes (None: any), whatever its numbers are.

        Raises
        ------
        FileFormatError
            If the entry is missing, or is no array of float64 of such a shape.
        """
        shape, data = self._open(name, "<f8")
        if not any(_fits(shape, given) for given in shapes) or len(data) != 8 * int(np.prod(shape)):
            expected = " or ".join(map(str, shapes))
            raise FileFormatError(f"entry {name!r} has shape {shape}, expected {expected}")
        return np.frombuffer(data, "<f8").reshape(shape).astype(float)

    def one_or_each(self, name: str, stages: int) -> float | np.ndarray:
        """Take one number, or one a stage, (N,)."""
        values = self.array(name, (), (stages,))
        return values if values.ndim else float(values)

    def text(self, name: str, largest: int) -> str:
        """Take UTF-8 text of at most ``largest`` bytes.

        Raises
        ------
        FileFormatError
            If the entry is missing, larger, or no such text.
        """
        if name in self._infos and self._infos[name].file_size > largest:
            raise FileFormatError(f"entry {name!r} is larger than {largest} bytes")
        _, data = self._open(name, "u1")
        try:
            return data.decode("utf-8")
        except UnicodeDecodeError as error:
            raise FileFormatError(f"entry {name!r} is not UTF-8 text: {error}") from error

    def finish(self) -> None:
        """Refuse what nobody took.

        Raises
        ------
        FileFormatError
            Naming what is left.
        """
        if self._infos:
            raise FileFormatError(f"unknown entries: {', '.join(sorted(self._infos))}; remove them")


def _fits(shape: tuple[int, ...], given: tuple[int | None, ...]) -> bool:
    return len(shape) == len(given) and all(b in (None, a) for a, b in zip(shape, given))
