r"""Saddle-point problem at a settled point: H, A and multiplier sensitivity.

With H the Hessian of the Lagrangian over the primal neurons and A the constraints' Jacobian,

.. math:: K = \begin{pmatrix} H & A^T \\ A & 0 \end{pmatrix}, \qquad
    Q = (A H^{-1} A^T)^{-1} = -(K^{-1})_{dual, dual} .

Q is the *inverse Schur complement*: the optimal multipliers respond to a constraint perturbation
with Q times the perturbation. Its largest eigenvalue relative to the penalty measures the slowness
of the multipliers. Its smallest eigenvalue determines the penalty that makes H + A'WA positive
definite.

The symmetric K has as many negative eigenvalues as there are constraints if and only if H is
positive definite on the null space of A: at a strict local minimum (Nocedal and Wright, Numerical
Optimization, 2006, theorem 16.3). The flow's Jacobian has the primal rows with the opposite sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.analysis.linearisation import softness
from ann_dc.analysis.spectra import DENSE_LIMIT, LinearOperator, dense_flow
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator, tape_with_penalty
from ann_dc.evaluation.rules import DUAL, POSITION, PRIMAL, STATE
from ann_dc.network.network import Network
from ann_dc.validation import State, checked

# ---- the saddle problem at a settled point: H, A, and how strongly the multipliers answer a push

_LARGEST_PENALTY = 1e6
"""Largest rho tested, over the largest entry of K: if H + rho A'A is not positive definite there,
no rho suffices. For larger ones, rounding errors of rho A'A exceed H.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Saddle:
    """H and A of a network with PI duals at a state; z primal neurons, d dual ones.

    Attributes
    ----------
    primal, dual : (z,) and (d,) arrays of int
        Components of the state vector, without saturated neurons and inactive inequalities.
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
    >>> low, high = saddle.sensitivity_range(np.ones(len(saddle.dual)))
    >>> low > -1e-9, high > 0  # a convex problem needs no penalty
    (True, True)
    """

    primal: np.ndarray
    dual: np.ndarray
    H: Any
    A: Any

    @property
    def K(self) -> Any:
        """KKT matrix (z + d, z + d), sparse, primal neurons first."""
        return sparse.block_array([[self.H, self.A.T], [self.A, None]], format="csc")

    @property
    def is_minimum(self) -> bool:
        """True if H is positive definite on the null space of A (strict local minimum).

        K then has as many negative eigenvalues as A has rows. Above `DENSE_LIMIT` neurons, H + rho
        A'A is factored instead, with a penalty larger than any design would choose.
        """
        if len(self.primal) + len(self.dual) <= DENSE_LIMIT:
            return bool((np.linalg.eigvalsh(self.K.toarray()) < 0).sum() == len(self.dual))
        return self.is_convex

    @cached_property
    def is_convex(self) -> bool:
        """True if H + rho A'A is positive definite for a large rho; rows may be dependent."""
        penalty = _LARGEST_PENALTY * abs(self.K).max()
        return _is_positive_definite(self.H + penalty * (self.A.T @ self.A))

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """Q (d, d), dense. Raises numpy.linalg.LinAlgError if K is singular."""
        z = len(self.primal)
        Q = -np.linalg.inv(self.K.toarray())[z:, z:]
        return 0.5 * (Q + Q.T)

    def answer(self, pushes: np.ndarray) -> np.ndarray:
        """Return Q times perturbations (d,) or (d, b), by sparse solves.

        Raises RuntimeError if K is singular.
        """
        padded = np.zeros((len(self.primal) + len(self.dual), *pushes.shape[1:]))
        padded[len(self.primal) :] = pushes
        return -self._solver.solve(padded)[len(self.primal) :]

    @cached_property
    def _solver(self) -> Any:
        return scipy.sparse.linalg.splu(self.K)

    def sensitivity_range(self, weights: np.ndarray) -> tuple[float, float]:
        """Return the extreme eigenvalues of W^{-1/2} Q W^{-1/2} for weights (d,).

        Raises numpy.linalg.LinAlgError or RuntimeError if K is singular, or if the iteration of a
        large network fails.
        """
        root = np.sqrt(weights)
        if len(self.primal) + len(self.dual) <= DENSE_LIMIT:
            values = np.linalg.eigvalsh(self.sensitivity / root[:, None] / root)
            return float(values[0]), float(values[-1])
        Q = LinearOperator(
            (len(root),) * 2, matvec=lambda v: self.answer(v.ravel() / root) / root, dtype=float
        )
        return _ends(Q)


@dataclass(frozen=True, kw_only=True, eq=False)
class MultiplierSensitivity:
    """Multiplier sensitivity Q of one constraint, over the stages that have it.

    Attributes
    ----------
    neuron, penalty : str and float
        Dual neuron of the constraint, for example ``mu.theta``, and w, for comparison with Q.
    at_stage : (b,) array
        Q of a perturbation at one stage, by stage.
    lowest, highest : float
        Smallest and largest eigenvalue of Q over the horizon.

    Examples
    --------
    >>> row = MultiplierSensitivity(
    ...     neuron="mu.x", penalty=2.0, at_stage=np.ones(3), lowest=0.5, highest=8.0
    ... )
    >>> row.reach
    4.0
    """

    neuron: str
    penalty: float
    at_stage: np.ndarray
    lowest: float
    highest: float

    @property
    def reach(self) -> float:
        """Larger end of Q over the penalty; above one the constraint is weakly reachable."""
        return max(self.highest, -self.lowest) / self.penalty


@checked
def multiplier_sensitivities(
    network: Network, saddle: Saddle, penalties: np.ndarray
) -> tuple[MultiplierSensitivity, ...]:
    """Return the multiplier sensitivity of every constraint.

    `penalties` (P,) are those of every dual neuron's constraint, positive, in network units. The
    result has the order of the cell's duals, then of its diodes. Raises RuntimeError if K is
    singular.
    """
    rows, owner = [], network.places[saddle.dual, 0]
    for dual in (*network.cell.duals, *network.cell.inequality_duals):
        index = network.neuron_index[dual.neuron]
        own = np.flatnonzero(owner == index)
        pushes = np.zeros((len(owner), len(own)))
        pushes[own, np.arange(len(own))] = 1.0
        block = saddle.answer(pushes)[own]
        values = np.linalg.eigvalsh(block) if len(own) else np.zeros(1)
        rows.append(
            MultiplierSensitivity(
                neuron=dual.neuron,
                penalty=float(penalties[index]),
                at_stage=np.diag(block).copy(),
                lowest=float(values[0]),
                highest=float(values[-1]),
            )
        )
    return tuple(rows)


def _is_positive_definite(matrix: Any) -> bool:
    """Return True if a symmetric sparse matrix ordered by stage is positive definite."""
    try:
        factors = scipy.sparse.linalg.splu(
            sparse.csc_array(matrix),
            permc_spec="NATURAL",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError:  # exactly singular
        return False
    in_place = (factors.perm_r == factors.perm_c).all()
    return bool(in_place and (factors.U.diagonal() > 0).all())


def _ends(operator: Any) -> tuple[float, float]:
    """Return both ends of a symmetric operator's spectrum, by Lanczos iterations."""
    found: Any = scipy.sparse.linalg.eigsh(
        operator,
        k=2,
        which="BE",
        v0=np.ones(operator.shape[0]),
        tol=1e-3,  # pyright: ignore[reportArgumentType]
        ncv=60,
        maxiter=100,
        return_eigenvectors=False,
    )
    return float(found.min()), float(found.max())


@checked
def saddle_of(network: Network, x: State, *, among: Saddle | None = None) -> Saddle:
    """Return H and A of a network at a settled state (n,).

    The network must have PI duals; its penalties are ignored. `among` is a saddle of the network at
    another state, whose neurons are then used, whatever saturates at this state.
    """
    evaluator = fast_evaluator(network, tape_with_penalty(network, 0.0))
    role = evaluator.tape.roles[network.places[:, 0]]
    primal = np.flatnonzero(((role == PRIMAL) | (role == POSITION)) & evaluator.free(x))
    dual = np.flatnonzero((role == DUAL) & ~_still(network, x))
    if among is not None:
        primal, dual = among.primal, among.dual
    # rows of the flow: primal -(H, A'), dual (A, 0)
    flow = evaluator.drive_jacobian(x)
    H, A = -flow[primal][:, primal], flow[dual][:, primal]
    if (
        network.cell.inequality_duals
    ):  # without penalties their rows are zero: they stand in columns alone
        diodes = [network.neuron_index[diode.neuron] for diode in network.cell.inequality_duals]
        of_diode = sparse.diags_array(np.isin(network.places[dual, 0], diodes).astype(float))
        A = A - of_diode @ flow[primal][:, dual].T
        _, compliance = softness(network, evaluator.tape.weights)
        d = network.pack(compliance)[dual]
        if d.any():  # g = d zeta: a curvature G' G / d, and no row that has to hold
            G = A[d > 0]
            H = H + G.T @ sparse.diags_array(1.0 / d[d > 0]) @ G
            A, dual = A[d == 0], dual[d == 0]
    return Saddle(primal=primal, dual=dual, H=0.5 * (H + H.T), A=A)


def _still(network: Network, x: np.ndarray) -> np.ndarray:
    """Return the inequality multipliers (n,) of bool that are inactive or at a price."""
    still = np.zeros(network.live.shape, bool)
    if network.cell.inequality_duals:
        values, index = fast_evaluator(network).values(x)[:, 1:-1], network.node_index
        for diode in network.cell.inequality_duals:
            own = ~(values[index[diode.sum]] > 0)
            if diode.excess:
                own |= values[index[diode.excess]] > 0
            still[network.neuron_index[diode.neuron]] = own
    return network.pack(still)


# ---- what the drive Jacobian K says of a settled point: is it a minimum, and which penalty holds


@checked
def penalty_threshold(network: Network, x: State) -> float:
    r"""Return rho*, the smallest common penalty with H + rho A'A > 0 at a KKT point.

    .. math::
        \rho^* = \max(0, -\lambda_{min}(Q))

    where Q is the inverse Schur complement of `Saddle`, in the network's units. rho* is sufficient
    for stability; the flow's threshold can be lower. The result is infinite at a saddle point,
    where no penalty suffices, and nan if K is singular or the iteration of a large network fails.
    The network must have PI duals; `x` (n,) is a settled state.

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
    """Return rho* of known H and A at a settled point; see `penalty_threshold`."""
    try:
        if not saddle.is_minimum:
            return float("inf")
        low, _ = saddle.sensitivity_range(np.ones(len(saddle.dual)))
    except (np.linalg.LinAlgError, RuntimeError):  # K is singular: the point is not isolated
        return float("nan")
    return max(0.0, -low)


def is_strict_minimum(network: Network, jacobian: Any, saturated: np.ndarray) -> bool:
    """Return True if a settled point is a strict minimum, from its drive Jacobian.

    With PI duals, the reduced Hessian must be positive definite (K has as many negative eigenvalues
    as constraints). Without PI duals, or with neurons outside the optimisation (poles of the
    hardware), no eigenvalue of the flow may be unstable. `jacobian` (n, n) is d drive / dx at the
    point; neurons in `saturated` (n,), which are saturated, are omitted.
    """
    leaking = _leaking(network, jacobian)
    free = np.flatnonzero(~(saturated | leaking))
    role = evaluator(network).tape.roles[network.places[:, 0]][free]
    inside = jacobian[free][:, free]
    if network.cell.duals and not (role == STATE).any():
        inside = inside + _of_compliance(jacobian, free, np.flatnonzero(leaking & ~saturated))
        # rows of the flow: primal -(H + A'WA, A'), dual (A, 0)
        primal, dual = np.flatnonzero(role != DUAL), np.flatnonzero(role == DUAL)
        H, A = -inside[primal][:, primal], inside[dual][:, primal]
        return Saddle(primal=primal, dual=dual, H=0.5 * (H + H.T), A=A).is_minimum
    flow = dense_flow(network.preconditioner, network.layout, jacobian, ~saturated)
    return bool((np.real(np.linalg.eigvals(flow)) < 0).all())


def _leaking(network: Network, jacobian: Any) -> np.ndarray:
    """Return the diode neurons (n,) that leak: inactive, at a price, or compliant."""
    diodes = [network.neuron_index[diode.neuron] for diode in network.cell.inequality_duals]
    return np.isin(network.places[:, 0], diodes) & (jacobian.diagonal() < 0)


def _of_compliance(jacobian: Any, free: np.ndarray, leaking: np.ndarray) -> Any:
    """Return the contribution of leaking neurons to the Jacobian of the free ones."""
    leak = sparse.diags_array(1.0 / -jacobian.diagonal()[leaking])
    return jacobian[free][:, leaking] @ leak @ jacobian[leaking][:, free]
