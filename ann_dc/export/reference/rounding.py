"""Comparing walks that add up in another order: where a start repels, last bits grow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from ann_dc.export.reference.vector import ReferenceVector

Precision: TypeAlias = Literal["float64", "float32"]
"""What an export computes in."""
TOLERANCES: dict[Precision, float] = {"float64": 1e-9, "float32": 1e-3}
"""Largest difference of two walks of a precision, over the largest state or one."""

Walk: TypeAlias = Callable[[np.ndarray, int], np.ndarray]
"""The states (P, N) so many steps after a start (P, N)."""
ROUNDING = 1e-15
"""By which the start is moved, over its own values."""
MARGIN = 1000.0


def compare(vector: ReferenceVector, walk: Walk, tolerance: float = 1e-9) -> float:
    """`ReferenceVector.check`, with as much tolerance as rounding needs after each count of steps.

    Parameters
    ----------
    vector : ReferenceVector
    walk : function of a (P, N) array and a count
        As for `ReferenceVector.check`.
    tolerance : float
        The least.

    Returns
    -------
    float
        The largest difference there was.

    Raises
    ------
    FileFormatError
        If a difference is larger than the tolerance, and than a thousand times what moving the
        start by its last bits makes of them.

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
    worst = 0.0
    for count, states in vector.early.items():
        allowed = max(tolerance, MARGIN * _grown(vector.start, walk, count))
        worst = max(worst, replace(vector, early={count: states}).check(walk, allowed))
    return worst


def _grown(start: np.ndarray, walk: Walk, count: int) -> float:
    """What the last bits of the start are after some steps, over the largest state."""
    signs = np.where(np.arange(start.size) % 2, 1.0, -1.0).reshape(start.shape)
    moved = start + ROUNDING * np.maximum(1.0, np.abs(start)) * signs
    states = walk(start, count)
    apart = np.abs(walk(moved, count) - states).max() / max(1.0, np.abs(states).max())
    return float(apart) if np.isfinite(apart) else np.inf
