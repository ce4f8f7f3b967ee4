"""Functions as tables of integers, with straight lines between the entries."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.network.functions import FUNCTIONS

MARGIN = 0.25
"""How much further a table reaches than the arguments that a walk has seen, over their width."""
FEWEST, MOST = 16, 4096
"""Entries of a table."""


class Table(NamedTuple):
    """One function, for arguments and values of given formats."""

    domain: tuple[int, int]
    """Lowest and highest argument; others count as the nearest of these."""
    shift: int
    """An entry every 2^shift arguments."""
    entries: np.ndarray
    """(V,) int64; the last argument too has one to its right."""
    error: float
    """Largest error of a line between two entries, over one last bit of the value."""
    jump: float
    """Largest change of the value from one argument to the next, over the largest value."""


def made_table(code: int, seen: tuple[float, float], formats: tuple[int, int], bits: int) -> Table:
    """The table of a function block: the fewest entries whose lines are as near as the last bit.

    Parameters
    ----------
    code : int
        Of the function block.
    seen : (float, float)
        Lowest and highest argument of a walk, on one side of a pole.
    formats : (int, int)
        Fraction bits of arguments and of values.
    bits : int
        Of a word.

    Returns
    -------
    Table
    """
    top = 2 ** (bits - 1)
    ends = np.ldexp(reach(code, *seen), formats[0])
    first, last = np.clip(np.rint(ends), -top, top - 1).astype(np.int64).tolist()
    last = max(last, first + 1)
    shift = max((last - first) // FEWEST, 1).bit_length() - 1
    found = _table(code, (first, last), shift, formats, top)
    while found.error > 1.0 and shift > 0 and (last - first) >> (shift - 1) <= MOST:
        shift -= 1
        found = _table(code, (first, last), shift, formats, top)
    return found


def reach(code: int, low: float, high: float) -> tuple[float, float]:
    """The arguments of a table: beyond those seen by a margin, and within the function's domain.

    Parameters
    ----------
    code : int
        Of the function block.
    low, high : float
        Seen on a walk.
    """
    block = FUNCTIONS[code]
    margin = MARGIN * max(high - low, abs(low), abs(high), 1e-3)
    least, most = block.domain
    if block.has_pole:
        least, most = (0.0, most) if high > 0 else (least, 0.0)
    below = low - margin if np.isinf(least) else max(low - margin, (low + least) / 2)
    above = high + margin if np.isinf(most) else min(high + margin, (high + most) / 2)
    return below, above


def _table(
    code: int, domain: tuple[int, int], shift: int, formats: tuple[int, int], top: int
) -> Table:
    (x, y), (first, last) = formats, domain

    def value(argument: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.ldexp(FUNCTIONS[code].value(np.ldexp(argument.astype(float), -x)), y)

    at = first + (np.arange(((last - first) >> shift) + 2) << shift)
    values = value(np.minimum(at, last))
    inside = max(last - at[-2], 1)  # the last line ends beyond the domain, and is right within it
    values[-1] = values[-2] + (values[-1] - values[-2]) * (1 << shift) / inside
    entries = np.clip(np.rint(np.nan_to_num(values)), -top, top - 1).astype(np.int64)
    middle = value((at[:-1] + at[1:])[:-1] / 2)
    lines = (values[:-1] + values[1:])[:-1] / 2
    error = np.abs(middle - lines)[np.abs(middle) < top].max(initial=0.0)
    steepest = np.abs(np.diff(values)).max() / (1 << shift)
    return Table(domain, shift, entries, float(error), float(steepest / top))
