"""Second-order test: a sufficient Cholesky test, then the test by stages.

Strongly active inequalities must hold as equations. A weakly active inequality may be left on one
side. If the Hessian is positive without it, the point is a strict minimum. If the Hessian is not
positive even with it, the point is not a minimum. Otherwise the result is open. A soft constraint
is not an equation: at its penalty weight it is a cost, P g, and below it, if compliant, a curvature
G' G / d.

The sufficient test is the convexity of the augmented Lagrangian. If W + rho A'A - delta I has a
Cholesky factor for any one rho, every direction with A d = 0 has curvature d'W d > delta d'd. With
the unknowns ordered (q_k, u_k) by stage, the matrix is banded. A includes the strongly active
inequalities. The converse does not hold: without a factor, `by_stages` decides.

The smallest eigenvalue of the reduced Hessian measures the strictness of a minimum. The linearised
plant eliminates the states, and the dense matrix acts on the controls and the free components of
q_0. Its eigenvalues take a time of order N^3, whereas `by_stages` finds their sign in linear time.

References
----------
.. [1] D. P. Bertsekas, Constrained Optimization and Lagrange Multiplier Methods, 1982, section 1.4.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from scipy.linalg import get_lapack_funcs

from ann_dc.optimality.by_stages import Minimum, counted
from ann_dc.optimality.expansion import Expansion
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import checked

(_factored,) = get_lapack_funcs(("pbtrf",), dtype=np.float64)

PENALTY = 1e4
"""rho relative to the largest curvature."""
CLEAR = 1e-9
"""Lower bound of delta relative to the largest curvature."""
ROUNDING = 100 * np.finfo(float).eps
"""Rounding error of a factor relative to the largest matrix entry; delta exceeds it."""


@np.errstate(all="ignore")
def is_clearly_strict(expansion: Expansion, rows: np.ndarray) -> bool:
    """Return True if the reduced Hessian of a finite expansion is clearly positive definite.

    `rows` (N+1, R, n+m) are the gradients of the constraints that hold as equations.
    """
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
    """Return True if the symmetric block tridiagonal matrix is positive definite."""
    z, n = blocks.shape[1], ahead.shape[1]
    band = np.zeros((len(blocks), z, z + n))  # LAPACK's layout, transposed: (i, j) at j, i - j
    for column in range(z):
        band[:, column, : z - column] = blocks[:, column:, column]
        band[:-1, column, z - column : z - column + n] = ahead[:, :, column]
    return bool(_factored(band.reshape(-1, z + n).T, lower=1, overwrite_ab=1)[1] == 0)


def minimum_of(expansion: Expansion) -> Minimum:
    """Return the sign of the Hessian on the tangent space of the constraints.

    The Hessian is that of the Lagrangian; the result is `NOT_CHECKED` if it is not finite.
    """
    expansion = expansion.condensed()
    curvatures = expansion.jacobian, expansion.hessian, expansion.end_hessian
    if not all(np.isfinite(values).all() for values in curvatures):
        return Minimum.NOT_CHECKED
    held, touching = expansion.active_rows()
    if touching.size and not np.isfinite(touching).all():
        return Minimum.NOT_CHECKED
    if is_clearly_strict(expansion, held):
        return Minimum.STRICT
    return minimum_by_stages(expansion)


def minimum_by_stages(expansion: Expansion) -> Minimum:
    """Return the result of `minimum_of` without the sufficient Cholesky test.

    The expansion must be finite.
    """
    held, touching = expansion.active_rows()
    found = counted(expansion, held)
    if found is Minimum.STRICT or np.array_equal(held, touching):
        return found
    found = counted(expansion, touching)
    return found if found is Minimum.NOT_A_MINIMUM else Minimum.NOT_SHOWN


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
