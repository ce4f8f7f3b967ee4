r"""Optimality certificate of a point, from the exact derivatives of the problem.

The network is not used. First order: the relative residuals of (11)-(15),

.. math:: \max(|c|_\infty / \max|q|,\; |\nabla L|_\infty / \max(|\nabla E|_\infty, |d|_\infty)),

where c are all constraints and d all multipliers. Every component is in the problem's
`natural_scales`, so certificates do not depend on units. Inequalities must hold, with multipliers
of the right sign if active and zero if inactive (`complementarity`). With soft constraints, the
optimum is that of the softened problem, and `soft_rows` lists the exceeded constraints.

Second order: the Hessian of the Lagrangian is positive definite on the tangent space of the
constraints (`by_stages`). A Newton step from the point estimates the distance to the optimum by
component. Simulation: the controls, applied to f from q_0 (settled value if free), must reach q_d.
The run time is linear in N.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, TypeAlias

import numpy as np

from ann_dc.dataclass_pickling import WHERE_GIVEN
from ann_dc.errors import ArgumentValueError
from ann_dc.optimality.by_stages import Minimum
from ann_dc.optimality.complementarity import Complementarity, Largest
from ann_dc.optimality.contact import SMALLEST_STATE
from ann_dc.optimality.expansion import Expansion
from ann_dc.optimality.minimum import minimum_of
from ann_dc.optimality.newton import newton_step
from ann_dc.optimality.soft_constraints import SoftRows
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.summaries import summarised
from ann_dc.validation import OrNan, Shape, checked

StageStates: TypeAlias = Annotated[np.ndarray, Shape("problem.n", "problem.horizon"), OrNan()]

Multipliers: TypeAlias = Annotated[np.ndarray, OrNan()]

LARGEST_RESIDUAL = 1e-8
"""Largest relative KKT residual of a certified point."""
LARGEST_STEP = 1e-4
"""Largest relative Newton step of a certified point."""


@summarised(
    lambda self: {
        "objective": f"{self.objective:.10g}",
        "KKT residual": f"{self.kkt_residual:.1e}",
        "second order": self.minimum.value,
        "Newton step": f"{self.newton_step:.1e}",
        "certified": "yes" if self.certified else f"no, {self.reason}",
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate:
    """Optimality certificate of a settled point.

    Attributes
    ----------
    objective : float
        E at the settled neurons, in the user's units, including the cost of soft constraints and
        the largest of several objectives.
    constraint_residual, stationarity_residual : float
        Relative first-order residuals, defined in the module docstring.
    minimum : Minimum
        Sign of the Hessian of the Lagrangian on the tangent space of the constraints.
    newton_step : float
        Largest change of a state or control in a Newton step, relative to the range of the
        component. Estimates the distance to the optimum; nan if the step is not defined.
    rollout_error : float
        Simulation error: largest distance between the simulated end and a fixed component of
        q_d, in the scale of the component.
    rollout : (n, N+1) array
        States that the controls produce.
    complementarity : Complementarity or None
        Residuals of inequalities and control limits; None if the problem has none.
    soft_rows : SoftRows or None
        Exceeded soft constraints and their violations; None if the problem has no soft constraint.
    largest : Largest or None
        Objectives of a minimax problem; None if the problem has none. First and second order then
        refer to the cost weighted by the shares of the objectives.
    """

    objective: float
    constraint_residual: float
    stationarity_residual: float
    minimum: Minimum
    newton_step: float
    rollout_error: float
    rollout: np.ndarray
    complementarity: Complementarity | None = field(default=None, metadata={WHERE_GIVEN: True})
    soft_rows: SoftRows | None = field(default=None, metadata={WHERE_GIVEN: True})
    largest: Largest | None = field(default=None, metadata={WHERE_GIVEN: True})

    @property
    def kkt_residual(self) -> float:
        """Larger of the two relative first-order residuals."""
        return float(np.maximum(self.constraint_residual, self.stationarity_residual))

    @property
    def first_order(self) -> bool:
        """True if first-order residuals, inequalities and objectives are within limits."""
        return not self._missed

    @property
    def second_order(self) -> bool:
        """True if the reduced Hessian is positive definite; optimal with `first_order`."""
        return self.minimum is Minimum.STRICT

    @property
    def certified(self) -> bool:
        """True if first order, second order and Newton step are within their limits."""
        return bool(self.first_order and self.second_order and self.newton_step < LARGEST_STEP)

    @property
    def verdict(self) -> str:
        """Second-order result in words; not checked if the first order fails."""
        return f"not checked: {self._missed}" if self._missed else self.minimum.value

    @property
    def reason(self) -> str:
        """Reason for the certificate or for its refusal."""
        if self._missed:
            return self._missed
        if not self.second_order:
            return f"second order: {self.verdict}"
        if not self.newton_step < LARGEST_STEP:
            return f"a Newton step still changes a component by {self.newton_step:.1e} of its range"
        return self.verdict

    @property
    def _missed(self) -> str:
        """Description of the first-order condition that fails; empty if all hold."""
        if not self.kkt_residual < LARGEST_RESIDUAL:
            return f"the KKT residual {self.kkt_residual:.1e} is not below {LARGEST_RESIDUAL:g}"
        for part in (self.complementarity, self.largest):
            if part is not None and part.reason:
                return part.reason
        return ""

    def __str__(self) -> str:
        told_of = (self.complementarity, self.soft_rows, self.largest)
        return "\n".join(
            [
                f"objective              {self.objective:.10g}",
                f"constraint residual    {self.constraint_residual:.2e}",
                f"stationarity residual  {self.stationarity_residual:.2e}",
                *(str(reported) for reported in told_of if reported is not None),
                f"second order           {self.verdict}",
                f"Newton step            {self.newton_step:.2e}",
                f"simulation error       {self.rollout_error:.2e}",
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
    zeta: Multipliers | None = None,
    zeta_end: Multipliers | None = None,
    *shares: Multipliers,
) -> Certificate:
    """Compute the optimality certificate of a point in the user's units.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem with N stages, n states and m controls.
    q : (n, N) array
        States of the N stages.
    u : (m, N) array
        Controls of the N stages.
    t : (n, N) array
        Targets; t_{N-1} is the terminal state.
    mu, beta : (n, N) arrays
        Multipliers; beta_0 is not used (q_0 is given or free).
    zeta : (r, N) array, optional
        Multipliers of ``problem.inequalities``; default zero.
    zeta_end : (r_e,) array, optional
        Multipliers of ``problem.end_inequalities``; default zero. Multipliers of control limits are
        computed from the gradient.
    *shares : (p,) array
        Weights of ``problem.objectives`` in the minimax cost, one array; default equal.

    Returns
    -------
    Certificate

    Raises
    ------
    ArgumentValueError
        If ``zeta``, ``zeta_end`` or ``shares`` has a wrong shape.

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
    _check_rows("zeta", zeta, (len(problem.inequalities), problem.horizon))
    _check_rows("zeta_end", zeta_end, (len(problem.end_inequalities),))
    of_all = None if not shares else np.concatenate([np.ravel(given) for given in shares])
    _check_rows("shares", of_all, (len(problem.objectives),))
    states = np.column_stack([q, t[:, -1]])
    zeta = np.zeros((len(problem.inequalities), problem.horizon)) if zeta is None else zeta
    zeta_end = np.zeros(len(problem.end_inequalities)) if zeta_end is None else zeta_end
    expansion = Expansion.at(problem, states, u, mu, zeta, zeta_end, of_all)
    contact = expansion.contact
    largest = Largest.of(problem, states, u, of_all)
    first, last = expansion.ends
    with np.errstate(all="ignore"):
        rollout = problem.functions.rollout(np.where(expansion.fixed_start, first, q[:, 0]), u)
        missed = np.abs(rollout[:, -1] - last) / expansion.state
        return Certificate(
            objective=expansion.objective + (0.0 if largest is None else largest.excess),
            constraint_residual=_constraints(expansion, q, t),
            stationarity_residual=_stationarity(expansion, beta),
            minimum=minimum_of(expansion),
            newton_step=newton_step(expansion, states),
            rollout_error=_largest(missed[expansion.fixed]),
            rollout=rollout,
            complementarity=contact and Complementarity.of(contact, expansion.largest_slope()),
            soft_rows=SoftRows.of(problem, (states, u), (zeta, zeta_end)),
            largest=largest,
        )


def _check_rows(name: str, given: np.ndarray | None, shape: tuple[int, ...]) -> None:
    if given is not None and given.shape != shape:
        raise ArgumentValueError(
            f"{name}: expected an array of shape {shape}, a row for each inequality of the "
            f"problem, got one of shape {given.shape}"
        )


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max(initial=0.0))


def _constraints(expansion: Expansion, q: np.ndarray, t: np.ndarray) -> float:
    """Return the residual of dynamics and ends relative to the largest state."""
    first, last = expansion.ends
    ends = [
        np.where(expansion.fixed_start, q[:, 0] - first, 0.0),
        np.where(expansion.fixed, t[:, -1] - last, 0.0),
    ]
    gaps = np.column_stack([expansion.map - t, q[:, 1:] - t[:, :-1], *ends])
    states = np.column_stack([q, t, last]) - first[:, None]
    factor = expansion.state[:, None]
    size = np.maximum(SMALLEST_STATE, _largest(states / factor))
    return float(_largest(gaps / factor) / size)


def _stationarity(expansion: Expansion, beta: np.ndarray) -> float:
    """Return the Lagrangian gradient relative to the largest gradient or multiplier."""
    n, mu = len(beta), expansion.mu
    beta = (beta.T * (expansion.state / expansion.cost))[1:]
    own = expansion.own_slope()
    own[1:, :n] += beta
    own[0, :n][expansion.fixed_start] = 0.0
    end = (expansion.own_end_slope() - mu[-1])[~expansion.fixed]
    residual = np.max([_largest(part) for part in (own, mu[:-1] + beta, end)])
    size = np.maximum(expansion.largest_slope(), _largest(beta))
    return float(residual / size)
