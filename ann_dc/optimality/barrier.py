r"""Barrier problems of a control problem: variables, constraints and scales.

The constraints g <= 0 (inequalities and control limits) have slacks s. A soft constraint has an
elastic variable e at its penalty weight P and w at its compliance d. The barrier problem of a
parameter t is

.. math::
    \min\; E(q, u) + \sum \left(P e + \frac{w^2}{2 d}\right) - t \sum (\ln s + \ln e), \qquad
    f(q_k, u_k) = q_{k+1}, \quad g(q_k, u_k) + s = w + e.

The multipliers z satisfy s z = t, e (P - z) = t and w = d z. Everything is in the problem's
`natural_scales`. An empty slot has g = -1, s = 1 and G = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from ann_dc.optimality.contact import Slots, rows_of
from ann_dc.optimality.expansion import Frame
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
    """Variables of a barrier problem in scales, or a direction in these variables."""

    q: np.ndarray
    """States, (N+1, n)."""
    u: np.ndarray
    """Controls, (N, m)."""
    s: np.ndarray
    """Positive slacks of the constraints, (N+1, R)."""
    w: np.ndarray
    """Violation of compliant constraints, (N+1, R)."""
    e: np.ndarray
    """Violation at the penalty weight, (N+1, R); positive, or zero for hard constraints."""
    mu: np.ndarray
    """Multipliers of the dynamics, (N, n)."""
    z: np.ndarray
    """Multipliers of the constraints, (N+1, R); positive and below the penalty weight."""

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

    `units` (r,) are factors on the inequalities that limit their initial gradient entries to one.
    `limits` are the constraints of all finite control limits, with minus the signed limit as value.
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
    """Return natural scales, limited to half the distance of two bounds.

    With caution, they are reduced to the initial motion of the controls. The unit of cost bounds
    the curvature of the controls and, by `LARGEST_SLOPE`, all gradients.
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
        told = problem.functions.derivatives(q[:, :-1], u, np.zeros((n, u.shape[1])))
        end = np.abs(problem.functions.terminal(q[:, -1])[1] * factors[:n]).max()
        slope = max(end, np.abs(told.gradient * factors[:, None]).max())
        bent = np.abs(np.einsum("iik->ik", told.hessian)[n:]).max(axis=-1) * factors[n:] ** 2
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
