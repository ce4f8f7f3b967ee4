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
from scipy import sparse

from ann_dc.analysis.saddle import Saddle, saddle_of
from ann_dc.analysis.spectra import dense_flow
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import DUAL, STATE
from ann_dc.hints.checked import checked
from ann_dc.hints.values import State
from ann_dc.network.network import Network


@checked
def penalty_threshold(network: Network, x: State) -> float:
    r"""rho*: the smallest common penalty that makes H + rho A'A positive definite at a KKT point.

    .. math::
        \rho^* = \max(0, -\lambda_{min}(Q))

    with the shadow stiffness Q of `Saddle`, in the network's own units. Sufficient for stability;
    the flow's own threshold can be lower. Infinite at a saddle, where no penalty is enough; nan
    where K is singular or the iteration of a large network fails.

    Parameters
    ----------
    network : Network
        With PI duals.
    x : (n,) array
        A settled state.

    Returns
    -------
    float

    References
    ----------
    .. [1] D. P. Bertsekas, Constrained Optimization and Lagrange Multiplier Methods, Academic
       Press, 1982.

    Examples
    --------
    >>> from ann_dc import equilibrium, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> penalty_threshold(network, equilibrium(network, network.start_state)) < 1e-6
    True
    """
    return threshold_of(saddle_of(network, x))


def threshold_of(saddle: Saddle) -> float:
    """rho* of a saddle problem whose H and A are known; see `penalty_threshold`.

    Parameters
    ----------
    saddle : Saddle
        At a settled point.

    Returns
    -------
    float
    """
    try:
        if not saddle.is_minimum:
            return float("inf")
        low, _ = saddle.shadow_range(np.ones(len(saddle.dual)))
    except (np.linalg.LinAlgError, RuntimeError):  # K is singular: the point is not isolated
        return float("nan")
    return max(0.0, -low)


def is_strict_minimum(network: Network, jacobian: Any, resting: np.ndarray) -> bool:
    """Whether a settled point is one that the flow can rest at, from its drive Jacobian.

    With PI duals: the reduced Hessian is positive definite, a strict local minimum (K has as many
    negative eigenvalues as constraints). Without, or with neurons that are no part of the
    optimisation (poles of the hardware): no eigenvalue of the flow leads away.

    Parameters
    ----------
    network : Network
    jacobian : (n, n) sparse array
        d drive / dx at the point.
    resting : (n,) array of bool
        Which neurons stand at a rail; they are left out.

    Returns
    -------
    bool
    """
    leaking = _leaking(network, jacobian)
    free = np.flatnonzero(~(resting | leaking))
    role = evaluator(network).tape.roles[network.places[:, 0]][free]
    inside = jacobian[free][:, free]
    if network.cell.duals and not (role == STATE).any():
        inside = inside + _of_compliance(jacobian, free, np.flatnonzero(leaking & ~resting))
        # rows of the flow: primal -(H + A'WA, A'), dual (A, 0)
        primal, dual = np.flatnonzero(role != DUAL), np.flatnonzero(role == DUAL)
        H, A = -inside[primal][:, primal], inside[dual][:, primal]
        return Saddle(primal=primal, dual=dual, H=0.5 * (H + H.T), A=A).is_minimum
    flow = dense_flow(network.metric, network.row, jacobian, ~resting)
    return bool((np.real(np.linalg.eigvals(flow)) < 0).all())


def _leaking(network: Network, jacobian: Any) -> np.ndarray:
    """(n,) booleans: which diode neurons leak: idle ones, those at a price, and compliant ones."""
    diodes = [network.neuron_index[diode.neuron] for diode in network.cell.diodes]
    return np.isin(network.places[:, 0], diodes) & (jacobian.diagonal() < 0)


def _of_compliance(jacobian: Any, free: np.ndarray, leaking: np.ndarray) -> Any:
    """What neurons that leak, and rest where they do, add to the Jacobian of the free ones."""
    leak = sparse.diags_array(1.0 / -jacobian.diagonal()[leaking])
    return jacobian[free][:, leaking] @ leak @ jacobian[leaking][:, free]
