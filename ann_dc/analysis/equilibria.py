"""Where a network rests: the root of its drives, by Newton's method.

Time constants and coordinators do not matter, because the metric M of dx/ds = M d(x) is regular:
only d(x) = 0 is solved, with the exact block-tridiagonal Jacobian. Neurons whose drives push them
past the rails at which they stand rest there; those that are found beyond their rails are put
back, and the others follow, until none is left beyond. No line search and no damping: it is for a
state that is nearly settled, and refuses any other.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

NEWTON_STEPS = 20
"""Most that are taken; from a settled state two or three do."""

RAILS = 10
"""How often neurons are put back at their rails, at most."""

RESOLUTION = 1e-11
"""A step smaller than this, relative to the state, is the last one."""


@checked
def equilibrium(network: Network, x: State) -> np.ndarray:
    """The equilibrium (n,) near a state, by Newton's method on the drives.

    Parameters
    ----------
    network : Network
    x : (n,) array
        Where to begin; not changed.

    Returns
    -------
    (n,) array
        Between the rails.

    Raises
    ------
    NetworkError
        If there is none nearby between the rails, or the Jacobian is singular.

    Examples
    --------
    A linear problem needs one step, from anywhere:

    >>> from ann_dc import evaluator, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> x = equilibrium(network, network.start_state)
    >>> bool(np.abs(evaluator(network).drives(x)).max() < 1e-9)
    True
    """
    limits = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons])
    low, high = limits[network.places[:, 0]].T
    found = _root(network, np.array(x, float))
    for _ in range(RAILS):
        inside = np.clip(found, low, high)
        if (inside == found).all():
            return found
        found = _root(network, inside)
    raise NetworkError(
        f"{network.title}: Newton's method found no equilibrium between the rails; run the network "
        "and start from where it settled"
    )


def _root(network: Network, x: np.ndarray) -> np.ndarray:
    """Where Newton's method ends; neurons that stand at rails may rest there."""
    evaluator = fast_evaluator(network)
    scale = max(float(np.abs(x).max(initial=0.0)), 1.0)
    for _ in range(NEWTON_STEPS):
        try:
            jacobian, drives = evaluator.drive_jacobian(x).tocsc(), evaluator.drives(x)
            free = np.flatnonzero(~evaluator.resting(x, drives))
            step = np.zeros(network.size)
            step[free] = splu(jacobian[free][:, free]).solve(network.pack(drives)[free])
        except RuntimeError:
            break
        x = x - step
        size = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(size):
            break
        if size < RESOLUTION * scale:
            return x
    raise NetworkError(
        f"{network.title}: Newton's method found no equilibrium near the given state; "
        "run the network and start from where it settled"
    )
