"""The ends of a large network's spectrum, by Arnoldi iterations on J = M d drive / dx.

The fastest modes come from products with J. The slow ones, which decide how long settling takes,
come from products with its inverse: one sparse LU factorisation of the block-tridiagonal drive
Jacobian, and one of the metric's factors. The rightmost ones are asked for once more, because a
mode that grows need be neither fast nor slow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse.linalg

from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.network.metrics.contract import Factors

LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs

FASTEST, SLOWEST, RIGHTMOST = 4, 12, 6
"""How many eigenvalues are asked for at each end."""


def spectrum_ends(evaluator: CompiledEvaluator, metric: Factors, drive_jacobian: Any) -> np.ndarray:
    """The fastest, the smallest and the rightmost eigenvalues of M ``drive_jacobian`` (n, n).

    Parameters
    ----------
    evaluator : CompiledEvaluator
    metric : Factors
        M, for its inverse.
    drive_jacobian : (n, n) sparse array

    Returns
    -------
    complex array
        In units of 1 / network time.

    References
    ----------
    .. [1] R. B. Lehoucq, D. C. Sorensen, C. Yang, ARPACK Users' Guide, SIAM, 1998.
    """
    flow = _flow(evaluator, drive_jacobian)
    return np.concatenate(
        [
            _eigenvalues(flow, "LM", FASTEST),
            _smallest(metric, drive_jacobian),
            _eigenvalues(flow, "LR", RIGHTMOST, ncv=80, maxiter=40),
        ]
    )


def slow_modes(
    evaluator: CompiledEvaluator, metric: Factors, drive_jacobian: Any
) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the rightmost eigenvalues of M ``drive_jacobian`` with their vectors.

    Parameters
    ----------
    evaluator : CompiledEvaluator
    metric : Factors
        M, for its inverse.
    drive_jacobian : (n, n) sparse array

    Returns
    -------
    eigenvalues : (c,) complex array
        In units of 1 / network time; one that is found from both ends stands once.
    vectors : (n, c) complex array

    Raises
    ------
    RuntimeError
        If the Jacobian is singular.
    """
    slow, slow_vectors = _eigenpairs(_inverse(metric, drive_jacobian), "LM", SLOWEST)
    flow = _flow(evaluator, drive_jacobian)
    right, right_vectors = _eigenpairs(flow, "LR", RIGHTMOST, ncv=80, maxiter=40)
    slow = 1 / slow
    new = (np.abs(right[:, None] - slow) > 1e-3 * np.abs(slow)).all(axis=1)
    return np.concatenate([slow, right[new]]), np.hstack([slow_vectors, right_vectors[:, new]])


def _flow(evaluator: CompiledEvaluator, drive_jacobian: Any) -> Any:
    """v -> M ``drive_jacobian`` v."""
    return LinearOperator(
        drive_jacobian.shape,
        dtype=float,
        matvec=lambda v: evaluator.move(np.ascontiguousarray(drive_jacobian @ v.ravel())),
    )


def _inverse(metric: Factors, drive_jacobian: Any) -> Any:
    """v -> (M ``drive_jacobian``)^{-1} v; RuntimeError where that is exactly singular."""
    factors = scipy.sparse.linalg.splu(drive_jacobian.tocsc())
    unspread = metric.inverse()
    return LinearOperator(
        drive_jacobian.shape, dtype=float, matvec=lambda v: factors.solve(unspread(v.ravel()))
    )


def _smallest(metric: Factors, drive_jacobian: Any) -> np.ndarray:
    try:
        inverse = _inverse(metric, drive_jacobian)
    except RuntimeError:  # the point is not isolated
        return np.zeros(1)
    return 1 / _eigenvalues(inverse, "LM", SLOWEST)


def _eigenvalues(operator: Any, which: str, count: int, **options: Any) -> np.ndarray:
    """Some eigenvalues; those that have converged, where not all do."""
    start = np.ones(operator.shape[0])
    try:
        found = scipy.sparse.linalg.eigs(
            operator,
            k=count,
            which=which,  # pyright: ignore[reportArgumentType]
            v0=start,
            tol=1e-4,  # pyright: ignore[reportArgumentType]
            return_eigenvectors=False,
            **options,
        )
        return np.asarray(found)
    except scipy.sparse.linalg.ArpackNoConvergence as partial:
        return partial.eigenvalues
    except scipy.sparse.linalg.ArpackError:  # the numbers are beyond an eigenvalue computation
        return np.array([complex(np.nan, np.nan)])


def _eigenpairs(
    operator: Any, which: str, count: int, **options: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Some eigenvalues with their vectors; those that have converged, where not all do."""
    start = np.ones(operator.shape[0])
    try:
        found: Any = scipy.sparse.linalg.eigs(
            operator,
            k=count,
            which=which,  # pyright: ignore[reportArgumentType]
            v0=start,
            tol=1e-6,  # pyright: ignore[reportArgumentType]
            **options,
        )
        return found
    except scipy.sparse.linalg.ArpackNoConvergence as partial:
        return partial.eigenvalues, partial.eigenvectors
