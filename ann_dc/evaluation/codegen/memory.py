"""Arrays that vector code reads: each begins at a line of the cache.

A vector that lies in two lines costs as much as two vectors.
"""

from __future__ import annotations

from typing import Any

import numpy as np

LINE = 64
"""Bytes of a line of the cache, and of the widest vector."""


def lined_up(array: Any) -> np.ndarray:
    """A copy that begins at a line.

    Parameters
    ----------
    array : array_like

    Returns
    -------
    np.ndarray
        Contiguous.

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
