r"""Is it the optimum? Checked with the problem's own exact derivatives, not with the network.

First order: the residuals of (11)-(15), relative,

.. math:: \max(|c|_\infty / \max|q|,\; |\nabla L|_\infty / \max(|\nabla E|_\infty, |d|_\infty)),

with c all constraints and d all multipliers, every component in the problem's `natural_scales`, so
that no certificate depends on units. Second order: the Hessian of the Lagrangian is positive
definite on the tangent space of the constraints; the states are eliminated through the linearised
plant, so the matrix is that of the controls and of what q_0 leaves free, restricted to those that
keep the fixed end. A Newton step from the point shows how far the optimum can be, component by
component. After the fact: the controls alone, fed through f from q_0 (as settled, where it is
free), have to arrive at q_d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
import scipy.linalg

from ann_dc.hints.checked import checked
from ann_dc.hints.values import OrNan, Shape
from ann_dc.optimality.newton import newton_step
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import Scales, natural_scales

StageStates: TypeAlias = Annotated[np.ndarray, Shape("problem.n", "problem.horizon"), OrNan()]

LARGEST_RESIDUAL = 1e-8
"""Relative KKT residual of a certified point."""
LARGEST_STEP = 1e-4
"""Relative Newton step of a certified point."""
SMALLEST_STATE = np.array(0.1)
"""Size, in its scale, to which the residual of a constraint is related at least."""
NOTHING = 1e-9
"""Size below which there is nothing that a residual could be related to."""
FLAT = 1e-12
"""Curvature, over the largest, between which and its negative there is none."""
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
        Largest distance between the end of the roll-out and a fixed component of q_d, in the scale
        of the component.
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
        return bool(self.curvature > FLAT)

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
        if self.second_order:
            return "strict local minimum"
        if self.curvature < -FLAT:
            return "NOT a minimum: the cost falls along a direction that keeps the constraints"
        return "not a strict minimum: the cost has no curvature along some direction"

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


@checked
def certify(
    problem: OptimalControlProblem,
    q: StageStates,
    u: Annotated[np.ndarray, Shape("problem.m", "problem.horizon")],
    t: StageStates,
    mu: StageStates,
    beta: StageStates,
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
        Multipliers; beta_0 is not used (q_0 is given, or free).

    Returns
    -------
    Certificate

    References
    ----------
    Paper equations (11)-(15), corrected.

    Examples
    --------
    >>> from ann_dc import equilibrium, plants, synthesize
    >>> from ann_dc.evaluation import kkt_point
    >>> problem = plants.double_integrator(N=5)
    >>> network = synthesize(problem)
    >>> x = equilibrium(network, network.start_state)
    >>> certificate = certify(problem, *kkt_point(network, x))
    >>> certificate.certified, round(certificate.objective, 6), certificate.verdict
    (True, 500.0, 'strict local minimum')
    """
    functions, scales = problem.functions, natural_scales(problem)
    end = np.column_stack([q, t[:, -1]])
    first, last = problem.ends
    with np.errstate(all="ignore"):
        rollout = functions.rollout(np.where(problem.fixed_start, first, q[:, 0]), u)
        missed = np.abs(rollout[:, -1] - last)[np.array(problem.fixed)]
        reached = scales.state_factors[np.array(problem.fixed)]
        return Certificate(
            objective=functions.objective(end, u),
            constraint_residual=_constraints(problem, scales, q, u, t),
            stationarity_residual=_stationarity(problem, scales, q, u, t, mu, beta),
            curvature=_curvature(problem, scales, q, u, t, mu),
            newton_step=newton_step(problem, end, u, mu),
            rollout_error=float((missed / reached).max(initial=0.0)),
            rollout=rollout,
        )


def _constraints(problem: OptimalControlProblem, scales: Scales, q, u, t) -> float:
    """Map, coupling and both ends, over the largest state: everything that has to be zero."""
    factor, (first, last) = scales.state_factors[:, None], problem.ends
    fixed = np.array(problem.fixed)
    residual = [
        problem.functions.map(q, u) - t,
        q[:, 1:] - t[:, :-1],
        np.where(problem.fixed_start, q[:, 0] - first, 0.0)[:, None],
        np.where(fixed, t[:, -1] - last, 0.0)[:, None],
    ]
    states = np.column_stack([q, t, last]) - first[:, None]
    return _relative([r / factor for r in residual], [states / factor, SMALLEST_STATE])


def _relative(residual: list[np.ndarray], sizes: list[np.ndarray]) -> float:
    """|residual|_inf / max |sizes|; an absolute residual where all sizes vanish."""
    largest = lambda arrays: max(float(np.abs(a).max(initial=0.0)) for a in arrays)  # noqa: E731
    size = largest(sizes)
    return largest(residual) / size if size > NOTHING else largest(residual)


def _stationarity(problem, scales: Scales, q, u, t, mu, beta) -> float:
    functions = problem.functions
    F, B = functions.map_jacobian(q, u)
    cost_q, cost_u = functions.cost_gradient(q, u)
    _, cost_end, _ = functions.terminal(t[:, -1])
    free, untied = ~np.array(problem.fixed), ~np.array(problem.fixed_start)
    of_state = scales.state_factors[:, None] / scales.cost
    of_control = scales.control_factors[:, None] / scales.cost
    slope_q = cost_q + np.einsum("ijk,ik->jk", F, mu)
    residual = [
        of_state * (slope_q + beta)[:, 1:],
        of_state[untied, 0] * slope_q[untied, 0],
        of_control * (cost_u + np.einsum("ijk,ik->jk", B, mu)),
        of_state * (-mu[:, :-1] - beta[:, 1:]),
        of_state[free, 0] * (cost_end - mu[:, -1])[free],
    ]
    slopes = [of_state * cost_q[:, 1:], of_control * cost_u, (of_state[:, 0] * cost_end)[free]]
    slopes += [(of_state * cost_q)[untied, 0]]
    return _relative(residual, [*slopes, of_state * mu, of_state * beta[:, 1:]])


def _curvature(problem: OptimalControlProblem, scales: Scales, q, u, t, mu) -> float:
    n, m, stages = problem.n, problem.m, problem.horizon
    if stages * m > LARGEST_REDUCED:
        return float("nan")
    untied = np.flatnonzero(~np.array(problem.fixed_start))
    size = len(untied) + stages * m  # a free q_0 is one more thing to choose, before all controls
    F, B = problem.functions.map_jacobian(q, u)
    hessian = problem.functions.hessian(q, u, mu)
    _, _, end = problem.functions.terminal(t[:, -1])
    reach = np.zeros((n, size))  # dq_k / d(all that is chosen)
    reach[untied, np.arange(len(untied))] = 1.0
    total = np.zeros((size, size))
    for k in range(stages):
        before = len(untied) + k * m
        own = np.zeros((m, size))
        own[:, before : before + m] = np.eye(m)
        z = np.concatenate([reach, own])[:, : before + m]
        total[: before + m, : before + m] += z.T @ hessian[:, :, k] @ z
        reach = F[:, :, k] @ reach + B[:, :, k] @ own
    total += reach.T @ end @ reach
    in_scale = np.concatenate(
        [scales.state_factors[untied], np.tile(scales.control_factors, stages)]
    )
    reach, total = reach * in_scale, in_scale[:, None] * total * in_scale
    if not np.isfinite(total).all():
        return float("nan")
    tangent = (
        scipy.linalg.null_space((reach / scales.state_factors[:, None])[np.array(problem.fixed)])
        if any(problem.fixed)
        else np.eye(size)
    )
    if tangent.shape[1] == 0:  # the end leaves no freedom: trivially a minimum
        return float("inf")
    values = np.linalg.eigvalsh(tangent.T @ total @ tangent)
    return float(values[0] / max(abs(values[-1]), 1e-300))
