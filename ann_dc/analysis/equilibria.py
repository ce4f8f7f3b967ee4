"""Equilibrium of a network: root of its drives by Newton's method.

Time constants and coarse-level neurons have no effect, because the preconditioner M of dx/ds = M
d(x) is regular. Only d(x) = 0 is solved, with the exact block-tridiagonal Jacobian. Neurons at a
limit whose drives push them beyond the limit are saturated and remain there. Neurons found beyond
their limits are set to the limits and the others are solved again, until none is beyond. Without
line search and damping, the method requires a nearly settled state and rejects any other.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import splu

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.network.network import Network
from ann_dc.validation import State, checked

_NEWTON_STEPS = 20
"""Largest number of Newton steps; a settled state needs two or three."""

_RAILS = 10
"""Largest number of resets of neurons to their limits."""

_RESOLUTION = 1e-11
"""Step, relative to the state, below which the iteration ends."""


@checked
def equilibrium(network: Network, x: State) -> np.ndarray:
    """Find the equilibrium (n,) near a state by Newton's method on the drives.

    Inputs that change over time have their values at time zero; for another time pass
    ``network.at_time(time)``.

    Parameters
    ----------
    network : Network
        Network with n neurons.
    x : (n,) array
        Initial state; not changed.

    Returns
    -------
    (n,) array
        Equilibrium within the saturation limits.

    Raises
    ------
    NetworkError
        If no equilibrium within the limits is nearby, or the Jacobian is singular.

    Examples
    --------
    A linear problem needs one step from any state:

    >>> from ann_dc import evaluator, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> x = equilibrium(network, network.start_state)
    >>> bool(np.abs(evaluator(network).drives(x)).max() < 1e-9)
    True
    """
    limits = np.array([(n.limiter.low, n.limiter.high) for n in network.cell.neurons])
    low, high = limits[network.places[:, 0]].T
    found = _root(network, np.array(x, float))
    for _ in range(_RAILS):
        inside = np.clip(found, low, high)
        if (inside == found).all():
            return found
        found = _root(network, inside)
    raise NetworkError(
        f"{network.title}: Newton's method found no equilibrium within the saturation limits; "
        "run the network and use its settled state as the initial state"
    )


def _root(network: Network, x: np.ndarray) -> np.ndarray:
    """Return the limit of Newton's method; saturated neurons may stay saturated."""
    evaluator = fast_evaluator(network)
    scale = max(float(np.abs(x).max(initial=0.0)), 1.0)
    for _ in range(_NEWTON_STEPS):
        try:
            jacobian, drives = evaluator.drive_jacobian(x).tocsc(), evaluator.drives(x)
            free = np.flatnonzero(~evaluator.saturated(x, drives))
            step = np.zeros(network.size)
            step[free] = splu(jacobian[free][:, free]).solve(network.pack(drives)[free])
        except RuntimeError:
            break
        x = x - step
        size = float(np.abs(step).max(initial=0.0))
        if not np.isfinite(size):
            break
        if size < _RESOLUTION * scale:
            return x
    raise NetworkError(
        f"{network.title}: Newton's method found no equilibrium near the given state; run the "
        "network and use its settled state as the initial state"
    )
