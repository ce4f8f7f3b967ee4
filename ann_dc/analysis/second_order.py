r"""What the drive Jacobian K says of a settled point: is it a minimum, and which penalty holds it.

With H the Hessian of the Lagrangian and A the constraints' Jacobian, the symmetric

.. math:: K = \begin{pmatrix} H & A^T \\ A & 0 \end{pmatrix}

has as many negative eigenvalues as there are constraints exactly where H is positive definite on
the null space of A: at a strict local minimum (Nocedal and Wright, Numerical Optimization, 2006,
theorem 16.3). The flow's own Jacobian has the primal rows with the opposite sign.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.arnoldi import LinearOperator
from ann_dc.analysis.spectra import DENSE_LIMIT
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.evaluation.tape import DUAL, STATE
from ann_dc.network.network import Network


def penalty_threshold(network: Network, x: np.ndarray) -> float:
    r"""rho*: the smallest common penalty that makes H + rho A'A positive definite at a KKT point.

    .. math::
        \rho^* = \max(0, \lambda_{max}(\text{dual block of } K^{-1}))

    in the network's own units. Sufficient for stability; the flow's own threshold can be lower.
    Infinite at a saddle, where no penalty is enough (found up to `DENSE_LIMIT` neurons); nan where
    K is singular or the iteration of a large network fails.
    """
    without_penalty = CompiledEvaluator(network, tape_with_penalty(network, 0.0))
    is_dual = without_penalty.tape.roles[network.places[:, 0]] == DUAL
    # rows of the flow: primal -(H, A'), dual (A, 0); the sign of the primal rows makes it K
    sign = np.where(is_dual, 1.0, -1.0)
    K = (sparse.diags_array(sign) @ without_penalty.drive_jacobian(x)).tocsc()
    try:
        if network.size <= DENSE_LIMIT:
            return _dense_threshold(K.toarray(), is_dual)
        return _sparse_threshold(K, is_dual)
    except (np.linalg.LinAlgError, RuntimeError):  # K is singular: the point is not isolated
        return float("nan")


def _dense_threshold(K: np.ndarray, is_dual: np.ndarray) -> float:
    if (np.linalg.eigvalsh(K) < 0).sum() != is_dual.sum():
        return float("inf")
    dual_block = np.linalg.inv(K)[np.ix_(is_dual, is_dual)]
    return float(max(0.0, np.linalg.eigvalsh(dual_block)[-1]))


def _sparse_threshold(K: Any, is_dual: np.ndarray) -> float:
    """By Lanczos iterations; raises RuntimeError where K is singular."""
    factors, duals = scipy.sparse.linalg.splu(K), np.flatnonzero(is_dual)

    def dual_block(v: np.ndarray) -> np.ndarray:
        full = np.zeros(len(is_dual))
        full[duals] = v.ravel()
        return factors.solve(full)[duals]

    try:
        largest = scipy.sparse.linalg.eigsh(
            LinearOperator((len(duals),) * 2, matvec=dual_block, dtype=float),
            k=1,
            which="LA",
            v0=np.ones(len(duals)),
            tol=1e-3,  # pyright: ignore[reportArgumentType]
            ncv=60,
            maxiter=100,
            return_eigenvectors=False,
        )[0]
    except scipy.sparse.linalg.ArpackNoConvergence:
        return float("nan")
    return float(max(0.0, largest))


def is_strict_minimum(network: Network, jacobian: Any, resting: np.ndarray) -> bool:
    """Whether a settled point is one that the flow can rest at, from its drive Jacobian (n, n).

    With PI duals: the reduced Hessian is positive definite, a strict local minimum (K has as many
    negative eigenvalues as constraints). Without, or with neurons that are no part of the
    optimisation (poles of the hardware): no eigenvalue of the flow leads away.
    ``resting`` (n,) says which neurons stand at a rail; they are left out.
    """
    free = ~resting
    roles = evaluator(network).tape.roles[network.places[:, 0]]
    dense = jacobian.toarray()
    if network.cell.duals and not (roles == STATE).any():
        is_dual = (roles == DUAL)[free]
        K = np.where(is_dual, 1.0, -1.0)[:, None] * dense[np.ix_(free, free)]
        return bool((np.linalg.eigvalsh(0.5 * (K + K.T)) < 0).sum() == is_dual.sum())
    flow = (evaluator(network).metric @ dense)[np.ix_(free, free)]
    return bool((np.real(np.linalg.eigvals(flow)) < 0).all())
