r"""The saddle problem at a settled point: H, A, and how strongly the multipliers answer a push.

With H the Hessian of the Lagrangian over the primal neurons and A the constraints' Jacobian,

.. math:: K = \begin{pmatrix} H & A^T \\ A & 0 \end{pmatrix}, \qquad
    Q = (A H^{-1} A^T)^{-1} = -(K^{-1})_{dual, dual} .

Q is the *shadow stiffness*: where a row is pushed, the optimal multiplier answers with Q times the
push. Its largest eigenvalue over the penalty says how slow the multipliers are, its smallest one
which penalty H + A'WA needs to be positive definite.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.arnoldi import LinearOperator
from ann_dc.analysis.spectra import DENSE_LIMIT
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.reference import tape_with_penalty
from ann_dc.evaluation.tape import DUAL
from ann_dc.network.network import Network


@dataclass(frozen=True, kw_only=True, eq=False)
class Saddle:
    """H and A of a network with PI duals at a state; z primal neurons, d dual ones.

    Attributes
    ----------
    primal, dual : (z,) and (d,) arrays of int
        Their components in the state vector.
    H : (z, z) sparse array
        Hessian of the Lagrangian.
    A : (d, z) sparse array
        Jacobian of the constraints.

    References
    ----------
    .. [1] M. Benzi, G. H. Golub, J. Liesen, Numerical solution of saddle point problems, Acta
       Numerica 14, 2005, 1-137.

    Examples
    --------
    >>> from ann_dc import equilibrium, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> saddle = saddle_of(network, equilibrium(network, network.start_state))
    >>> low, high = saddle.shadow_range(np.ones(len(saddle.dual)))
    >>> low > -1e-9, high > 0  # a convex problem needs no penalty
    (True, True)
    """

    primal: np.ndarray
    dual: np.ndarray
    H: Any
    A: Any

    @property
    def K(self) -> Any:
        """The KKT matrix (z + d, z + d), primal neurons first, sparse."""
        return sparse.block_array([[self.H, self.A.T], [self.A, None]], format="csc")

    @cached_property
    def shadow(self) -> np.ndarray:
        """Q (d, d), dense.

        Raises
        ------
        numpy.linalg.LinAlgError
            If K is singular.
        """
        z = len(self.primal)
        Q = -np.linalg.inv(self.K.toarray())[z:, z:]
        return 0.5 * (Q + Q.T)

    def shadow_range(self, weights: np.ndarray) -> tuple[float, float]:
        """Smallest and largest eigenvalue of W^{-1/2} Q W^{-1/2}, for row weights (d,).

        Raises
        ------
        numpy.linalg.LinAlgError, RuntimeError
            If K is singular, or the iteration of a large network fails.
        """
        root = np.sqrt(weights)
        if len(self.primal) + len(self.dual) <= DENSE_LIMIT:
            values = np.linalg.eigvalsh(self.shadow / root[:, None] / root)
            return float(values[0]), float(values[-1])
        solver, z = scipy.sparse.linalg.splu(self.K), len(self.primal)
        pushed = np.zeros(z + len(self.dual))

        def answer(v: np.ndarray) -> np.ndarray:
            pushed[z:] = v.ravel() / root
            return -solver.solve(pushed)[z:] / root

        Q = LinearOperator((len(root),) * 2, matvec=answer, dtype=float)
        low, high = (_extreme(Q, which) for which in ("SA", "LA"))
        return low, high


def _extreme(operator: Any, which: str) -> float:
    """One end of a symmetric operator's spectrum, by Lanczos iterations."""
    found = scipy.sparse.linalg.eigsh(
        operator,
        k=1,
        which=which,
        v0=np.ones(operator.shape[0]),
        tol=1e-3,  # pyright: ignore[reportArgumentType]
        ncv=60,
        maxiter=100,
        return_eigenvectors=False,
    )
    return float(found[0])


def saddle_of(network: Network, x: np.ndarray) -> Saddle:
    """H and A of a network at a state.

    Parameters
    ----------
    network : Network
        With PI duals; its own penalties do not count.
    x : (n,) array
        A settled state.

    Returns
    -------
    Saddle
    """
    evaluator = CompiledEvaluator(network, tape_with_penalty(network, 0.0))
    is_dual = evaluator.tape.roles[network.places[:, 0]] == DUAL
    primal, dual = np.flatnonzero(~is_dual), np.flatnonzero(is_dual)
    # rows of the flow: primal -(H, A'), dual (A, 0)
    flow = evaluator.drive_jacobian(x)
    H = -flow[primal][:, primal]
    return Saddle(primal=primal, dual=dual, H=0.5 * (H + H.T), A=flow[dual][:, primal])
