r"""Barrier problems of a control problem: variables, constraints and scales.

The constraints g <= 0 (inequalities and control limits) have slacks s. A soft constraint has an
elastic variable e at its penalty weight P and w at its compliance d. The barrier problem of a
parameter t is

.. math::
    \min\; E(q, u) + \sum \left(P e + \frac{w^2}{2 d}\right) - t \sum (\ln s + \ln e), \qquad
    f(q_k, u_k) = q_{k+1}, \quad g(q_k, u_k) + s = w + e.

The multipliers z satisfy s z = t, e (P - z) = t and w = d z. Everything is in the problem's
`natural_scales`. An empty slot has g = -1, s = 1 and G = 0.

The Newton step eliminates the multipliers z and all slacks at their stage, with the weight and the
shift

.. math::
    \omega = \left(d + \frac{e}{P - z} + \frac{s}{z}\right)^{-1}, \qquad
    h = g - d z + \frac{t}{z} - \frac{t}{P - z}, \qquad \Delta z = \omega (G \Delta x + h),

and thus requires one solve of the banded matrix of the certificate, with G' omega G in the Hessian.
The references are those of `interior_point`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ann_dc.optimality.by_stages import Minimum, counted
from ann_dc.optimality.contact import Slots, rows_of
from ann_dc.optimality.expansion import Expansion, Frame
from ann_dc.optimality.newton import banded_system, equilibrated, solved
from ann_dc.problem.bounds import widths
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales

SMALLEST_SLACK = 0.1
"""Smallest initial slack of an inequality, in its scale."""
INSIDE = 0.05
"""Distance of the initial controls from their limits, relative to the range or to the scale."""
LARGEST_SLOPE = 10.0
"""Largest initial gradient of the cost, in its unit: cheap controls have tiny units of cost."""
LEAST_MOTION = 0.01
"""Smallest factor by which caution reduces the natural scales."""


class Caution(Enum):
    """Scales reduced to the initial motion of the controls, to avoid large steps."""

    NONE = "none"
    CONTROLS = "of controls"
    ALL = "of states and controls"


class Point(NamedTuple):
    """Variables of a barrier problem in scales, or a direction in these variables.

    q (N+1, n), u (N, m) and mu (N, n) are states, controls and multipliers of the dynamics; the
    other arrays are (N+1, R). s are positive slacks, w the violation of compliant constraints and e
    that at the penalty weight, positive, or zero for hard constraints. z are multipliers, positive
    and below the penalty weight.
    """

    q: np.ndarray
    u: np.ndarray
    s: np.ndarray
    w: np.ndarray
    e: np.ndarray
    mu: np.ndarray
    z: np.ndarray

    def moved(self, step: Point, primal: float, dual: float) -> Point:
        """Return the point after a step; ``dual`` scales z and ``primal`` the other parts."""
        lengths = (primal,) * 6 + (dual,)
        return Point(*(own + a * move for own, a, move in zip(self, lengths, step)))

    @property
    def stages(self) -> np.ndarray:
        """States and controls (N+1, n+m) of each stage; zero controls at the end."""
        return np.hstack([self.q, np.vstack([self.u, np.zeros((1, self.u.shape[1]))])])


@dataclass(frozen=True, kw_only=True, eq=False)
class Barrier:
    """Scales and constraints shared by all barrier problems of a problem.

    `units` (r,) limit the initial gradient entries of inequalities to one. `limits` are all finite
    control limits as constraints, with minus the signed limit as value.
    """

    problem: OptimalControlProblem
    frame: Frame
    units: np.ndarray
    limits: Slots

    @classmethod
    def of(
        cls, problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, caution: Caution
    ) -> Barrier:
        """Return the barrier problems for an initial guess q (n, N+1) and u (m, N)."""
        frame = _frame(problem, q, u, caution)
        barrier = cls(
            problem=problem,
            frame=frame,
            units=np.ones(max(len(problem.inequalities), len(problem.end_inequalities))),
            limits=_limits(frame.limits, problem.horizon, problem.n),
        )
        with np.errstate(all="ignore"):
            lengths = np.abs(barrier._inequalities(q, u).slope).max(axis=(0, 2))
        usable = np.isfinite(lengths) & (lengths > 0.0)
        units = np.divide(1.0, lengths, where=usable, out=np.ones(len(lengths)))
        return replace(barrier, units=units)

    def users(self, q: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states (n, N+1) and controls (m, N) in the user's units."""
        n = self.problem.n
        states = q * self.frame.state + self.frame.zero[:n]
        return states.T, (u * self.frame.control + self.frame.zero[n:]).T

    def rows(self, q: np.ndarray, u: np.ndarray) -> Slots:
        """Return all constraints at states (N+1, n) and controls (N, m) in scales."""
        limits = self.limits
        value = limits.value.copy()
        value[:-1] += (limits.slope[:-1, :, self.problem.n :] @ u[..., None])[..., 0]
        return self._inequalities(*self.users(q, u)).beside(limits._replace(value=value))

    def _inequalities(self, states: np.ndarray, controls: np.ndarray) -> Slots:
        """Return the inequalities in scales, at a point in the user's units."""
        r, r_end = len(self.problem.inequalities), len(self.problem.end_inequalities)
        none = np.zeros((r, controls.shape[1])), np.zeros(r_end)
        found = rows_of(self.problem, (states, controls), none, self.frame.factors, self.frame.cost)
        return found._replace(
            value=np.where(found.is_row, found.value * self.units, -1.0),
            slope=found.slope * self.units[:, None],
            compliance=found.compliance * self.units**2,
            price=found.price / self.units,
        )

    def start(self, q: np.ndarray, u: np.ndarray, mu: np.ndarray, t: float) -> Point:
        """Return the initial point for q (n, N+1), u (m, N), mu (n, N) in user units.

        Fixed ends are exact and controls lie inside their limits.
        """
        frame, n = self.frame, self.problem.n
        states = (q.T - frame.zero[:n]) / frame.state
        first, last = ((end - frame.zero[:n]) / frame.state for end in frame.ends)
        states[0] = np.where(frame.fixed_start, first, states[0])
        states[-1] = np.where(frame.fixed, last, states[-1])
        low, high = frame.limits.T
        gap = INSIDE * np.where(np.isfinite(high - low), high - low, 1.0)
        controls = np.clip((u.T - frame.zero[n:]) / frame.control, low + gap, high - gap)
        rows = self.rows(states, controls)
        s = np.maximum(-rows.value, np.where(rows.is_row, SMALLEST_SLACK, 1.0))
        limits = len(self.limits.price.T)
        if limits:  # exact: their residual stays zero
            s[:, -limits:] = -rows.value[:, -limits:]
        z = np.minimum(t / s, rows.price / 2)
        return Point(
            q=states,
            u=controls,
            s=s,
            w=rows.compliance * z,
            e=t / (rows.price - z),
            mu=mu.T * frame.state / frame.cost,
            z=z,
        )


def _frame(problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, caution: Caution) -> Frame:
    """Return natural scales, limited to half the distance of two bounds and reduced by caution.

    The unit of cost bounds the curvature of the controls and, by `LARGEST_SLOPE`, all gradients.
    """
    scales, n = natural_scales(problem), problem.n
    named = scales.states + scales.controls
    natural = np.array([own.factor for own in named])
    if caution is not Caution.NONE:
        offsets = np.array([own.offset for own in scales.controls])
        moved = np.abs((u - offsets[:, None]) / natural[n:, None]).max(initial=0.0)
        first = n if caution is Caution.CONTROLS else 0
        natural[first:] *= np.clip(np.nan_to_num(moved, nan=1.0), LEAST_MOTION, 1.0)
    both = (*problem.states, *problem.controls)
    factors = np.minimum(natural, widths(problem.bounds, both) / 2)
    named = tuple(own._replace(factor=float(f)) for own, f in zip(named, factors))
    with np.errstate(all="ignore"):
        reported = problem.functions.derivatives(q[:, :-1], u, np.zeros((n, u.shape[1])))
        end = np.abs(problem.functions.terminal(q[:, -1])[1] * factors[:n]).max()
        slope = max(end, np.abs(reported.gradient * factors[:, None]).max())
        bent = np.abs(np.einsum("iik->ik", reported.hessian)[n:]).max(axis=-1) * factors[n:] ** 2
    found = max(bent.max(), slope / LARGEST_SLOPE)
    cost = float(found) if np.isfinite(found) and found > 0.0 else scales.cost
    return Frame.in_scales(
        problem, replace(scales, states=named[:n], controls=named[n:], cost=cost)
    )


def _limits(limits: np.ndarray, stages: int, n: int) -> Slots:
    """Return a constraint for every finite limit (m, 2), at all stages."""
    controls, sides = np.nonzero(np.isfinite(limits))
    sign = np.where(sides == 0, -1.0, 1.0)
    slots = Slots.empty(stages + 1, len(controls), n + len(limits))
    slots.is_row[:-1] = True
    slots.value[:-1] = -sign * limits[controls, sides]
    slots.slope[:-1, np.arange(len(controls)), n + controls] = sign
    return slots


PROXIMITY = 0.1
"""Barrier parameter of a restoration step, relative to the squares of the slacks."""
SOFTENING = 1e-8
"""Diagonal of the multipliers for dependent constraints."""
ROUNDING = 1e-15
"""Pivot ratio at which an equilibrated matrix is singular."""
LARGEST_MOVE = 1e12
"""Step component above which a matrix counts as singular."""
LEAST_CURVATURE = 1e-8
"""Smallest curvature along a step, in scales."""
EPSILON = float(np.finfo(float).eps)
CENTRED = 1e10
"""Largest factor between a multiplier and t divided by its slack."""


class Model:
    """Barrier problem at a point: values, derivatives and steps."""

    def __init__(self, barrier: Barrier, point: Point) -> None:
        self.barrier, self.point = barrier, point
        problem, frame = barrier.problem, barrier.frame
        self._users = barrier.users(point.q, point.u)
        mu = (point.mu * frame.cost / frame.state).T
        self.plain = Expansion.without_rows(problem, *self._users, mu, frame=frame)
        self.rows = barrier.rows(point.q, point.u)
        self.gap = (self.plain.map - self._users[0][:, 1:]).T / frame.state
        self.miss = self.rows.value + point.s - point.w - point.e

    @property
    def is_finite(self) -> bool:
        """True if the cost, the dynamics and all constraints have finite values."""
        return bool(np.isfinite(self.cost + self.infeasibility))

    @cached_property
    def infeasibility(self) -> float:
        """Sum of the residuals of dynamics and constraints."""
        return float(np.abs(self.gap).sum() + np.abs(self.miss).sum())

    @cached_property
    def cost(self) -> float:
        """Cost including that of soft constraints."""
        rows, point = self.rows, self.point
        yielding = np.divide(point.w**2, 2 * rows.compliance, where=rows.compliance > 0,
                             out=np.zeros_like(point.w))  # fmt: skip
        excess = np.where(np.isfinite(rows.price), rows.price, 0.0) * point.e
        return float(self.plain.objective / self.barrier.frame.cost + (yielding + excess).sum())

    def value(self, t: float) -> float:
        """Return the barrier function."""
        priced = np.where(np.isfinite(self.rows.price), self.point.e, 1.0)
        return self.cost - t * float(np.log(self.point.s).sum() + np.log(priced).sum())

    def descent(self, step: Point, t: float) -> float:
        """Return the slope of the barrier function along a step."""
        point, rows, end = self.point, self.rows, self.plain.end_slope
        is_priced = np.isfinite(rows.price)
        price = np.where(is_priced, rows.price, 0.0)
        excess = price - np.divide(t, point.e, where=is_priced, out=np.zeros_like(point.e))
        own = (self.plain.slope * step.stages[:-1]).sum() + end @ step.q[-1]
        compliant = rows.compliance > 0
        pull = np.divide(point.w, rows.compliance, where=compliant, out=np.zeros_like(point.w))
        slacks = pull * step.w + excess * step.e - t * step.s / point.s
        return float(own + slacks.sum())

    @cached_property
    def hessian(self) -> tuple[np.ndarray, np.ndarray]:
        """Hessians of the Lagrangian: (N, n+m, n+m) of the stages, (n, n) of the end."""
        barrier, frame, n = self.barrier, self.barrier.frame, self.barrier.problem.n
        problem, (q, u) = barrier.problem, self._users
        stages, end = self.plain.hessian, self.plain.end_hessian
        pull = self.point.z[:, : len(barrier.units)] * barrier.units * frame.cost
        if r := len(problem.inequalities):
            bent = problem.functions.rows_hessian(q[:, :-1], u, pull[:-1, :r].T)
            stages = stages + bent.transpose(2, 0, 1) * frame.of_hessian
        if r := len(problem.end_inequalities):
            bent = problem.functions.end_rows_hessian(q[:, -1], pull[-1, :r])
            end = end + bent * frame.of_hessian[:n, :n]
        return stages, end

    def error(self, t: float) -> float:
        """Return the largest residual, scaled as in (5) of Wächter and Biegler."""
        point, rows, plain, n = self.point, self.rows, self.plain, len(self.plain.end_slope)
        pull = (point.z[:, None] @ rows.slope)[:, 0]
        stages = plain.own_slope() + pull[:-1]
        stages[1:, :n] -= point.mu[:-1]
        stages[0, :n][plain.fixed_start] = 0.0
        end = (plain.end_slope + pull[-1, :n] - point.mu[-1])[~plain.fixed]
        forces = np.concatenate([point.mu.ravel(), point.z[rows.is_row]])
        size = max(1.0, float(np.abs(forces).mean()) / 100)
        room = np.where(np.isfinite(rows.price), rows.price - point.z, 0.0)
        products = np.stack([point.s * point.z, np.where(room > 0, point.e * room, t)])[
            :, rows.is_row
        ]
        dual = [stages, end, products - t, (point.w - rows.compliance * point.z)]
        primal = [self.gap, self.miss]
        parts = [np.abs(x).max(initial=0.0) / size for x in dual]
        return float(np.max(parts + [np.abs(x).max(initial=0.0) for x in primal]))

    def step(self, t: float, shift: float, *, is_counted: bool = True) -> Point | None:
        """Return the Newton step with a multiple of the identity added to the Hessian.

        Returns None if the step is not finite, or if the shifted Hessian is not positive definite
        on the null space of the constraints (``is_counted``; otherwise along the step).
        """
        point, rows, (stages, end) = self.point, self.rows, self.hessian
        n, z = len(end), stages.shape[1]
        room = np.maximum(rows.price - point.z, EPSILON * rows.price)
        weight = 1.0 / (rows.compliance + point.e / room + point.s / point.z)
        away = rows.value - rows.compliance * point.z + t / point.z - t / room
        G = rows.slope
        bent = (G * weight[..., None]).swapaxes(1, 2) @ G
        pull = ((point.z + weight * away)[:, None] @ G)[:, 0]
        bent[:, np.arange(z), np.arange(z)] += shift
        shifted = replace(
            self.plain,
            hessian=stages + bent[:-1],
            slope=self.plain.slope + pull[:-1],
            end_hessian=end + bent[-1, :n, :n],
            end_slope=self.plain.end_slope + pull[-1, :n],
        )
        none = np.zeros((len(G), 0, z))
        if is_counted and counted(shifted, none) not in (Minimum.STRICT, Minimum.FLAT):
            return None
        moves = _moves(shifted, self.gap)
        if moves is None:
            return None
        dq, du, dmu = moves
        none = np.zeros_like(point.s)
        step = Point(dq, du, none, none, none, dmu, none)
        if not (is_counted or _bends_up(shifted, step)):
            return None
        dz = weight * ((G @ step.stages[..., None])[..., 0] + away)
        return step._replace(
            z=dz,
            s=t / point.z - point.s - point.s / point.z * dz,
            w=rows.compliance * (point.z + dz) - point.w,
            e=t / room - point.e + point.e / room * dz,
        )

    def approach(self) -> Point | None:
        """Return the smallest step that satisfies the linearised constraints."""
        point, rows, plain = self.point, self.rows, self.plain
        n, z, G = len(plain.end_slope), plain.slope.shape[1], rows.slope
        weight = PROXIMITY / point.s**2
        bent = (G * weight[..., None]).swapaxes(1, 2) @ G + np.eye(z)
        pull = ((weight * self.miss)[:, None] @ G)[:, 0]
        near = replace(
            plain,
            hessian=bent[:-1],
            slope=pull[:-1],
            end_hessian=bent[-1, :n, :n],
            end_slope=pull[-1, :n],
            mu=np.zeros_like(plain.mu),
        )
        moves = _moves(near, self.gap)
        if moves is None:
            return None
        dq, du, dmu = moves
        none = np.zeros_like(point.s)
        step = Point(dq, du, none, none, none, np.zeros_like(dmu), none)
        return step._replace(s=-self.miss - (G @ step.stages[..., None])[..., 0])

    def longest(self, step: Point, share: float) -> tuple[float, float]:
        """Return the longest primal and dual step up to one, limited by the boundary.

        A step covers at most the fraction ``share`` of the distance to the boundary.
        """
        point, rows = self.point, self.rows
        priced = np.isfinite(rows.price)
        primal = _until(point.s, step.s, share), _until(point.e[priced], step.e[priced], share)
        room = (rows.price - point.z)[priced]
        dual = _until(point.z, step.z, share), _until(room, -step.z[priced], share)
        return min(primal), min(dual)

    def centred(self, point: Point, t: float) -> Point:
        """Return the point with multipliers limited to t / s times or over `CENTRED`."""
        due = t / point.s
        z = np.clip(point.z, due / CENTRED, due * CENTRED)
        return point._replace(z=np.minimum(z, 0.5 * (point.z + self.rows.price)))


def _bends_up(expansion: Expansion, step: Point) -> bool:
    """Return True if the Hessian is positive along a step."""
    z, last = step.stages[:-1], step.q[-1]
    bent = np.einsum("ki,kij,kj", z, expansion.hessian, z) + last @ expansion.end_hessian @ last
    return bool(bent > LEAST_CURVATURE * float((z**2).sum() + last @ last))


def _until(value: np.ndarray, move: np.ndarray, share: float) -> float:
    """Return the longest step up to one that covers a fraction of the way to zero."""
    falling = move < 0.0
    return float(np.min(-share * value[falling] / move[falling], initial=1.0))


def _moves(expansion: Expansion, gap: np.ndarray):
    """Solve the linear-quadratic problem for steps of q, u and mu; None if singular."""
    n, z = len(expansion.end_slope), expansion.slope.shape[1]
    for softening in (0.0, SOFTENING):
        band, right, is_there = banded_system(expansion, gap)
        if softening:
            width = band.shape[1] // 3
            rows = np.zeros(right.shape, bool)
            rows[:-1, z:] = True
            band[rows.ravel() & is_there.ravel(), 2 * width] -= softening
        scaled, factors = equilibrated(band)
        factors = factors.reshape(right.shape)
        moves = factors * solved(scaled, factors * right, is_there, ROUNDING)
        if np.isfinite(moves).all() and np.abs(moves).max() < LARGEST_MOVE:
            return moves[:, :n], moves[:-1, n:z], moves[:-1, z:]
    return None
