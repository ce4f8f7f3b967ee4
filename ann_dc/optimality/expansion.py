r"""Second-order expansion of a problem around a point, in its natural scales.

With states, controls and cost in `natural_scales`, a stage is

.. math::
    \delta q_{k+1} = F_k \delta q_k + B_k \delta u_k, \qquad
    \tfrac12 \delta z_k^T W_k \delta z_k + g_k^T \delta z_k, \qquad z_k = (q_k, u_k),

where g is the gradient of the cost and W the Hessian of l + mu' f. One evaluation of the exact
derivatives gives all terms. With inequalities, W includes the curvature of the active constraints
whose multipliers have the right sign, and `contact` contains their gradients. A soft constraint at
its penalty weight P is part of the cost, P g.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ann_dc.optimality.contact import Contact, Slots, limits_of, rows_of, sizes_of
from ann_dc.optimality.soft_constraints import AT_PRICE, penalty
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import Scales, natural_scales

SMALLEST = 1e-4
"""Smallest reference gradient of residuals, in its scale: all gradients vanish once a controller
has arrived. The largest curvature along a control is one, so that a residual of 1e-8 of it moves
the control by 1e-12 of its scale.
"""

BEYOND = 1e-6
"""Distance relative to the range beyond which a constraint at its penalty weight is a cost."""


class Frame(NamedTuple):
    """Scales and boundary conditions shared by all expansions of a problem.

    `fixed_start` and `fixed` (n,) are True for components that q_0 and q_d fix; a free component of
    `ends` has its value at the other end. `state` (n,), `control` (m,) and `factors` (n+m,) are
    scale factors, `zero` (n+m,) offsets and `cost` the unit of the cost. The factors of a Jacobian
    of the dynamics are (n, n+m), of a Hessian (n+m, n+m) and of a gradient of the cost (n+m,).
    `limits` (m, 2) are scaled. `is_bounded` is True if there are inequalities or control limits.
    """

    fixed_start: np.ndarray
    fixed: np.ndarray
    ends: tuple[np.ndarray, np.ndarray]
    state: np.ndarray
    control: np.ndarray
    zero: np.ndarray
    cost: float
    of_jacobian: np.ndarray
    of_hessian: np.ndarray
    of_slope: np.ndarray
    factors: np.ndarray
    limits: np.ndarray
    is_bounded: bool

    @classmethod
    @lru_cache(maxsize=64)
    def of(cls, problem: OptimalControlProblem) -> Frame:
        """Return the frame in the natural scales of a problem."""
        return cls.in_scales(problem, natural_scales(problem))

    @classmethod
    def in_scales(cls, problem: OptimalControlProblem, scales: Scales) -> Frame:
        """Return the frame in given scales."""
        factors, offsets = np.array(scales.states + scales.controls).T
        state = factors[: problem.n]
        limits, rows = problem.control_limits, (problem.inequalities, problem.end_inequalities)
        return cls(
            fixed_start=np.array(problem.fixed_start),
            fixed=np.array(problem.fixed),
            ends=problem.ends,
            state=state,
            control=factors[problem.n :],
            zero=offsets,
            cost=scales.cost,
            of_jacobian=factors / state[:, None],
            of_hessian=factors[:, None] * factors / scales.cost,
            of_slope=factors / scales.cost,
            factors=factors,
            limits=(limits - offsets[problem.n :, None]) / factors[problem.n :, None],
            is_bounded=any(rows) or bool(np.isfinite(limits).any()),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Expansion:
    """Linear-quadratic problem around a point; stages are the first axis.

    `ends`, `map` (n, N) and `objective` (with the cost of soft constraints) are in the user's
    units, and `state` (n,) and `cost` are the value of one scaled unit; the rest is scaled. `q`
    (N+1, n) includes the end, `u` is (N, m) and `mu` (N, n). `jacobian` (N, n, n+m) is (F_k, B_k),
    `hessian` (N, n+m, n+m) is W_k and `slope` (N, n+m) is g_k. `contact` is None without
    inequalities and limits.
    """

    fixed_start: np.ndarray
    fixed: np.ndarray
    ends: tuple[np.ndarray, np.ndarray]
    state: np.ndarray
    cost: float
    q: np.ndarray
    u: np.ndarray
    jacobian: np.ndarray
    hessian: np.ndarray
    slope: np.ndarray
    end_hessian: np.ndarray
    end_slope: np.ndarray
    mu: np.ndarray
    map: np.ndarray
    objective: float
    contact: Contact | None = None

    @classmethod
    def at(
        cls,
        problem: OptimalControlProblem,
        q: np.ndarray,
        u: np.ndarray,
        mu: np.ndarray,
        zeta: np.ndarray | None = None,
        zeta_end: np.ndarray | None = None,
        shares: np.ndarray | None = None,
    ) -> Expansion:
        """Expand a problem at q (n, N+1), u (m, N) and mu (n, N) in the user's units.

        The multipliers `zeta` (r, N) and `zeta_end` (r_e,) are zero by default; the weights
        `shares` (p,) of the objectives are equal by default.
        """
        plain = cls.without_rows(problem, q, u, mu, shares)
        if not Frame.of(problem).is_bounded:
            return plain
        r, r_end = len(problem.inequalities), len(problem.end_inequalities)
        of_rows = np.zeros((r, u.shape[1])) if zeta is None else zeta
        of_end = np.zeros(r_end) if zeta_end is None else zeta_end
        with np.errstate(all="ignore"):
            plain = replace(plain, objective=plain.objective + penalty(problem, q, u))
            return plain._in_contact(problem, (q, u), (of_rows, of_end))

    @classmethod
    def without_rows(
        cls,
        problem: OptimalControlProblem,
        q: np.ndarray,
        u: np.ndarray,
        mu: np.ndarray,
        shares: np.ndarray | None = None,
        frame: Frame | None = None,
    ) -> Expansion:
        """Expand a problem without inequalities and control limits; arguments as in `at`."""
        frame, n = frame or Frame.of(problem), len(q)
        of_state = frame.of_slope[:n]
        with np.errstate(all="ignore"):
            reported = problem.functions_with(shares).derivatives(q[:, :-1], u, mu)
            end, end_slope, end_hessian = problem.functions.terminal(q[:, -1])
            return cls(
                fixed_start=frame.fixed_start,
                fixed=frame.fixed,
                ends=frame.ends,
                state=frame.state,
                cost=frame.cost,
                q=(q.T - frame.zero[:n]) / frame.state,
                u=(u.T - frame.zero[n:]) / frame.control,
                jacobian=_by_stage(reported.jacobian, frame.of_jacobian),
                hessian=_by_stage(reported.hessian, frame.of_hessian),
                slope=reported.gradient.T * frame.of_slope,
                end_hessian=end_hessian * frame.of_hessian[:n, :n],
                end_slope=end_slope * of_state,
                mu=mu.T * of_state,
                map=reported.map,
                objective=float(reported.cost.sum() + end),
            )

    def _in_contact(
        self,
        problem: OptimalControlProblem,
        point: tuple[np.ndarray, np.ndarray],
        zetas: tuple[np.ndarray, np.ndarray],
    ) -> Expansion:
        """Add the inequalities with multipliers (r, N) and (r_e,), and the control limits."""
        frame, (q, u), (zeta, zeta_end), n = Frame.of(problem), point, zetas, problem.n
        sizes = sizes_of(self.q, self.u, frame.limits)
        is_free = np.ones((len(self.q), len(sizes)), bool)
        is_free[0, :n], is_free[-1, :n] = ~self.fixed_start, ~self.fixed
        rows = rows_of(problem, point, zetas, frame.factors, frame.cost)
        rows, priced, near = _priced(rows, sizes, is_free)
        limits = limits_of(
            self.u, frame.limits, self.own_slope() + (rows.pull() + priced.pull())[:-1], sizes
        )
        fixed = priced.zeta * frame.cost
        bent = np.where(near[:-1, : len(zeta)].T, np.maximum(zeta, 0.0), fixed[:-1, : len(zeta)].T)
        at_end = fixed[-1, : len(zeta_end)]
        bent_end = np.where(near[-1, : len(zeta_end)], np.maximum(zeta_end, 0.0), at_end)
        of_stages = problem.functions.rows_hessian(q[:, :-1], u, bent)
        of_end = problem.functions.end_rows_hessian(q[:, -1], bent_end)
        return replace(
            self,
            slope=self.slope + priced.pull()[:-1],
            end_slope=self.end_slope + priced.pull()[-1, :n],
            hessian=self.hessian + _by_stage(of_stages, frame.of_hessian),
            end_hessian=self.end_hessian + of_end * frame.of_hessian[:n, :n],
            contact=Contact.of(rows.beside(limits), sizes, is_free),
        )

    def own_slope(self) -> np.ndarray:
        """Return dl/dz + (df/dz)' mu + (dg/dz)' zeta (N, n+m) of the terms of each stage."""
        own = self.slope + (self.mu[:, None] @ self.jacobian)[:, 0]
        return own if self.contact is None else own + self.contact.pull()[:-1]

    def own_end_slope(self) -> np.ndarray:
        """Return the corresponding gradient (n,) of the terminal terms."""
        own = self.end_slope
        return own if self.contact is None else own + self.contact.pull()[-1, : len(own)]

    def largest_slope(self) -> float:
        """Return the largest free gradient of the cost or multiplier, at least `SMALLEST`."""
        slope = self.slope.copy()
        slope[0, : len(self.fixed)][self.fixed_start] = 0.0
        parts = [slope, self.end_slope[~self.fixed], self.mu]
        if self.contact is not None:
            parts.append(self.contact.multiplier[..., None] * self.contact.slope)
        return float(np.max([np.abs(part).max(initial=SMALLEST) for part in parts]))

    def largest_curvature(self) -> float:
        """Return the largest curvature of the free variables; one if there is none."""
        first, end = np.abs(self.hessian[0]), np.abs(self.end_hessian)
        n, held, kept = len(end), self.fixed_start, self.fixed
        first[:n][held] = first[:, :n][:, held] = 0.0
        end[kept] = end[:, kept] = 0.0
        return max(first.max(), np.abs(self.hessian[1:]).max(initial=0.0), end.max()) or 1.0

    def condensed(self) -> Expansion:
        """Return the expansion with compliant active constraints as curvature, G' G / d."""
        contact = self.contact
        if contact is None or not contact.compliance.any():
            return self
        gives = contact.strong(self.largest_slope()) & (contact.compliance > 0)
        softness = np.where(gives, contact.compliance, np.inf)
        G, n = contact.slope, len(self.end_slope)
        bent = np.einsum("kri,kr,krj->kij", G, 1.0 / softness, G)
        return replace(
            self,
            hessian=self.hessian + bent[:-1],
            end_hessian=self.end_hessian + bent[-1, :n, :n],
            contact=contact.only(~gives),
        )

    def active_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Return gradients (N+1, R, n+m) of strongly active and of all active constraints."""
        contact = self.contact
        if contact is None:
            none = np.zeros((len(self.q), 0, self.slope.shape[1]))
            return none, none
        strong = contact.strong(self.largest_slope())
        return contact.only(strong).slope, contact.only(contact.near).slope


def _priced(rows: Slots, sizes: np.ndarray, is_free: np.ndarray) -> tuple[Slots, Slots, np.ndarray]:
    """Split constraints into those to satisfy and those at their penalty weight.

    The last result marks the active ones. A soft constraint on fixed end components is in neither
    group: its cost is a constant.
    """
    contact = Contact.of(rows, sizes, is_free)
    if np.isinf(rows.price).all() and not rows.compliance.any():
        return rows, rows.without(rows.is_row), contact.near
    soft = rows.is_row & (np.isfinite(rows.price) | (rows.compliance > 0))
    constant = soft & ~contact.slope.any(axis=-1)
    with np.errstate(invalid="ignore"):
        full = np.abs(rows.zeta - rows.price) <= AT_PRICE * rows.price
    full &= np.isfinite(rows.price)
    beyond = soft & ~constant & full & (contact.distance > BEYOND)
    priced = rows.without(~beyond)
    priced = priced._replace(zeta=np.where(beyond, rows.price, 0.0))
    return rows.without(beyond | constant), priced, contact.near & ~beyond & ~constant


def _by_stage(values: np.ndarray, factors: np.ndarray) -> np.ndarray:
    """Return (n, m, N) values times (n, m) factors, stages first."""
    return np.multiply(values.transpose(2, 0, 1), factors, order="C")
