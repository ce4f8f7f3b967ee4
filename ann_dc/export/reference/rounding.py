"""Comparing walks that add up in another order: where a start repels, last bits grow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from ann_dc.export.reference.vector import ReferenceVector, check_states

Precision: TypeAlias = Literal["float64", "float32"]
"""What an export computes in."""
TOLERANCES: dict[Precision, float] = {"float64": 1e-9, "float32": 1e-3}
"""Largest difference of two walks of a precision, over the largest state or one."""

Walk: TypeAlias = Callable[[np.ndarray, int], np.ndarray]
"""The states (P, N) so many steps after a start (P, N)."""
ROUNDING: dict[Precision, float] = {"float64": 1e-15, "float32": 1e-7}
"""By which the start is moved, over its own values."""
MARGIN = 1000.0
MOST = 0.5
"""Largest difference, however far rounding grows."""


def compare(vector: ReferenceVector, walk: Walk, precision: Precision = "float64") -> float:
    """`ReferenceVector.check` of a walk that rounds otherwise, and lets that grow.

    The first steps are compared as they are. How far rounding has grown after more of them is seen
    on the walk itself, started beside the start; but no walk may be more than `MOST` off.

    Parameters
    ----------
    vector : ReferenceVector
    walk : function of a (P, N) array and a count
        As for `ReferenceVector.check`.
    precision : str
        What it is computed in.

    Returns
    -------
    float
        The largest difference there was.

    Raises
    ------
    FileFormatError
        If a difference is larger than that of the precision, and than a thousand times what
        moving the start by its last bits makes of them.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import EulerWalk, reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> vector = reference_vector(network)
    >>> walk = EulerWalk(network, vector.step)
    >>> compare(vector, lambda x, count: network.unpack(walk.after(network.pack(x), count)))
    0.0
    """
    tolerance, first, worst = TOLERANCES[precision], min(vector.early), 0.0
    start = vector.start
    signs = np.where(np.arange(start.size) % 2, 1.0, -1.0).reshape(start.shape)
    moved = start + ROUNDING[precision] * np.maximum(1.0, np.abs(start)) * signs
    for count, expected in vector.early.items():
        states, allowed = walk(start, count), tolerance
        if count > first:
            grown = np.abs(walk(moved, count) - states).max() / max(1.0, np.abs(states).max())
            allowed += min(MARGIN * grown, MOST) if np.isfinite(grown) else 0.0
        worst = max(worst, check_states(states, expected, allowed))
    return worst
