"""Cache-line alignment of the arrays that vector code reads.

A vector that crosses a cache line costs as much as two vectors.
"""

from __future__ import annotations

from typing import Any

import numpy as np

LINE = 64
"""Bytes of a cache line, and of the widest vector."""


def lined_up(array: Any) -> np.ndarray:
    """Return a contiguous copy of an array that begins at a cache line.

    Examples
    --------
    >>> lined_up([1.0, 2.0]).ctypes.data % LINE
    0
    """
    source = np.asarray(array)
    room = np.empty(source.nbytes + LINE, np.uint8)
    first = -room.ctypes.data % LINE
    found = room[first : first + source.nbytes].view(source.dtype).reshape(source.shape)
    found[...] = source
    return found
