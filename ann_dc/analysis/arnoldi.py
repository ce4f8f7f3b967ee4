"""TODO: the idea."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse.linalg

from ann_dc.evaluation.compiled import CompiledEvaluator

_LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs


def _ends(kernel: CompiledEvaluator, drive_jacobian) -> np.ndarray:
    """The fastest, the smallest and the rightmost eigenvalues, by Arnoldi iterations."""
    n = drive_jacobian.shape[0]
    start = np.ones(n)
    flow = _LinearOperator(
        (n, n),
        dtype=float,
        matvec=lambda v: kernel.metric(np.ascontiguousarray(drive_jacobian @ v.ravel())),
    )
    arnoldi = lambda operator, which, k, **options: _converged(  # noqa: E731
        operator, k=k, which=which, v0=start, tol=1e-4, **options
    )
    return np.concatenate(
        [
            arnoldi(flow, "LM", 4),
            _smallest(kernel, drive_jacobian, arnoldi),
            arnoldi(flow, "LR", 6, ncv=80, maxiter=40),
        ]
    )


def _smallest(kernel: CompiledEvaluator, drive_jacobian, arnoldi) -> np.ndarray:
    try:
        factors = scipy.sparse.linalg.splu(drive_jacobian.tocsc())
    except RuntimeError:  # exactly singular: the point is not isolated
        return np.zeros(1)
    unspread = _inverse_metric(kernel)
    inverse = _LinearOperator(
        drive_jacobian.shape, dtype=float, matvec=lambda v: factors.solve(unspread(v.ravel()))
    )
    return 1 / arnoldi(inverse, "LM", 12)


def _converged(operator, **options) -> np.ndarray:
    try:
        return np.asarray(scipy.sparse.linalg.eigs(operator, return_eigenvectors=False, **options))
    except scipy.sparse.linalg.ArpackNoConvergence as partial:
        return partial.eigenvalues


def _inverse_metric(kernel: CompiledEvaluator):
    """v -> M^{-1} v: diagonal, and one Cholesky factor over the chains' neurons."""
    network, tape = kernel.network, kernel.tape
    rates = network.pack(tape.rates)
    rows = np.flatnonzero(np.isin(network.places[:, 0], tape.chains.ravel()))
    block = np.empty((len(rows), len(rows)))
    unit = np.zeros(network.size)
    for column, row in enumerate(rows):
        unit[row] = 1.0
        block[:, column] = kernel.metric(unit)[rows]
        unit[row] = 0.0
    factor = scipy.linalg.cho_factor(block) if len(rows) else None

    def solve(v: np.ndarray) -> np.ndarray:
        out = v / rates
        if factor is not None:
            out[rows] = scipy.linalg.cho_solve(factor, v[rows])
        return out

    return solve
