"""Strict reader of integer entries in a file."""

from __future__ import annotations

import numpy as np

from ann_dc.errors import FileFormatError
from ann_dc.weights.manifest import Table

NAME = "fixed_point.json"


def require(holds: bool, place: str, why: str) -> None:
    """Raise `FileFormatError` with a place and a reason unless ``holds`` is true."""
    if not holds:
        raise FileFormatError(f"{place}: {why}")


def within(place: str, indices: np.ndarray, count: int) -> None:
    """Raise `FileFormatError` if an index is outside 0 to count - 1."""
    inside = bool(((indices >= 0) & (indices < count)).all())
    require(inside, place, f"an index is not in 0 .. {count - 1}")


def integers(table: Table, key: str, width: int, span: tuple[int, int]) -> np.ndarray:
    """Read rows of integers as an int64 array (..., width).

    A width of 0 denotes a plain list, and ``span`` gives the lowest and highest integer. Raises
    `FileFormatError` for other content.
    """
    given, place = table.get(key, list), f"{NAME}: {key}"
    if width:
        fit = all(isinstance(row, list) and len(row) == width for row in given)
        require(fit, place, f"expected rows of {width} integers")
    flat = [value for row in given for value in row] if width else given
    whole = all(type(value) is int and span[0] <= value <= span[1] for value in flat)
    require(whole, place, f"expected integers from {span[0]} to {span[1]}")
    return np.array(flat, np.int64).reshape((-1, width) if width else -1)
