r"""Is it the optimum? Checked with the problem's own exact derivatives, not with the network.

First order: the residuals of (11)-(15), relative,

.. math:: \max(|c|_\infty / \max|q|,\; |\nabla L|_\infty / \max(|\nabla E|_\infty, |d|_\infty)),

with c all constraints and d all multipliers. Second order: the Hessian of the Lagrangian is
positive definite on the tangent space of the constraints; the states are eliminated through the
linearised plant, so the matrix is that of the controls, restricted to those that keep the fixed
end. A Newton step from the point shows how far the optimum can be, component by component. After
the fact: the controls alone, fed through f from q_0, have to arrive at q_d.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ann_dc.optimality.newton import newton_step
from ann_dc.problem.declaration import OptimalControlProblem

LARGEST_RESIDUAL = 1e-8
"""Relative KKT residual of a certified point."""
LARGEST_STEP = 1e-4
"""Relative Newton step of a certified point."""
LARGEST_REDUCED = 2000
"""Number of control values above which the second-order check is left out."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """What is known about a settled point.

    Attributes
    ----------
    objective : float
        E at the settled neurons, in the user's units.
    constraint_residual, stationarity_residual : float
        Relative, see the module docstring.
    curvature : float
        Smallest eigenvalue of the reduced Hessian relative to its largest; nan where the
        check was left out, inf where the fixed end leaves the controls no freedom.
    newton_step : float
        How far a Newton step moves a state or a control, at most, relative to the component's own
        range: an estimate of the distance to the optimum. nan where it is not defined.
    rollout_error : float
        Largest distance between the end of the roll-out and a fixed component of q_d.
    rollout : (n, N+1) array
        The states that the controls produce.
    """

    objective: float
    constraint_residual: float
    stationarity_residual: float
    curvature: float
    newton_step: float
    rollout_error: float
    rollout: np.ndarray

    @property
    def kkt_residual(self) -> float:
        """The larger of the two first-order residuals."""
        return max(self.constraint_residual, self.stationarity_residual)

    @property
    def second_order(self) -> bool:
        """Whether the reduced Hessian is positive definite: a strict local minimum."""
        return bool(self.curvature > 1e-12)

    @property
    def certified(self) -> bool:
        """First order, second order, and no component hiding behind another's scale."""
        return bool(
            self.kkt_residual < LARGEST_RESIDUAL
            and self.second_order
            and self.newton_step < LARGEST_STEP
        )

    @property
    def verdict(self) -> str:
        """The second-order check in words."""
        if np.isnan(self.curvature):
            return "not checked"
        good, bad = "strict local minimum", "NOT a minimum: reduced Hessian not positive definite"
        return good if self.second_order else bad

    @property
    def reason(self) -> str:
        """Why the point is certified, or why not."""
        if not self.second_order:
            return f"second order: {self.verdict}"
        if not self.kkt_residual < LARGEST_RESIDUAL:
            return f"the KKT residual {self.kkt_residual:.1e} is not below {LARGEST_RESIDUAL:g}"
        if not self.newton_step < LARGEST_STEP:
            return f"a Newton step still moves a component by {self.newton_step:.1e} of its range"
        return self.verdict

    def __str__(self) -> str:
        return "\n".join(
            [
                f"objective              {self.objective:.10g}",
                f"constraint residual    {self.constraint_residual:.2e}",
                f"stationarity residual  {self.stationarity_residual:.2e}",
                f"second order           {self.verdict}",
                f"Newton step            {self.newton_step:.2e}",
                f"roll-out error         {self.rollout_error:.2e}",
            ]
        )


def certify(
    problem: OptimalControlProblem,
    q: np.ndarray,
    u: np.ndarray,
    t: np.ndarray,
    mu: np.ndarray,
    beta: np.ndarray,
) -> Certificate:
    """Certificate of a point in the user's units.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N) array
        States of the N stages.
    u : (m, N) array
    t : (n, N) array
        Targets; t_{N-1} is the end.
    mu, beta : (n, N) arrays
        Multipliers; beta_0 is not used (q_0 is given).

    References
    ----------
    Paper equations (11)-(15), corrected.
    """
    functions = problem.functions
    end = np.column_stack([q, t[:, -1]])
    with np.errstate(all="ignore"):
        ends = np.array(
            [value for value in (*problem.q_0, *(problem.q_d or ())) if value is not None]
        )
        constraint = _relative(_constraints(problem, q, u, t), [end, ends])
        stationarity = _stationarity(problem, q, u, t, mu, beta)
        rollout = functions.rollout(problem.q_0, u)
        fixed = [(rollout[i, -1], d) for i, d in enumerate(problem.q_d or ()) if d is not None]
        return Certificate(
            objective=functions.objective(end, u),
            constraint_residual=constraint,
            stationarity_residual=stationarity,
            curvature=_curvature(problem, q, u, t, mu),
            newton_step=newton_step(problem, end, u, mu),
            rollout_error=max((abs(a - b) for a, b in fixed), default=0.0),
            rollout=rollout,
        )


def _constraints(problem: OptimalControlProblem, q, u, t) -> np.ndarray:
    """Map, coupling and both ends: everything that has to be zero."""
    fixed = [i for i, value in enumerate(problem.q_d or ()) if value is not None]
    target = np.array([(problem.q_d or ())[i] for i in fixed], float)
    return np.concatenate(
        [
            (problem.functions.map(q, u) - t).ravel(),
            (q[:, 1:] - t[:, :-1]).ravel(),
            q[:, 0] - np.array(problem.q_0),
            t[fixed, -1] - target,
        ]
    )


def _relative(residual: np.ndarray, scales: list[np.ndarray]) -> float:
    """|residual|_inf / max over scales; an absolute residual where all scales vanish."""
    scale = max(float(np.abs(s).max(initial=0.0)) for s in scales)
    size = float(np.abs(residual).max(initial=0.0))
    return size / scale if scale > 1e-9 else size


def _stationarity(problem, q, u, t, mu, beta) -> float:
    functions = problem.functions
    F, B = functions.map_jacobian(q, u)
    cost_q, cost_u = functions.cost_gradient(q, u)
    _, cost_end, _ = functions.terminal(t[:, -1])
    grad_q = (cost_q + np.einsum("ijk,ik->jk", F, mu) + beta)[:, 1:]
    grad_u = cost_u + np.einsum("ijk,ik->jk", B, mu)
    grad_t = -mu[:, :-1] - beta[:, 1:]
    free = ~np.array(problem.fixed)
    grad_end = (cost_end - mu[:, -1])[free]
    residual = np.concatenate([g.ravel() for g in (grad_q, grad_u, grad_t, grad_end)])
    return _relative(residual, [cost_q[:, 1:], cost_u, cost_end[free], mu, beta[:, 1:]])


def _curvature(problem: OptimalControlProblem, q, u, t, mu) -> float:
    n, m, stages = problem.n, problem.m, problem.horizon
    if stages * m > LARGEST_REDUCED:
        return float("nan")
    F, B = problem.functions.map_jacobian(q, u)
    hessian = problem.functions.hessian(q, u, mu)
    _, _, end = problem.functions.terminal(t[:, -1])
    reach = np.zeros((n, stages * m))  # dq_k / d(all controls)
    total = np.zeros((stages * m, stages * m))
    for k in range(stages):
        own = np.zeros((m, stages * m))
        own[:, k * m : (k + 1) * m] = np.eye(m)
        z = np.concatenate([reach, own])[:, : (k + 1) * m]
        total[: (k + 1) * m, : (k + 1) * m] += z.T @ hessian[:, :, k] @ z
        reach = F[:, :, k] @ reach + B[:, :, k] @ own
    total += reach.T @ end @ reach
    if not np.isfinite(total).all():
        return float("nan")
    tangent = (
        scipy.linalg.null_space(reach[np.array(problem.fixed)])
        if any(problem.fixed)
        else (np.eye(stages * m))
    )
    if tangent.shape[1] == 0:  # the end leaves no freedom: trivially a minimum
        return float("inf")
    values = np.linalg.eigvalsh(tangent.T @ total @ tangent)
    return float(values[0] / max(abs(values[-1]), 1e-300))
