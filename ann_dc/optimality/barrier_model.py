r"""Barrier problem at a point: values, derivatives, Newton and restoration steps.

The Newton step eliminates the multipliers z and all slacks at their stage, with the weight and the
shift

.. math::
    \omega = \left(d + \frac{e}{P - z} + \frac{s}{z}\right)^{-1}, \qquad
    h = g - d z + \frac{t}{z} - \frac{t}{P - z}, \qquad \Delta z = \omega (G \Delta x + h),

and thus requires one solve of the banded matrix of the certificate, with G' omega G in the Hessian.

References
----------
.. [1] A. Wächter, L. T. Biegler, On the implementation of an interior-point filter line-search
   algorithm for large-scale nonlinear programming, Mathematical Programming 106 (2006).
.. [2] C. V. Rao, S. J. Wright, J. B. Rawlings, Application of interior-point methods to model
   predictive control, J. Optimization Theory and Applications 99 (1998).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np

from ann_dc.optimality.barrier import Barrier, Point
from ann_dc.optimality.by_stages import Minimum, counted
from ann_dc.optimality.expansion import Expansion
from ann_dc.optimality.newton import banded_system, equilibrated, solved

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
        """Return the largest residual of the barrier problem, scaled as in [1]_, (5)."""
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
        on the null space of the constraints (``is_counted``; otherwise only along the step).
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
