"""TODO: the idea."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.network.network import Network

NEWTON_STEPS = 20


def equilibrium(network: Network, x: np.ndarray) -> np.ndarray:
    """The equilibrium (n,) near a state, by Newton's method on the drives.

    Raises
    ------
    NetworkError
        If there is none nearby, or the Jacobian is singular.
    """
    kernel = CompiledEvaluator(network)
    x = np.array(x, float)
    scale = max(float(np.abs(x).max(initial=0.0)), 1.0)
    for _ in range(NEWTON_STEPS):
        try:
            step = splu(kernel.drive_jacobian(x).tocsc()).solve(network.pack(kernel.drives(x)))
        except RuntimeError:
            break
        x = x - step
        size = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(size):
            break
        if size < 1e-11 * scale:
            return x
    raise NetworkError(
        f"{network.title}: Newton's method found no equilibrium near the given state; "
        "run the network and start from where it settled"
    )
