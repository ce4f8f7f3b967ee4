"""Eigenvalues of the flow at a settled point: how fast it will settle, and whether it stays.

``ratio`` = spectral radius / |spectral abscissa| is settling measured in the fastest time constants:
a run to a relative residual eps takes about ratio * ln(1/eps) of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse.linalg

from ann_dc.network.kernel import Kernel
from ann_dc.network.network import Network
from ann_dc.network.program import Tape

DENSE_LIMIT = 900
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
        return float(self.eigenvalues.real.max())

    @property
    def ratio(self) -> float:
        """radius / |abscissa|; infinite when the point does not attract."""
        return self.radius / -self.abscissa if self.abscissa < 0 else float("inf")

    @property
    def largest_step(self) -> float:
        """Largest stable forward Euler step: min 2a / (a^2 + b^2) over eigenvalues -a +- ib."""
        values = self.eigenvalues
        return float(max((-2 * values.real / np.abs(values) ** 2).min(), 0.0))


def spectrum(network: Network, x: np.ndarray, tape: Tape | None = None) -> Spectrum:
    """Spectrum of a network's flow at a state (n,).

    ``tape`` replaces the network's gains by others. Above `DENSE_LIMIT` neurons the ends of the
    spectrum come from Arnoldi iterations, the slow end on the inverse of the structured Jacobian.
    """
    kernel = Kernel(network, tape)
    drive_jacobian = kernel.drive_jacobian(x)
    if network.size <= DENSE_LIMIT:
        dense = np.array([kernel.metric(np.ascontiguousarray(column))
                          for column in drive_jacobian.toarray().T]).T
        return Spectrum(eigenvalues=scipy.linalg.eigvals(dense, check_finite=False))
    return Spectrum(eigenvalues=_ends(kernel, drive_jacobian))


def _ends(kernel: Kernel, drive_jacobian) -> np.ndarray:
    n = drive_jacobian.shape[0]
    flow = scipy.sparse.linalg.LinearOperator(
        (n, n), matvec=lambda v: kernel.metric(np.ascontiguousarray(drive_jacobian @ v)),
        dtype=float)
    start = np.ones(n)
    fast = scipy.sparse.linalg.eigs(flow, k=6, which="LM", v0=start, tol=1e-3,
                                    return_eigenvectors=False)
    factors = scipy.sparse.linalg.splu(drive_jacobian.tocsc())
    metric = scipy.sparse.linalg.LinearOperator((n, n), matvec=kernel.metric, dtype=float)

    def back(v: np.ndarray) -> np.ndarray:
        moved, _ = scipy.sparse.linalg.cg(metric, v, rtol=1e-10, maxiter=2000)
        return factors.solve(moved)

    inverse = scipy.sparse.linalg.LinearOperator((n, n), matvec=back, dtype=float)
    slow = 1 / scipy.sparse.linalg.eigs(inverse, k=12, which="LM", v0=start, tol=1e-4,
                                        return_eigenvectors=False)
    return np.concatenate([fast, slow])
