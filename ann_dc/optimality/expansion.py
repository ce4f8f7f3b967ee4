r"""A problem around a point, to second order and in its own scales: what a certificate looks at.

With every state, control and the cost in `natural_scales`, a stage is

.. math::
    \delta q_{k+1} = F_k \delta q_k + B_k \delta u_k, \qquad
    \tfrac12 \delta z_k^T W_k \delta z_k + g_k^T \delta z_k, \qquad z_k = (q_k, u_k),

with g the slope of the cost and W the Hessian of l + mu' f. All of it comes from one evaluation of
the problem's own derivatives. Where the problem has inequalities, W has the curvature of those rows
too that touch and pull the right way, and `contact` their slopes. A soft row at its price P is a
part of the cost, P g.
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
"""Slope, in its scale, to which residuals of slopes are related at least: all slopes vanish at the
optimum of a controller that has arrived. The largest curvature along a control is one, so that a
residual of 1e-8 of it moves that control by 1e-12 of its scale."""

BEYOND = 1e-6
"""Distance, over the range of what it reads, from which on a row at its price is a cost."""


class Frame(NamedTuple):
    """Scales and ends that every expansion of a problem has in common."""

    fixed_start: np.ndarray
    """(n,) bool: components that q_0 fixes."""
    fixed: np.ndarray
    """(n,) bool: components that q_d fixes."""
    ends: tuple[np.ndarray, np.ndarray]
    """q_0 and q_d, a free component at its other end."""
    state: np.ndarray
    """(n,): factors of states."""
    control: np.ndarray
    """(m,): factors of controls."""
    zero: np.ndarray
    """(n+m,): offsets of states and controls."""
    cost: float
    """Unit of the cost."""
    of_jacobian: np.ndarray
    """(n, n+m): factors on the map's Jacobian."""
    of_hessian: np.ndarray
    """(n+m, n+m): factors on a Hessian of the cost."""
    of_slope: np.ndarray
    """(n+m,): factors on a slope of the cost."""
    factors: np.ndarray
    """(n+m,): of states and controls."""
    limits: np.ndarray
    """(m, 2): limits of controls, in scales."""
    is_bounded: bool
    """True if the problem has inequalities or control limits."""

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
    """The linear-quadratic problem around a point; stages are the first axis.

    Attributes
    ----------
    fixed_start, fixed : (n,) arrays of bool
        Which components q_0 and q_d fix.
    ends : two (n,) arrays
        q_0 and q_d in the user's units, a free component at its other end.
    state, cost : (n,) array and float
        One in these scales, in the user's units.
    q : (N+1, n) array
        States with the end.
    u : (N, m) array
    jacobian : (N, n, n+m) array
        (F_k, B_k).
    hessian : (N, n+m, n+m) array
        W_k.
    slope : (N, n+m) array
        g_k.
    end_hessian, end_slope : (n, n) and (n,) arrays
        Of the terminal cost.
    mu : (N, n) array
        Multipliers of the map.
    map : (n, N) array
        f(q_k, u_k), in the user's units.
    objective : float
        E, in the user's units, with what soft rows cost.
    contact : Contact or None
        Inequalities and control limits; None where the problem has none.
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
        """The expansion of a problem.

        Parameters
        ----------
        problem : OptimalControlProblem
        q : (n, N+1) array
            States with the end, in the user's units.
        u : (m, N) array
        mu : (n, N) array
        zeta : (r, N) array, optional
            Multipliers of the inequalities; zero where they are not given.
        zeta_end : (r_e,) array, optional
            Of those of the end.
        shares : (p,) array, optional
            Of objectives; equal ones where they are not given.
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
        """Expand a problem without its inequalities and control limits; arguments as in `at`."""
        frame, n = frame or Frame.of(problem), len(q)
        of_state = frame.of_slope[:n]
        with np.errstate(all="ignore"):
            told = problem.functions_with(shares).derivatives(q[:, :-1], u, mu)
            end, end_slope, end_hessian = problem.functions.terminal(q[:, -1])
            return cls(
                fixed_start=frame.fixed_start,
                fixed=frame.fixed,
                ends=frame.ends,
                state=frame.state,
                cost=frame.cost,
                q=(q.T - frame.zero[:n]) / frame.state,
                u=(u.T - frame.zero[n:]) / frame.control,
                jacobian=_by_stage(told.jacobian, frame.of_jacobian),
                hessian=_by_stage(told.hessian, frame.of_hessian),
                slope=told.gradient.T * frame.of_slope,
                end_hessian=end_hessian * frame.of_hessian[:n, :n],
                end_slope=end_slope * of_state,
                mu=mu.T * of_state,
                map=told.map,
                objective=float(told.cost.sum() + end),
            )

    def _in_contact(
        self,
        problem: OptimalControlProblem,
        point: tuple[np.ndarray, np.ndarray],
        zetas: tuple[np.ndarray, np.ndarray],
    ) -> Expansion:
        """With the inequalities, of multipliers (r, N) and (r_e,), and the control limits."""
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
        """(N, n+m) array: dl/dz + (df/dz)' mu + (dg/dz)' zeta, of every stage's own terms."""
        own = self.slope + (self.mu[:, None] @ self.jacobian)[:, 0]
        return own if self.contact is None else own + self.contact.pull()[:-1]

    def own_end_slope(self) -> np.ndarray:
        """(n,) array: the same of the end's own terms."""
        own = self.end_slope
        return own if self.contact is None else own + self.contact.pull()[-1, : len(own)]

    def largest_slope(self) -> float:
        """Return the largest free slope of the cost or multiplier, at least `SMALLEST`."""
        slope = self.slope.copy()
        slope[0, : len(self.fixed)][self.fixed_start] = 0.0
        parts = [slope, self.end_slope[~self.fixed], self.mu]
        if self.contact is not None:
            parts.append(self.contact.multiplier[..., None] * self.contact.slope)
        return float(np.max([np.abs(part).max(initial=SMALLEST) for part in parts]))

    def largest_curvature(self) -> float:
        """The largest curvature of anything that is not fixed; one where there is none."""
        first, end = np.abs(self.hessian[0]), np.abs(self.end_hessian)
        n, held, kept = len(end), self.fixed_start, self.fixed
        first[:n][held] = first[:, :n][:, held] = 0.0
        end[kept] = end[:, kept] = 0.0
        return max(first.max(), np.abs(self.hessian[1:]).max(initial=0.0), end.max()) or 1.0

    def condensed(self) -> Expansion:
        """The same, with strongly active rows that are compliant as a curvature, G' G / d."""
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
        """(N+1, R, n+m) slopes of the strongly active rows, and of all that touch; others zero."""
        contact = self.contact
        if contact is None:
            none = np.zeros((len(self.q), 0, self.slope.shape[1]))
            return none, none
        strong = contact.strong(self.largest_slope())
        return contact.only(strong).slope, contact.only(contact.near).slope


def _priced(rows: Slots, sizes: np.ndarray, is_free: np.ndarray) -> tuple[Slots, Slots, np.ndarray]:
    """The rows that hold or are to hold, those that cost their price, and which rows touch.

    A soft row that reads only what an end fixes is neither: its cost is a constant.
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
    """(n, m, N) values times factors (n, m), the stages first."""
    return np.multiply(values.transpose(2, 0, 1), factors, order="C")
