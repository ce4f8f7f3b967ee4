r"""A quick proof that a point is a strict minimum: the augmented Lagrangian is convex there.

Where W + rho A'A - delta I has a Cholesky factor for any one rho, every direction with A d = 0 has
a curvature d'W d > delta d'd. With the unknowns in the order (q_k, u_k) by stage the matrix is a
band. Rows of inequalities that are strongly active stand in A too. The reverse does not hold: where
there is no factor, `by_stages` counts by stages.

References
----------
.. [1] D. P. Bertsekas, Constrained Optimization and Lagrange Multiplier Methods, 1982, section 1.4.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import get_lapack_funcs

from ann_dc.optimality.expansion import Expansion

(_factored,) = get_lapack_funcs(("pbtrf",), dtype=np.float64)

PENALTY = 1e4
"""rho, over the largest curvature."""
CLEAR = 1e-9
"""delta, over the largest curvature, at least."""
ROUNDING = 100 * np.finfo(float).eps
"""What a factor may be off by, over the largest entry of the matrix: delta is larger."""


def is_clearly_strict(expansion: Expansion, held: np.ndarray) -> bool:
    """Whether the reduced Hessian is positive definite beyond doubt.

    Parameters
    ----------
    expansion : Expansion
        Finite.
    held : (N+1, R, n+m) array
        Slopes of rows that hold as equations.
    """
    with np.errstate(all="ignore"):
        return _is_definite(expansion, held)


def _is_definite(expansion: Expansion, rows: np.ndarray) -> bool:
    (stages, n, z), largest = expansion.jacobian.shape, expansion.largest_curvature()
    rho, J, each = PENALTY * largest, expansion.jacobian, np.arange(n)
    blocks = np.zeros((stages + 1, z, z))
    blocks[:-1] = expansion.hessian + rho * (J.swapaxes(1, 2) @ J)
    blocks[1:, each, each] += rho
    blocks[-1, :n, :n] += expansion.end_hessian
    if rows.size:
        blocks += rho * (rows.swapaxes(1, 2) @ rows)
    ahead = -rho * J
    held = expansion.fixed_start, expansion.fixed
    for stage, fixed in zip((0, -1), held):
        blocks[stage, :n][fixed] = blocks[stage, :, :n][:, fixed] = 0.0
    ahead[0, :, :n][:, held[0]] = 0.0
    ahead[-1][held[1]] = 0.0
    size = float(np.abs(blocks).max())
    if not (np.isfinite(size) and np.isfinite(ahead).all()):
        return False
    blocks[:, np.arange(z), np.arange(z)] -= max(CLEAR * largest, ROUNDING * z * size)
    for stage, fixed in zip((0, -1), held):
        blocks[stage, each[fixed], each[fixed]] = 1.0
    blocks[-1, np.arange(n, z), np.arange(n, z)] = 1.0
    return _has_factor(blocks, ahead)


def _has_factor(blocks: np.ndarray, ahead: np.ndarray) -> bool:
    """Whether the symmetric matrix of these blocks, and of those below them, is definite."""
    z, n = blocks.shape[1], ahead.shape[1]
    band = np.zeros((len(blocks), z, z + n))  # LAPACK's layout, transposed: (i, j) at j, i - j
    for column in range(z):
        band[:, column, : z - column] = blocks[:, column:, column]
        band[:-1, column, z - column : z - column + n] = ahead[:, :, column]
    return bool(_factored(band.reshape(-1, z + n).T, lower=1, overwrite_ab=1)[1] == 0)
