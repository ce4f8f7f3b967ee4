r"""Scales: the problem's own measure of every state, control and of the cost, near one.

The network computes with :math:`\hat q = (q - c) / S`, :math:`v = (u - u_0) / U` and
:math:`\hat E = E / E_0`. A state has one scale for its whole chain, from two things that the
declaration knows: how far its ends lie apart, and how far it strays in between where that costs
little, which is the variance of a Gaussian bridge along the straight line (`excursions`). Then U
makes the largest control effect :math:`|S^{-1} \partial f / \partial v|` one, and E_0 the largest
:math:`\partial^2 \hat E / \partial v^2`. Offsets are q_0 and the controls that cost least.

The scales are covariant: the same problem in other units has the same network.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ann_dc.problem.bounds import widths
from ann_dc.problem.declaration import HOLD, OptimalControlProblem
from ann_dc.problem.domain import into_domain, within_domain
from ann_dc.problem.excursions import bridge_variance
from ann_dc.scale import Scale
from ann_dc.validation.checked import checked
from ann_dc.validation.values import such_as

NEARLY = 0.05
"""Span over straying below which the ends of a state nearly meet."""
WIDEST = 10.0
"""Scale of a state over the distance of its bounds, at most, if the map explodes on the line."""
MOST = 1e4
"""The same for controls, whose scales grow with the number of stages."""
ROUNDS = 3
"""How often controls and scales are fitted to each other; the second round changes little."""


@such_as("ann_dc.problem.scales_of(problem)")
@dataclass(frozen=True, kw_only=True, eq=False)
class Scales:
    """How network values stand for the user's: of every state chain, every control, the cost.

    Attributes
    ----------
    states : tuple of n Scale
    controls : tuple of m Scale
    cost : float
        The user's cost that a network's objective of 1 stands for.

    Examples
    --------
    >>> from ann_dc.problem import plants, scales_of
    >>> [scale.factor for scale in scales_of(plants.double_integrator()).controls]
    [26.293...]
    """

    states: tuple[Scale, ...]
    controls: tuple[Scale, ...]
    cost: float

    @classmethod
    def none(cls, problem: OptimalControlProblem) -> Scales:
        """The user's own units of a problem: every factor is one, every offset zero."""
        return cls(states=(Scale(),) * problem.n, controls=(Scale(),) * problem.m, cost=1.0)

    @property
    def multipliers(self) -> tuple[Scale, ...]:
        """Of mu and beta of every chain: cost by state."""
        return tuple(Scale(self.cost / scale.factor) for scale in self.states)

    @property
    def state_factors(self) -> np.ndarray:
        """(n,)."""
        return np.array([scale.factor for scale in self.states])

    @property
    def control_factors(self) -> np.ndarray:
        """(m,)."""
        return np.array([scale.factor for scale in self.controls])

    def replaced(self, problem: OptimalControlProblem) -> Scales:
        """These scales with those that a problem sets by hand."""
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
    """The scales of a problem from its ends, its map and its cost, whatever it sets by hand.

    Parameters
    ----------
    problem : OptimalControlProblem
    """
    return straight_line(problem).scales


@checked
def scales_of(problem: OptimalControlProblem) -> Scales:
    """The scales in which a problem is wired: those that it sets by hand, or else natural ones.

    Parameters
    ----------
    problem : OptimalControlProblem

    Returns
    -------
    Scales

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
    """The straight line between the ends, what it takes to follow it, and its scales.

    Attributes
    ----------
    q : (n, N+1) array
        In the user's units.
    u : (m, N) array
        Controls that fit: one Gauss-Newton step from those that cost least.
    scales : Scales
    """

    q: np.ndarray
    u: np.ndarray
    scales: Scales


@lru_cache(maxsize=64)
def straight_line(problem: OptimalControlProblem) -> StraightLine:
    """Straight line from q_0 to q_d, free components at their other end; controls and scales.

    Parameters
    ----------
    problem : OptimalControlProblem
        Inputs that hold controls without effect do not count.
    """
    with np.errstate(all="ignore"):
        problem = problem.with_inputs(**{HOLD.format(c): 0.0 for c in problem.held})
        first, last = problem.ends
        share = np.linspace(0.0, 1.0, problem.horizon + 1)
        return _Path(problem, first[:, None] + (last - first)[:, None] * share).fitted()


def fitting_controls(problem: OptimalControlProblem, q: np.ndarray) -> np.ndarray:
    """Controls that follow a path as nearly as one Gauss-Newton step from the cheapest ones says.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end, in the user's units.

    Returns
    -------
    (m, N) array
    """
    with np.errstate(all="ignore"):
        return _Path(problem, q).controls(natural_scales(problem).state_factors)


class _Path:
    """A path while its controls and the scales of the states are fitted to each other."""

    def __init__(self, problem: OptimalControlProblem, q: np.ndarray) -> None:
        self.problem, self.functions, self.q = problem, problem.functions, q
        self.fixed, self.known = np.array(problem.fixed), problem.known_scales
        self.loose = ~np.array(problem.fixed_start) & np.isnan(self.known)
        self.span = np.abs(q[:, -1] - q[:, 0])
        self.cheapest = self._cheapest()
        self._look(self.cheapest)
        self.first_B, self.gap = self.B, self.q[:, 1:] - self.functions.map(self._from, self.u)
        self.price = self.control_curvature

    def fitted(self) -> StraightLine:
        """Controls that fit and scales, in turn."""
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
        """Of the cost along the line, (n+m, n+m, N)."""
        return self.functions.hessian(self._from, u, np.zeros_like(self.q[:, 1:]))

    def _cheapest(self) -> np.ndarray:
        """Controls (m, N) at which the cost along the line is least, from zero; in its domain."""
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
        """Slopes and curvatures along the line with other controls."""
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
        """(m,): largest |S^-1 df/du| along the line."""
        return np.sqrt(((self.B / scale[:, None, None]) ** 2).sum(axis=0)).max(axis=-1)

    def _control_cost(self, scale: np.ndarray) -> np.ndarray:
        """Return R (m,): curvature of the cost, or that of others with the same effect.

        Infinite if neither is known. Without any price, that of the states which are moved counts.
        """
        R, effect = self.control_curvature, self._effect(scale) ** 2
        if not (R > 0).any():
            R = self._price_of_states()
        known = R > 0
        told = known & (effect > 0)
        share = np.median(R[told] / effect[told]) if told.any() else 0.0 if known.any() else 1.0
        guess = effect * share
        return np.where(known, R, np.where(guess > 0, guess, np.inf))

    def _price_of_states(self) -> np.ndarray:
        """(m,): curvature that a push on each control meets in the states after it, at most."""
        W, price = np.diag(self.curvature[:, -1]), np.zeros(self.problem.m)
        for k in range(self.problem.horizon - 1, -1, -1):
            F, B = self.F[:, :, k], self.B[:, :, k]
            price = np.maximum(price, np.einsum("ij,ik,kj->j", B, W, B))
            W = np.diag(self.curvature[:, k]) + F.T @ W @ F
        return _finite(price)

    def controls(self, scale: np.ndarray) -> np.ndarray:
        """Return controls that take q_k to q_{k+1} as nearly as one least-squares step says.

        States are measured in their scales, controls by their cost. The cheapest, if f is infinite.
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
        """(n,): how far each state strays from the line; infinite where no control moves it."""
        variance = self._variance(scale)
        strays = np.sqrt(variance.mean(axis=1))
        return np.where(np.isfinite(strays) & (strays > 0), strays, np.inf)

    def _in_common(self, scale: np.ndarray) -> np.ndarray:
        """Return (n,) geometric means of how far states stray and how far their ends lie apart.

        Ends that nearly meet tell nothing: towards a span of zero straying alone counts.
        """
        moved, span = np.isfinite(scale), self.span
        scale = scale * self._shared_factor(scale)
        apart = span / np.where(moved, scale, np.inf)
        near = 1.0 - (1.0 - np.sqrt(NEARLY)) * apart / NEARLY
        mean = scale * np.where(apart >= NEARLY, np.sqrt(apart), near)
        return self._of_given(np.where(moved, mean, np.where(span > 0, span, scale)))

    def _shared_factor(self, scale: np.ndarray) -> float:
        """Return what makes the largest motion over its scale one: span, or else a guess."""
        drift = np.abs(_finite(self.gap)).sum(axis=1)
        pulled = (self._variance(scale) * np.abs(self.slope[:, 1:])).max(axis=1)
        start = np.abs(self.q[:, 0])
        for motion in (self.span, drift, pulled, start):
            largest = float(_finite(motion / scale).max(initial=0.0))
            if largest > 0:
                return largest
        return 1.0

    def _of_given(self, scale: np.ndarray) -> np.ndarray:
        """Measure a state that no control moves by its effect on others, its drift or its place."""
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
        """Largest curvature of the cost in the controls; or else in the states, or its slope."""
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
