"""Named arrays of a file, read with distrust: each is taken once, by name, type and shape.

A file may come from anyone: an entry is taken only as what the reader asks for, and what nobody
asked for is refused at the end. Where the entries lie, and how, is the file form's business.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ann_dc.errors import FileFormatError

NUMBER, BYTE = "float64", "uint8"
"""Types that a file of ours has."""
LONGEST = 1_000_000
"""Longest axis of an array that holds nothing."""


class Stored(NamedTuple):
    """An array as a file has it."""

    kind: str
    """Its type, in NumPy's words."""
    shape: tuple[int, ...]
    """Lengths of its axes."""
    data: bytes | memoryview
    """Little-endian, last axis first."""


class Entries(ABC):
    """The entries of a file, each taken once; what is left at the end does not belong there.

    Parameters
    ----------
    names : iterable of str
        Of all entries.

    Attributes
    ----------
    taken : dict of str to array
        The arrays of numbers that were taken.

    Raises
    ------
    FileFormatError
        If a name cannot be printed.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._left = dict.fromkeys(names)
        self.taken: dict[str, np.ndarray] = {}
        odd = [name for name in self._left if not name.isprintable()]
        if odd:
            raise FileFormatError(f"entry {odd[0]!r:.80}: a file has printable names only")

    @abstractmethod
    def stored(self, name: str) -> Stored:
        """The entry of a name that there is.

        Raises
        ------
        FileFormatError
            If what lies there is no array.
        """

    def _open(self, name: str, kind: str) -> tuple[tuple[int, ...], bytes | memoryview]:
        """Shape and data of an entry, which has to be of a type."""
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
        shape, data = self._open(name, NUMBER)
        if not any(_fits(shape, given) for given in shapes) or len(data) != 8 * math.prod(shape):
            expected = " or ".join(map(str, shapes))
            raise FileFormatError(f"entry {name!r} has shape {shape}, expected {expected}")
        values = np.frombuffer(data, "<f8").reshape(shape).astype(float)
        self.taken[name] = values
        return values

    def one_or_each(self, name: str, stages: int) -> float | np.ndarray:
        """Take one number, or one a stage, (N,)."""
        values = self.array(name, (), (stages,))
        return values if values.ndim else float(values)

    def finish(self) -> None:
        """Refuse what nobody took.

        Raises
        ------
        FileFormatError
            Naming what is left.
        """
        if self._left:
            names = ", ".join(sorted(self._left))
            raise FileFormatError(f"unknown entries: {names:.300}; remove them")


def _fits(shape: tuple[int, ...], given: tuple[int | None, ...]) -> bool:
    """Whether a shape is the given one; one without numbers claims no length beyond `LONGEST`."""
    same = len(shape) == len(given) and all(b in (None, a) for a, b in zip(shape, given))
    return same and (0 not in shape or max(shape) <= LONGEST)
