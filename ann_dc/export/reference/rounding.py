"""Comparison of runs with different summation order, which may amplify rounding.

Rounding errors grow if the flow is unstable at the start.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeAlias

import numpy as np

from ann_dc.export.reference.vector import ReferenceVector, check_states

Precision: TypeAlias = Literal["float64", "float32"]
"""Precision of an export's computations."""
TOLERANCES: dict[Precision, float] = {"float64": 1e-9, "float32": 1e-3}
"""Largest difference of two runs by precision, relative to the largest state or one."""

Walk: TypeAlias = Callable[[np.ndarray, int], np.ndarray]
"""Function that returns the states (P, N) after a number of steps from a start (P, N)."""
ROUNDING: dict[Precision, float] = {"float64": 1e-15, "float32": 1e-7}
"""Perturbation of the start, relative to its values or one."""
MARGIN = 1000.0
MOST = 0.5
"""Largest permitted difference, for any growth of rounding errors."""


def compare(vector: ReferenceVector, walk: Walk, precision: Precision = "float64") -> float:
    """Apply `ReferenceVector.check` with a tolerance for growing rounding errors.

    The first steps are compared without this tolerance. The growth after more steps is measured
    with a second run from a perturbed start. No difference may exceed `MOST`.

    Returns the largest difference. Raises `FileFormatError` if a difference exceeds both the
    tolerance of the precision and a thousand times the effect of perturbing the last bits of the
    start.

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
