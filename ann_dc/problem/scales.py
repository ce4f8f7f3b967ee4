r"""Scales of states, controls and cost, chosen so that network values are near one.

The network computes with :math:`\hat q = (q - c) / S`, :math:`v = (u - u_0) / U` and :math:`\hat E
= E / E_0`. A state has one scale for its whole chain. The scale combines the distance of the ends
with the excursion between them at small cost. The excursion is derived from the variance of a
Gaussian bridge along the straight line.

U makes the largest control effect :math:`|S^{-1} \partial f / \partial v|` one, and E_0 makes the
largest :math:`\partial^2 \hat E / \partial v^2` one. Offsets are q_0 and the controls of least
cost.

The scales are covariant: the network of a problem does not depend on its units.

The path of least cost from end to end is the mean of a Gaussian bridge, a random walk with density
exp(-E) whose ends are fixed. The variance of the bridge measures the distance that states deviate
from the mean at small cost. With V_k the Hessian of the cost to go,

.. math::
    X_{k+1} = G_k X_k G_k^T + B_k (R + B_k^T V_{k+1} B_k)^{-1} B_k^T, \qquad
    G_k = F_k - B_k (R + B_k^T V_{k+1} B_k)^{-1} B_k^T V_{k+1} F_k .

Fixed ends are stiff in V_N and zero in X_0; components that q_0 leaves free have V_0^{-1}.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ann_dc.errors import such_as
from ann_dc.problem.bounds import widths
from ann_dc.problem.declaration import HOLD, OptimalControlProblem
from ann_dc.problem.domain import into_domain, within_domain
from ann_dc.problem.step_length import SCALE
from ann_dc.scale import Scale
from ann_dc.validation import checked

STIFF = 1e8
"""Stiffness of a fixed end relative to the reach of the controls."""
HELD = 1e-6
"""Motion relative to the reach of the controls below which a state counts as fixed."""
FLAT = 1e-9
"""Curvature relative to the largest one below which the cost does not determine a free component of
q_0.
"""
EXPLOSION = 1e30
"""Variance relative to that of a non-growing map, above which F does not predict the excursions."""
GROWTH = 30.0
"""Growth of a disturbance beyond which earlier controls are omitted from the reach."""


def bridge_variance(
    F: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    fixed: np.ndarray,
    loose: np.ndarray | None = None,
) -> np.ndarray:
    """Return the variance (n, N) of q_1..q_N on a Gaussian bridge of density exp(-E).

    F (n, n, N) and B (n, m, N) are df/dq and df/du along a path, Q (n, N+1) and R (m,) the
    curvatures of the cost in states and controls. The variance is zero for a state that no control
    moves and at the end that is ``fixed`` (n,). It is infinite for a component that is free at q_0
    (``loose``) if no cost limits its excursion.
    """
    variance = _variance(F, B, Q, R, fixed, loose)
    norms = np.linalg.norm(F, axis=(0, 1))  # at least the spectral radii, and cheaper
    if np.log(np.maximum(norms, 1.0)).sum() <= np.log(EXPLOSION) / 2:
        return variance
    radii = np.maximum(np.abs(np.linalg.eigvals(np.moveaxis(F, -1, 0))).max(axis=1), 1.0)
    bounded = _variance(F / radii, B, Q, R, fixed, loose)
    return bounded if (variance > EXPLOSION * bounded)[bounded > 0].any() else variance


def _variance(
    F: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    fixed: np.ndarray,
    loose: np.ndarray | None,
) -> np.ndarray:
    """Return the variance by the recursion, without a limit on the growth of F."""
    n, m, stages = B.shape
    B = B / np.sqrt(R)[:, None]
    reached = _reached(F, B)
    V = np.diag(np.where(fixed & (reached > 0), STIFF / np.where(reached > 0, reached, 1.0), 0.0))
    feedback, share = np.empty((stages, m, n)), np.empty((stages, m, m))
    for k in range(stages - 1, -1, -1):
        V = V + np.diag(Q[:, k + 1])
        share[k] = np.linalg.inv(np.eye(m) + B[:, :, k].T @ V @ B[:, :, k])
        feedback[k] = share[k] @ B[:, :, k].T @ V @ F[:, :, k]
        G = F[:, :, k] - B[:, :, k] @ feedback[k]
        V = G.T @ V @ G + feedback[k].T @ feedback[k]  # not F'VG: an error of G counts squared
    X, variance = np.zeros((n, n)), np.empty((n, stages))
    loose = np.zeros(n, bool) if loose is None else loose
    X[np.ix_(loose, loose)], unknown = _at_start((V + np.diag(Q[:, 0]))[np.ix_(loose, loose)])
    for k in range(stages):
        G = F[:, :, k] - B[:, :, k] @ feedback[k]
        X = G @ X @ G.T + B[:, :, k] @ share[k] @ B[:, :, k].T
        variance[:, k] = X.diagonal()
    variance[fixed, -1] = 0.0
    is_held = variance.max(axis=1) < HELD * reached  # what is left is how soft the ends are
    variance = np.where(is_held[:, None], 0.0, np.maximum(variance, 0.0))
    variance[np.flatnonzero(loose)[unknown]] = np.inf
    return variance


def _at_start(V: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance of free components of q_0 and the undetermined entries.

    The covariance is the inverse of the Hessian of the cost to go in these components.
    """
    size = np.sqrt(np.maximum(V.diagonal(), 0.0))
    size = np.where(size > 0, 1.0 / np.where(size > 0, size, 1.0), 0.0)
    values, vectors = np.linalg.eigh(size[:, None] * V * size)
    reported = values > FLAT
    root = size[:, None] * vectors[:, reported] / np.sqrt(values[reported])
    return root @ root.T, (np.abs(vectors[:, ~reported]) > np.sqrt(FLAT)).any(axis=1)


def _reached(F: np.ndarray, B: np.ndarray) -> np.ndarray:
    """Return the diagonal (n,) of the terminal controllability Gramian (last stages)."""
    total, after = np.zeros(len(F)), np.eye(len(F))
    for k in range(F.shape[-1] - 1, -1, -1):
        total += ((after @ B[:, :, k]) ** 2).sum(axis=1)
        after = after @ F[:, :, k]
        if not (np.isfinite(after).all() and np.abs(np.linalg.eigvals(after)).max() < GROWTH):
            break
    return total


NEARLY = 0.05
"""Span relative to the excursion below which the ends of a state nearly coincide."""
WIDEST = 10.0
"""Largest scale of a state relative to its bound distance, a limit for maps that explode on the
line.
"""
MOST = 1e4
"""Largest scale of a control relative to its bound distance; control scales grow with the number of
stages.
"""
ROUNDS = 3
"""Number of alternating fits of controls and scales; the second round changes little."""


@such_as("ann_dc.problem.scales_of(problem)")
@dataclass(frozen=True, kw_only=True, eq=False)
class Scales:
    """Scales between network values and the user's values: one per state chain and per control.

    `cost` is the user's cost that a network objective of 1 represents.
    """

    states: tuple[Scale, ...]
    controls: tuple[Scale, ...]
    cost: float

    @classmethod
    def none(cls, problem: OptimalControlProblem) -> Scales:
        """Return identity scales for a problem: factors one, offsets zero."""
        return cls(states=(Scale(),) * problem.n, controls=(Scale(),) * problem.m, cost=1.0)

    @property
    def multipliers(self) -> tuple[Scale, ...]:
        """Scales of mu and beta of every chain: cost divided by state."""
        return tuple(Scale(self.cost / scale.factor) for scale in self.states)

    @property
    def state_factors(self) -> np.ndarray:
        """Scale factors of the states, (n,)."""
        return np.array([scale.factor for scale in self.states])

    @property
    def control_factors(self) -> np.ndarray:
        """Scale factors of the controls, (m,)."""
        return np.array([scale.factor for scale in self.controls])

    def replaced(self, problem: OptimalControlProblem) -> Scales:
        """Return these scales with the user-defined scales of a problem substituted."""
        given = problem.scales

        def chosen(name: str, own: Scale) -> Scale:
            value = given.get(name, own)
            return value if isinstance(value, Scale) else own._replace(factor=value)

        return Scales(
            states=tuple(chosen(str(s), own) for s, own in zip(problem.states, self.states)),
            controls=tuple(chosen(str(s), own) for s, own in zip(problem.controls, self.controls)),
            cost=chosen("cost", Scale(self.cost)).factor,
        )


@checked
def natural_scales(problem: OptimalControlProblem) -> Scales:
    """Return the scales derived from ends, map and cost, ignoring user-defined scales."""
    return straight_line(problem).scales


@checked
def scales_of(problem: OptimalControlProblem) -> Scales:
    """Return the scales of a problem: user-defined ones, otherwise natural ones.

    Examples
    --------
    Kilometres instead of metres:

    >>> from ann_dc.problem import plants
    >>> [s.factor for s in scales_of(plants.double_integrator(q_d=(1000, 0))).states]
    [1000.0, 2629.368...]
    """
    return natural_scales(problem).replaced(problem)


@dataclass(frozen=True, kw_only=True, eq=False)
class StraightLine:
    """Straight line between the ends (n, N+1) in the user's units, with controls and scales.

    The controls (m, N) are one Gauss-Newton step from those of least cost.
    """

    q: np.ndarray
    u: np.ndarray
    scales: Scales


@lru_cache(maxsize=64)
def straight_line(problem: OptimalControlProblem) -> StraightLine:
    """Return the straight line from q_0 to q_d; a free component has the value of its other end.

    Inputs that hold ineffective controls are set to zero.
    """
    with np.errstate(all="ignore"):
        problem = problem.with_inputs(**{HOLD.format(c): 0.0 for c in problem.held})
        first, last = problem.ends
        share = np.linspace(0.0, 1.0, problem.horizon + 1)
        return _Path(problem, first[:, None] + (last - first)[:, None] * share).fitted()


def fitting_controls(problem: OptimalControlProblem, q: np.ndarray) -> np.ndarray:
    """Return controls (m, N) that approximately follow a path q (n, N+1) in the user's units."""
    with np.errstate(all="ignore"):
        return _Path(problem, q).controls(natural_scales(problem).state_factors)


class _Path:
    """Path with an alternating fit of its controls and the state scales."""

    def __init__(self, problem: OptimalControlProblem, q: np.ndarray) -> None:
        self.problem, self.functions, self.q = problem, problem.functions, q
        self.fixed, carried = np.array(problem.fixed), problem.handed_on
        self.known = np.array([SCALE if s in carried else np.nan for s in problem.states])
        self.loose = ~np.array(problem.fixed_start) & np.isnan(self.known)
        self.span = np.abs(q[:, -1] - q[:, 0])
        self.cheapest = self._cheapest()
        self._look(self.cheapest)
        self.first_B, self.gap = self.B, self.q[:, 1:] - self.functions.map(self._from, self.u)
        self.price = self.control_curvature

    def fitted(self) -> StraightLine:
        """Return the line with alternately fitted controls and scales."""
        scale = np.where(self.span > 0, self.span, np.inf)
        self._look(self.controls(scale))
        for _ in range(ROUNDS):
            scale = self._straying(scale)
            self._look(self.controls(scale))
        widest = WIDEST * widths(self.problem.bounds, self.problem.states)
        scale = np.minimum(self._in_common(scale), widest)
        return StraightLine(q=self.q, u=self.u, scales=self._scales(scale))

    @property
    def _from(self) -> np.ndarray:
        return self.q[:, :-1]

    def _hessian(self, u: np.ndarray) -> np.ndarray:
        """Return the Hessian (n+m, n+m, N) of the cost along the line."""
        return self.functions.hessian(self._from, u, np.zeros_like(self.q[:, 1:]))

    def _cheapest(self) -> np.ndarray:
        """Return the controls (m, N) of least cost along the line, one Newton step from zero.

        They are moved into the domain.
        """
        n, u = self.problem.n, np.zeros((self.problem.m, self.problem.horizon))
        _, slope = self.functions.cost_gradient(self._from, u)
        for k, own in enumerate(np.moveaxis(self._hessian(u)[n:, n:], -1, 0)):
            if np.isfinite(own).all() and np.isfinite(slope[:, k]).all():
                size = np.sqrt(np.maximum(own.diagonal(), 0.0))
                size = np.where(size > 0, 1.0 / np.where(size > 0, size, 1.0), 0.0)
                inverse = np.linalg.pinv(size[:, None] * own * size, rcond=1e-9, hermitian=True)
                u[:, k] = -size * (inverse @ (size * slope[:, k]))
        return into_domain(self.problem, self._from, u)

    def _look(self, u: np.ndarray) -> None:
        """Compute slopes and curvatures along the line at given controls."""
        n = self.problem.n
        F, B = self.functions.map_jacobian(self._from, u)
        slope, push = self.functions.cost_gradient(self._from, u)
        _, end_slope, end = self.functions.terminal(self.q[:, -1])
        own = self._hessian(u).diagonal().T
        self.u, self.F, self.B, self.push = u, _finite(F), _finite(B), _finite(push)
        self.slope = _finite(np.column_stack([slope, end_slope]))
        self.curvature = np.maximum(_finite(np.column_stack([own[:n], end.diagonal()])), 0.0)
        self.control_curvature = np.maximum(_finite(own[n:]), 0.0).max(axis=-1)

    def _effect(self, scale: np.ndarray) -> np.ndarray:
        """Return the largest |S^-1 df/du| along the line, (m,)."""
        return np.sqrt(((self.B / scale[:, None, None]) ** 2).sum(axis=0)).max(axis=-1)

    def _control_cost(self, scale: np.ndarray) -> np.ndarray:
        """Return the curvature R (m,) of the cost in the controls.

        An unknown entry is that of controls with the same effect, or infinite. If no control has a
        cost, the curvature of the affected states is used.
        """
        R, effect = self.control_curvature, self._effect(scale) ** 2
        if not (R > 0).any():
            R = self._price_of_states()
        known = R > 0
        reported = known & (effect > 0)
        share = (
            np.median(R[reported] / effect[reported])
            if reported.any()
            else 0.0
            if known.any()
            else 1.0
        )
        guess = effect * share
        return np.where(known, R, np.where(guess > 0, guess, np.inf))

    def _price_of_states(self) -> np.ndarray:
        """Return the largest cost curvature (m,) of later states per control impulse."""
        W, price = np.diag(self.curvature[:, -1]), np.zeros(self.problem.m)
        for k in range(self.problem.horizon - 1, -1, -1):
            F, B = self.F[:, :, k], self.B[:, :, k]
            price = np.maximum(price, np.einsum("ij,ik,kj->j", B, W, B))
            W = np.diag(self.curvature[:, k]) + F.T @ W @ F
        return _finite(price)

    def controls(self, scale: np.ndarray) -> np.ndarray:
        """Return controls that take q_k to q_{k+1} after one least-squares step.

        States are measured in their scales, controls by their cost. Without a finite f, the
        controls are those of least cost.
        """
        if not np.isfinite(self.gap).all():
            return self.cheapest
        cheap = 1.0 / np.sqrt(self._control_cost(scale))
        weighted = np.moveaxis(self.first_B / scale[:, None, None] * cheap[:, None], -1, 0)
        inverse = np.linalg.pinv(weighted, rcond=1e-6)
        step = np.einsum("kij,jk->ik", inverse, self.gap / scale[:, None])
        return within_domain(self.problem, self._from, self.cheapest, cheap[:, None] * step)

    def _variance(self, scale: np.ndarray) -> np.ndarray:
        price = self._control_cost(scale)
        return bridge_variance(self.F, self.B, self.curvature, price, self.fixed, self.loose)

    def _straying(self, scale: np.ndarray) -> np.ndarray:
        """Return the excursion of each state from the line, (n,); infinite if not driven."""
        variance = self._variance(scale)
        strays = np.sqrt(variance.mean(axis=1))
        return np.where(np.isfinite(strays) & (strays > 0), strays, np.inf)

    def _in_common(self, scale: np.ndarray) -> np.ndarray:
        """Return the geometric means (n,) of state excursions and end distances.

        The mean tends to the excursion alone as the span tends to zero.
        """
        moved, span = np.isfinite(scale), self.span
        scale = scale * self._shared_factor(scale)
        apart = span / np.where(moved, scale, np.inf)
        near = 1.0 - (1.0 - np.sqrt(NEARLY)) * apart / NEARLY
        mean = scale * np.where(apart >= NEARLY, np.sqrt(apart), near)
        return self._of_given(np.where(moved, mean, np.where(span > 0, span, scale)))

    def _shared_factor(self, scale: np.ndarray) -> float:
        """Return the factor that makes the largest motion over its scale one.

        The motion is the span, or otherwise an estimate.
        """
        drift = np.abs(_finite(self.gap)).sum(axis=1)
        pulled = (self._variance(scale) * np.abs(self.slope[:, 1:])).max(axis=1)
        start = np.abs(self.q[:, 0])
        for motion in (self.span, drift, pulled, start):
            largest = float(_finite(motion / scale).max(initial=0.0))
            if largest > 0:
                return largest
        return 1.0

    def _of_given(self, scale: np.ndarray) -> np.ndarray:
        """Return scales in which undriven states are given by effect, drift or position."""
        coupled = np.sqrt((self.F**2).mean(axis=-1)) * self.problem.horizon
        moved, complete = np.isfinite(scale), np.where(np.isnan(self.known), scale, self.known)
        for i in map(int, np.flatnonzero(~moved & np.isnan(self.known))):
            onto = moved & (coupled[:, i] > 0)
            alone = float(np.abs(_finite(self.gap[i])).sum()) or float(abs(self.q[i, 0])) or 1.0
            complete[i] = (scale[onto] / coupled[onto, i]).min() if onto.any() else alone
        return complete

    def _scales(self, scale: np.ndarray) -> Scales:
        effect, price = self._effect(scale), np.sqrt(self._control_cost(scale))
        acts = effect > 0  # of a control that does nothing along the line only the price is known
        typical = np.median(price[acts] / effect[acts]) if acts.any() else 1.0
        by_price = np.where(np.isfinite(price), typical / price, 1.0)
        control = np.where(acts, 1.0 / np.where(acts, effect, 1.0), by_price)
        control = np.minimum(control, MOST * widths(self.problem.bounds, self.problem.controls))
        return Scales(
            states=tuple(map(Scale, scale.tolist(), self.problem.ends[0].tolist())),
            controls=tuple(
                Scale(float(factor), float(offset))
                for factor, offset in zip(control, self.cheapest.mean(axis=1))
            ),
            cost=self._cost(scale, control),
        )

    def _cost(self, scale: np.ndarray, control: np.ndarray) -> float:
        """Return the largest cost curvature in controls, or in states, or the slope."""
        for measure in (
            self.price * control**2,
            self.curvature.max(axis=-1) * scale**2,
            np.abs(self.slope).max(axis=-1) * scale,
            np.abs(self.push).max(axis=-1) * control,
        ):
            if measure.max() > 0:
                return float(measure.max())
        return 1.0


def _finite(values: np.ndarray) -> np.ndarray:
    return np.nan_to_num(values, nan=0.0, posinf=0.0, neginf=0.0)
