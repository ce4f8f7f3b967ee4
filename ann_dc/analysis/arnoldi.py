"""The ends of a large network's spectrum, by Arnoldi iterations on J = M d drive / dx.

The fastest modes come from products with J. The slow ones, which decide how long settling takes,
come from products with its inverse: one sparse LU factorisation of the block-tridiagonal drive
Jacobian, and M^{-1}, which is diagonal but for the chains under the coordinators. The rightmost
ones are asked for once more, because a mode that grows need be neither fast nor slow.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from ann_dc.evaluation.compiled import CompiledEvaluator

LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs

FASTEST, SLOWEST, RIGHTMOST = 4, 12, 6
"""How many eigenvalues are asked for at each end."""


def spectrum_ends(evaluator: CompiledEvaluator, drive_jacobian: Any) -> np.ndarray:
    """The fastest, the smallest and the rightmost eigenvalues of M ``drive_jacobian`` (n, n)."""
    flow = LinearOperator(
        drive_jacobian.shape,
        dtype=float,
        matvec=lambda v: evaluator.metric(np.ascontiguousarray(drive_jacobian @ v.ravel())),
    )
    return np.concatenate(
        [
            _eigenvalues(flow, "LM", FASTEST),
            _smallest(evaluator, drive_jacobian),
            _eigenvalues(flow, "LR", RIGHTMOST, ncv=80, maxiter=40),
        ]
    )


def _smallest(evaluator: CompiledEvaluator, drive_jacobian: Any) -> np.ndarray:
    try:
        factors = scipy.sparse.linalg.splu(drive_jacobian.tocsc())
    except RuntimeError:  # exactly singular: the point is not isolated
        return np.zeros(1)
    unspread = inverse_metric(evaluator)
    inverse = LinearOperator(
        drive_jacobian.shape, dtype=float, matvec=lambda v: factors.solve(unspread(v.ravel()))
    )
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


def inverse_metric(evaluator: CompiledEvaluator) -> Callable[[np.ndarray], np.ndarray]:
    """v -> M^{-1} v: diagonal, and one Cholesky factor over the chains' neurons."""
    network, tape = evaluator.network, evaluator.tape
    rates = network.pack(tape.rates)
    rows = np.flatnonzero(np.isin(network.places[:, 0], tape.chains.ravel()))
    block = np.empty((len(rows), len(rows)))
    unit = np.zeros(network.size)
    for column, row in enumerate(rows):
        unit[row] = 1.0
        block[:, column] = evaluator.metric(unit)[rows]
        unit[row] = 0.0
    factor = scipy.linalg.cho_factor(block) if len(rows) else None

    def solve(v: np.ndarray) -> np.ndarray:
        out = v / rates
        if factor is not None:
            out[rows] = scipy.linalg.cho_solve(factor, v[rows])
        return out

    return solve
