"""Eigenvalues of the flow at a settled point: how fast it will settle, and whether it stays.

``ratio`` = spectral radius / |spectral abscissa| measures settling in fastest time constants: a run
to a relative residual eps takes about ratio * ln(1/eps) of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.blas import one_thread
from ann_dc.analysis.linearisation import tape_with_penalty
from ann_dc.evaluation.compiled import Kernel
from ann_dc.evaluation.tape import DUAL, STATE, Tape
from ann_dc.network.network import Network

_LinearOperator: Any = scipy.sparse.linalg.LinearOperator  # its arguments are not in the stubs

DENSE_LIMIT = 600
"""Largest network whose eigenvalues are all computed; beyond it, only the ends of the spectrum."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """Eigenvalues of d rhs / dx at a state.

    Attributes
    ----------
    eigenvalues : complex array
        All of them, or the fastest and the slowest of a large network. Unit: 1 / network time.
    """

    eigenvalues: np.ndarray

    @property
    def radius(self) -> float:
        """Largest modulus: one over the fastest time constant."""
        return float(np.abs(self.eigenvalues).max())

    @property
    def abscissa(self) -> float:
        """Largest real part: negative when the point attracts, and then the rate of settling."""
        return float(np.real(self.eigenvalues).max())

    @property
    def ratio(self) -> float:
        """radius / |abscissa|; infinite when the point does not attract."""
        return self.radius / -self.abscissa if self.abscissa < 0 else float("inf")

    @property
    def largest_step(self) -> float:
        """Largest stable forward Euler step: min 2a / (a^2 + b^2) over eigenvalues -a +- ib."""
        values = self.eigenvalues
        return float(max((-2 * np.real(values) / np.abs(values) ** 2).min(), 0.0))


def spectrum(network: Network, x: np.ndarray, tape: Tape | None = None) -> Spectrum:
    """Spectrum of a network's flow at a state (n,).

    ``tape`` replaces the network's gains by others. Above `DENSE_LIMIT` neurons the ends of the
    spectrum come from Arnoldi iterations, the slow end on the inverse of the structured Jacobian.
    """
    kernel = Kernel(network, tape)
    drive_jacobian = kernel.drive_jacobian(x)
    if not np.isfinite(drive_jacobian.data).all():  # a run that overflowed has no spectrum
        return Spectrum(eigenvalues=np.array([complex(np.nan, np.nan)]))
    if network.size <= DENSE_LIMIT:
        dense = np.array(
            [kernel.metric(np.ascontiguousarray(column)) for column in drive_jacobian.toarray().T]
        ).T
        with one_thread():
            eigenvalues = scipy.linalg.eigvals(dense, check_finite=False)
        return Spectrum(eigenvalues=np.asarray(eigenvalues))
    return Spectrum(eigenvalues=_ends(kernel, drive_jacobian))


def stability_limit(network: Network, x: np.ndarray) -> float:
    """Largest stable step of the simultaneous order at a state (n,).

    min 2a / (a^2 + b^2) over the eigenvalues -a +- ib of the flow; zero at a point that repels.
    """
    return spectrum(network, x).largest_step


def _ends(kernel: Kernel, drive_jacobian) -> np.ndarray:
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


def _smallest(kernel: Kernel, drive_jacobian, arnoldi) -> np.ndarray:
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


def _inverse_metric(kernel: Kernel):
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


def penalty_threshold(network: Network, x: np.ndarray) -> float:
    r"""rho*: the smallest common penalty that makes H + rho A'A positive definite at a KKT point.

    .. math::
        \rho^* = \max(0, \lambda_{max}(\text{dual block of } K^{-1})), \quad
        K = [[H, A^T], [A, 0]]

    with H the Hessian of the Lagrangian, in the network's own units. Sufficient for stability; the
    flow's own threshold can be lower. Infinite at a saddle, where no penalty is enough (found up to
    `DENSE_LIMIT` neurons); nan where K is singular or the iteration of a large network fails.
    """
    kernel = Kernel(network, tape_with_penalty(network, 0.0))
    K = kernel.drive_jacobian(x)
    is_dual = kernel.tape.roles[network.places[:, 0]] == DUAL
    # rows of the flow: primal -(H, A'), dual (A, 0); the sign of the primal rows makes it K
    sign = np.where(is_dual, 1.0, -1.0)
    symmetric = (sparse.diags_array(sign) @ K).tocsc()
    try:
        if network.size <= DENSE_LIMIT:
            return _dense_threshold(symmetric.toarray(), is_dual)
        factors = scipy.sparse.linalg.splu(symmetric)
    except (np.linalg.LinAlgError, RuntimeError):  # K is singular: the point is not isolated
        return float("nan")
    duals = np.flatnonzero(is_dual)

    def dual_block(v: np.ndarray) -> np.ndarray:
        full = np.zeros(network.size)
        full[duals] = v.ravel()
        return factors.solve(full)[duals]

    operator = _LinearOperator((len(duals),) * 2, matvec=dual_block, dtype=float)
    try:
        largest = scipy.sparse.linalg.eigsh(
            operator,
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


def is_sound(network: Network, jacobian: Any, resting: np.ndarray) -> bool:
    """Whether a settled point is one that the flow can rest at, from its drive Jacobian (n, n).

    With PI duals: the reduced Hessian is positive definite, a strict local minimum (K has as many
    negative eigenvalues as constraints). Without, or with neurons that are no part of the
    optimisation (poles of the hardware): no eigenvalue of the flow leads away.
    ``resting`` (n,) says which neurons stand at a rail; they are left out.
    """
    free = ~resting
    roles = network.program.tape.roles[network.places[:, 0]]
    dense = jacobian.toarray()
    if network.cell.duals and not (roles == STATE).any():
        is_dual = (roles == DUAL)[free]
        K = np.where(is_dual, 1.0, -1.0)[:, None] * dense[np.ix_(free, free)]
        return bool((np.linalg.eigvalsh(0.5 * (K + K.T)) < 0).sum() == is_dual.sum())
    flow = (network.program.metric @ dense)[np.ix_(free, free)]
    return bool((np.real(np.linalg.eigvals(flow)) < 0).all())


def _dense_threshold(K: np.ndarray, is_dual: np.ndarray) -> float:
    # K has as many negative eigenvalues as constraints where the reduced Hessian is positive
    if (np.linalg.eigvalsh(K) < 0).sum() != is_dual.sum():
        return float("inf")
    dual_block = np.linalg.inv(K)[np.ix_(is_dual, is_dual)]
    return float(max(0.0, np.linalg.eigvalsh(dual_block)[-1]))
