r"""Excursion of every state: a linear-quadratic model along a path with fixed ends.

The path of least cost from end to end is the mean of a Gaussian bridge, a random walk with density
exp(-E) whose ends are fixed. The variance of the bridge measures the distance that states deviate
from the mean at small cost. With V_k the Hessian of the cost to go,

.. math::
    X_{k+1} = G_k X_k G_k^T + B_k (R + B_k^T V_{k+1} B_k)^{-1} B_k^T, \qquad
    G_k = F_k - B_k (R + B_k^T V_{k+1} B_k)^{-1} B_k^T V_{k+1} F_k .

Fixed ends are stiff in V_N and zero in X_0; components that q_0 leaves free have V_0^{-1}. The
variance is covariant: a change of units of states, controls or cost only changes its units.
"""

from __future__ import annotations

import numpy as np

STIFF = 1e8
"""Stiffness of a fixed end relative to the reach of the controls."""
HELD = 1e-6
"""Motion relative to the reach of the controls below which a state counts as fixed."""
FLAT = 1e-9
"""Curvature relative to the largest one below which the cost does not determine a free component of
q_0.
"""
EXPLOSION = 1e30
"""Variance relative to that of a non-growing map, above which F does not predict the excursions."""
GROWTH = 30.0
"""Growth of a disturbance beyond which earlier controls are omitted from the reach."""


def bridge_variance(
    F: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    fixed: np.ndarray,
    loose: np.ndarray | None = None,
) -> np.ndarray:
    """Return the variance (n, N) of q_1..q_N on a Gaussian bridge of density exp(-E).

    The variance is zero for a state that no control moves and at the fixed end. It is infinite for
    a component that is free at q_0 if no cost limits its excursion.

    Parameters
    ----------
    F, B : (n, n, N) and (n, m, N) arrays
        df/dq and df/du along a path.
    Q : (n, N+1) array
        Curvature of the cost in q_0..q_N, non-negative.
    R : (m,) array
        Curvature of the cost in the controls, positive.
    fixed : (n,) booleans
        True for components that are fixed at q_N.
    loose : (n,) booleans, optional
        True for components that are free at q_0; none by default.

    Examples
    --------
    A chain of three sums from 0 back to 0 is free in the middle:

    >>> one = np.ones((1, 1, 4))
    >>> bridge_variance(one, one, np.zeros((1, 5)), np.ones(1), np.array([True])).round(3)
    array([[0.75, 1.  , 0.75, 0.  ]])
    """
    variance = _variance(F, B, Q, R, fixed, loose)
    norms = np.linalg.norm(F, axis=(0, 1))  # at least the spectral radii, and cheaper
    if np.log(np.maximum(norms, 1.0)).sum() <= np.log(EXPLOSION) / 2:
        return variance
    radii = np.maximum(np.abs(np.linalg.eigvals(np.moveaxis(F, -1, 0))).max(axis=1), 1.0)
    bounded = _variance(F / radii, B, Q, R, fixed, loose)
    return bounded if (variance > EXPLOSION * bounded)[bounded > 0].any() else variance


def _variance(
    F: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    fixed: np.ndarray,
    loose: np.ndarray | None,
) -> np.ndarray:
    """Return the variance by the recursion, without a limit on the growth of F."""
    n, m, stages = B.shape
    B = B / np.sqrt(R)[:, None]
    reached = _reached(F, B)
    V = np.diag(np.where(fixed & (reached > 0), STIFF / np.where(reached > 0, reached, 1.0), 0.0))
    feedback, share = np.empty((stages, m, n)), np.empty((stages, m, m))
    for k in range(stages - 1, -1, -1):
        V = V + np.diag(Q[:, k + 1])
        share[k] = np.linalg.inv(np.eye(m) + B[:, :, k].T @ V @ B[:, :, k])
        feedback[k] = share[k] @ B[:, :, k].T @ V @ F[:, :, k]
        G = F[:, :, k] - B[:, :, k] @ feedback[k]
        V = G.T @ V @ G + feedback[k].T @ feedback[k]  # not F'VG: an error of G counts squared
    X, variance = np.zeros((n, n)), np.empty((n, stages))
    loose = np.zeros(n, bool) if loose is None else loose
    X[np.ix_(loose, loose)], unknown = _at_start((V + np.diag(Q[:, 0]))[np.ix_(loose, loose)])
    for k in range(stages):
        G = F[:, :, k] - B[:, :, k] @ feedback[k]
        X = G @ X @ G.T + B[:, :, k] @ share[k] @ B[:, :, k].T
        variance[:, k] = X.diagonal()
    variance[fixed, -1] = 0.0
    is_held = variance.max(axis=1) < HELD * reached  # what is left is how soft the ends are
    variance = np.where(is_held[:, None], 0.0, np.maximum(variance, 0.0))
    variance[np.flatnonzero(loose)[unknown]] = np.inf
    return variance


def _at_start(V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of free components of q_0 and the undetermined entries.

    The covariance is the inverse of the Hessian of the cost to go in these components.
    """
    size = np.sqrt(np.maximum(V.diagonal(), 0.0))
    size = np.where(size > 0, 1.0 / np.where(size > 0, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(size[:, None] * V * size)
    told = values > FLAT
    root = size[:, None] * vectors[:, told] / np.sqrt(values[told])
    return root @ root.T, (np.abs(vectors[:, ~told]) > np.sqrt(FLAT)).any(axis=1)


def _reached(F: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return the diagonal (n,) of the terminal controllability Gramian (last stages)."""
    total, after = np.zeros(len(F)), np.eye(len(F))
    for k in range(F.shape[-1] - 1, -1, -1):
        total += ((after @ B[:, :, k]) ** 2).sum(axis=1)
        after = after @ F[:, :, k]
        if not (np.isfinite(after).all() and np.abs(np.linalg.eigvals(after)).max() < GROWTH):
            break
    return total
