"""How far rounding may carry a walk: where a start repels, its last bits grow from step to step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ann_dc.export.reference.vector import ReferenceVector

ROUNDING = 1e-15
"""By which the start is moved, over its own values."""
MARGIN = 1000.0
LEAST, MOST = 1e-9, 1e-2


def rounding_tolerance(
    vector: ReferenceVector, walk: Callable[[np.ndarray, int], np.ndarray]
) -> float:
    """Tolerance of `ReferenceVector.check` for another order of the same sums.

    Parameters
    ----------
    vector : ReferenceVector
    walk : function of a (P, N) array and a count
        As for `ReferenceVector.check`.

    Returns
    -------
    float
        1e-9, or more where last bits of the start grow to more.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import EulerWalk, reference_vector
    >>> network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    >>> vector = reference_vector(network)
    >>> walk = EulerWalk(network, vector.step)
    >>> states = lambda start, count: network.unpack(walk.after(network.pack(start), count))
    >>> rounding_tolerance(vector, states)
    1e-09
    """
    signs = np.where(np.arange(vector.start.size) % 2, 1.0, -1.0).reshape(vector.start.shape)
    moved, count = (
        vector.start + ROUNDING * np.maximum(1.0, np.abs(vector.start)) * signs,
        max(vector.early),
    )
    apart = walk(moved, count) - walk(vector.start, count)
    worst = float(np.abs(apart).max() / max(1.0, np.abs(vector.early[count]).max()))
    return float(np.clip(MARGIN * worst, LEAST, MOST)) if np.isfinite(worst) else MOST
