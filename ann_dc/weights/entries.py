"""Strict reader of named arrays: one access per entry, by name, type and shape.

A file may come from an untrusted source. An entry is accepted only with the type and shape that the
reader requests, and entries that were never requested raise an error at the end. The position and
encoding of the entries depend on the file format.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ann_dc.errors import FileFormatError

NUMBER, BYTE = "float64", "uint8"
"""Array types that occur in the package's files."""
LONGEST = 1_000_000
"""Largest axis length of an array without elements."""


class Stored(NamedTuple):
    """Array as stored in a file."""

    kind: str
    """Type name in NumPy's notation."""
    shape: tuple[int, ...]
    """Lengths of the axes."""
    data: bytes | memoryview
    """Little-endian data in C order (last axis varies fastest)."""


class Entries(ABC):
    """Entries of a file, each taken once; entries that remain at the end are invalid.

    Raises `FileFormatError` if a name is not printable.

    Attributes
    ----------
    taken : dict of str to array
        Numeric arrays that have been taken.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._left = dict.fromkeys(names)
        self.taken: dict[str, np.ndarray] = {}
        odd = [name for name in self._left if not name.isprintable()]
        if odd:
            raise FileFormatError(f"entry {odd[0]!r:.80}: a file has printable names only")

    @abstractmethod
    def stored(self, name: str) -> Stored:
        """Return the existing entry of the given name.

        Raises `FileFormatError` if the entry is not an array.
        """

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

    def array(self, name: str, *shapes: tuple[int | None, ...], rails: bool = False) -> np.ndarray:
        """Take an array with one of the given shapes (None: any length).

        Only the array ``rails`` may contain infinite values. Raises `FileFormatError` if the entry
        is missing, is not a float64 array of such a shape, or is not finite.
        """
        values = self.numbers(name, *shapes)
        if np.isnan(values).any() or not (rails or np.isfinite(values).all()):
            raise FileFormatError(f"entry {name!r} holds a value that is not finite")
        return values

    def numbers(self, name: str, *shapes: tuple[int | None, ...]) -> np.ndarray:
        """Take an array with one of the given shapes (None: any length), with any values.

        Raises `FileFormatError` if the entry is missing or is not a float64 array of such a shape.
        """
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
