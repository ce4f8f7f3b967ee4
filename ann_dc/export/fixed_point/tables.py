"""Integer tables of functions, with linear interpolation between entries."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.network.functions import FUNCTIONS

MARGIN = 0.25
"""Extension of a table beyond the observed arguments, relative to their range."""
FEWEST, MOST = 16, 4096
"""Minimum and maximum number of table entries."""


class Table(NamedTuple):
    """Table of one function, for given formats of arguments and values."""

    domain: tuple[int, int]
    """Lowest and highest argument; other arguments are clipped to these."""
    shift: int
    """Spacing of entries as a power of two: 2^shift arguments."""
    entries: np.ndarray
    """Entries (V,) int64; the last argument also has an entry to its right."""
    error: float
    """Largest interpolation error, in units of the last bit of a value of ``bits`` bits."""
    jump: float
    """Largest change of the value between adjacent arguments, relative to the largest value."""


def made_table(
    code: int, seen: tuple[float, float], formats: tuple[int, int], bits: int, guard: int = 0
) -> Table:
    """Build the table of a function block whose interpolation error is within the last bit.

    The table has the fewest entries, for arguments ``seen`` in trajectories on one side of a pole.
    Arguments and values of ``bits`` bits have ``formats`` fraction bits, entries ``guard`` more.
    """
    top = 2 ** (bits - 1)
    ends = np.ldexp(_reach(code, *seen), formats[0])
    first, last = np.clip(np.rint(ends), -top, top - 1).astype(np.int64).tolist()
    last = max(last, first + 1)
    first, last = _fitting(code, (first, last), formats, top)
    shift = max((last - first) // FEWEST, 1).bit_length() - 1
    found = _table(code, (first, last), shift, formats, (top, guard))
    while found.error > 1.0 and shift > 0 and (last - first) >> (shift - 1) <= MOST:
        shift -= 1
        found = _table(code, (first, last), shift, formats, (top, guard))
    return found


def _fitting(
    code: int, domain: tuple[int, int], formats: tuple[int, int], top: int
) -> tuple[int, int]:
    """Return the central part of a domain in which all values fit into words."""
    at = np.unique(np.linspace(*domain, MOST).astype(np.int64))
    outside = ~(np.abs(_values(code, at, formats)) < top - 1)
    middle = len(at) // 2
    below, above = np.flatnonzero(outside[:middle]), np.flatnonzero(outside[middle:])
    first = at[below[-1] + 1] if len(below) else at[0]
    last = at[middle + above[0] - 1] if len(above) else at[-1]
    return int(first), max(int(last), int(first) + 1)


def _values(code: int, arguments: np.ndarray, formats: tuple[int, int]) -> np.ndarray:
    """Return function values at arguments, both as integers with fraction bits."""
    x, y = formats
    with np.errstate(all="ignore"):
        return np.ldexp(FUNCTIONS[code].value(np.ldexp(arguments.astype(float), -x)), y)


def _reach(code: int, low: float, high: float) -> tuple[float, float]:
    """Return the observed range with a margin, within the domain of the function block."""
    block = FUNCTIONS[code]
    margin = MARGIN * max(high - low, abs(low), abs(high), 1e-3)
    least, most = block.domain
    if block.has_pole:
        least, most = (0.0, most) if high > 0 else (least, 0.0)
    below = low - margin if np.isinf(least) else max(low - margin, (low + least) / 2)
    above = high + margin if np.isinf(most) else min(high + margin, (high + most) / 2)
    return below, above


def _table(
    code: int,
    domain: tuple[int, int],
    shift: int,
    formats: tuple[int, int],
    size: tuple[int, int],
) -> Table:
    (first, last), (top, guard) = domain, size
    at = first + (np.arange(((last - first) >> shift) + 2) << shift)
    values = _values(code, np.minimum(at, last), formats)
    inside = max(last - at[-2], 1)  # the last line ends beyond the domain, and is right within it
    values[-1] = values[-2] + (values[-1] - values[-2]) * (1 << shift) / inside
    fine = np.rint(np.ldexp(np.nan_to_num(values), guard))
    entries = np.clip(fine, -top << guard, (top << guard) - 1).astype(np.int64)
    middle = _values(code, (at[:-1] + at[1:])[:-1] / 2, formats)
    lines = (values[:-1] + values[1:])[:-1] / 2
    error = np.abs(middle - lines)[np.abs(middle) < top].max(initial=0.0)
    steepest = np.abs(np.diff(values)).max() / (1 << shift)
    return Table(domain, shift, entries, float(error), float(steepest / top))
