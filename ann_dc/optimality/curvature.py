"""Smallest eigenvalue of the reduced Hessian: the strictness of a minimum.

The linearised plant eliminates the states. The matrix acts on the controls and the free components
of q_0, restricted to directions that satisfy the fixed end and the strongly active inequalities.
The matrix is dense: computing its eigenvalues takes a time of order N^3, whereas `by_stages`
determines their sign in linear time.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from ann_dc.optimality.expansion import Expansion
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import checked

LARGEST_REDUCED = 2000
"""Number of control values above which the eigenvalue is not computed."""


@checked
def smallest_curvature(
    problem: OptimalControlProblem,
    q: np.ndarray,
    u: np.ndarray,
    mu: np.ndarray,
    zeta: np.ndarray | None = None,
    zeta_end: np.ndarray | None = None,
) -> float:
    """Return the smallest reduced-Hessian eigenvalue relative to the largest, in natural scales.

    States (n, N+1) include the end. Returns inf if the constraints leave no freedom, and nan if the
    Hessian is not finite or N m exceeds `LARGEST_REDUCED`.

    Examples
    --------
    Least effort of a double integrator has equal curvature in all directions:

    >>> from ann_dc import plants
    >>> problem = plants.double_integrator(N=5)
    >>> round(smallest_curvature(problem, np.zeros((2, 6)), np.zeros((1, 5)), np.zeros((2, 5))), 9)
    1.0
    """
    if u.size > LARGEST_REDUCED:
        return float("nan")
    expansion = Expansion.at(problem, q, u, mu, zeta, zeta_end).condensed()
    with np.errstate(all="ignore"):
        total, held = _reduced(expansion)
    if not np.isfinite(total).all():
        return float("nan")
    tangent = scipy.linalg.null_space(held) if len(held) else np.eye(len(total))
    if tangent.shape[1] == 0:  # no freedom: trivially a minimum
        return float("inf")
    values = np.linalg.eigvalsh(tangent.T @ total @ tangent)
    return float(values[0] / max(abs(values[-1]), 1e-300))


def _reduced(expansion: Expansion) -> tuple[np.ndarray, np.ndarray]:
    """Return the Hessian in free q_0 and then all u, and the active constraints."""
    stages, n, z = expansion.jacobian.shape
    untied = np.flatnonzero(~expansion.fixed_start)
    size = len(untied) + stages * (z - n)
    reach, total = np.zeros((n, size)), np.zeros((size, size))
    reach[untied, np.arange(len(untied))] = 1.0
    rows, held = expansion.active_rows()[0], []
    for k, (J, W) in enumerate(zip(expansion.jacobian, expansion.hessian)):
        before = len(untied) + k * (z - n)
        own = np.zeros((z - n, size))
        own[:, before : before + z - n] = np.eye(z - n)
        moved = np.concatenate([reach, own])
        held.append(rows[k][rows[k].any(axis=1)] @ moved)
        seen = moved[:, : before + z - n]
        total[: before + z - n, : before + z - n] += seen.T @ W @ seen
        reach = J @ moved
    held += [rows[-1][rows[-1].any(axis=1)][:, :n] @ reach, reach[expansion.fixed]]
    return total + reach.T @ expansion.end_hessian @ reach, np.concatenate(held)
