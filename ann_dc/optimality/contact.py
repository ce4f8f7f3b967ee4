r"""Inequalities around a point: rows and control limits, in the problem's scales, and which touch.

A row g(q, u) <= 0 is divided by the length of its slope in scaled variables: its value is then a
distance and its multiplier a slope of the cost, and neither depends on how the row was written. The
distance is related to the range of what the row reads. A limit of a control is a row too; its
multiplier is what the cost gains by a move outward.

A soft row rests where g = d zeta, below its price: its value is that of g - d zeta. Where it is at
its price it is no row any more but a cost, P g (`expansion`).

A row touches where its distance is zero, to `NEAR`. It is strongly active where its multiplier is
clearly positive, and weakly otherwise: it touches by chance, or is about to let go.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem

NEAR = 1e-5
"""Distance, over the range of what a row reads, at which the row touches."""
CLEAR = 1e-5
"""Multiplier of a strongly active row, over the largest slope or multiplier, at least."""
CLEARER = 10.0
"""The same over the row's distance, so that what a solver leaves of both is not taken for one."""
SMALLEST_STATE = 0.1
"""Range of a state, in its scale, at least."""
SMALLEST_CONTROL = 1e-6
"""Range of a control, in its scale, at least: what moves a long chain is small at every stage."""


class Slots(NamedTuple):
    """Rows in scaled variables, as many slots at every stage; the last stage is q_N."""

    is_row: np.ndarray
    """(N+1, R) of bool: which slots hold a row."""
    value: np.ndarray
    """(N+1, R): g, negative where there is no row."""
    slope: np.ndarray
    """(N+1, R, n+m): of g."""
    zeta: np.ndarray
    """(N+1, R): multipliers over the cost's scale."""
    compliance: np.ndarray
    """(N+1, R): of soft rows; zero elsewhere."""
    price: np.ndarray
    """(N+1, R): over the cost's scale; infinite where a row has to hold."""

    @classmethod
    def empty(cls, stages: int, slots: int, z: int) -> Slots:
        """Slots that hold no row."""
        size = stages, slots
        return cls(
            is_row=np.zeros(size, bool),
            value=np.full(size, -1.0),
            slope=np.zeros((*size, z)),
            zeta=np.zeros(size),
            compliance=np.zeros(size),
            price=np.full(size, np.inf),
        )

    def beside(self, other: Slots) -> Slots:
        """These rows and others of the same stages."""
        return Slots(*(np.concatenate(pair, axis=1) for pair in zip(self, other)))

    def pull(self) -> np.ndarray:
        """(N+1, n+m): what the rows add to the slope of the Lagrangian."""
        return (self.zeta[:, None] @ self.slope)[:, 0]

    def without(self, gone: np.ndarray) -> Slots:
        """Without some rows: ``gone`` is an (N+1, R) array of bool."""
        if not gone.any():
            return self
        stages, slots, z = self.slope.shape
        none = Slots.empty(stages, slots, z)
        return Slots(
            *(
                np.where(gone[..., None] if own.ndim == 3 else gone, empty, own)
                for own, empty in zip(self, none)
            )
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Contact:
    """Rows by slots, with slopes of unit length.

    Attributes
    ----------
    is_row : (N+1, R) array of bool
        Which slots hold a row.
    value : (N+1, R) array
        g over the length of its slope.
    distance : (N+1, R) array
        The same over the range of what it reads: positive where the row is violated, infinite where
        it has no slope and is not zero.
    slope : (N+1, R, n+m) array
        Of unit length in (q_k, u_k), without what an end fixes.
    multiplier : (N+1, R) array
        zeta times the length of the slope.
    product : (N+1, R) array
        abs(zeta g) over the range of what the row reads.
    compliance : (N+1, R) array
        Of a soft row: how far it gives way for a multiplier of one.
    room : (N+1, R) array
        What the multiplier of a soft row lacks to its price; infinite elsewhere.
    """

    is_row: np.ndarray
    value: np.ndarray
    distance: np.ndarray
    slope: np.ndarray
    multiplier: np.ndarray
    product: np.ndarray
    compliance: np.ndarray
    room: np.ndarray

    @classmethod
    def of(cls, slots: Slots, sizes: np.ndarray, is_free: np.ndarray) -> Contact:
        """Of rows in scaled variables.

        Parameters
        ----------
        slots : Slots
        sizes : (n+m,) array
            Ranges of states and controls.
        is_free : (N+1, n+m) array of bool
            What no end fixes.
        """
        length = np.sqrt((slots.slope**2).sum(axis=-1))
        is_flat = length == 0.0
        unit = slots.slope / np.where(is_flat, 1.0, length)[..., None]
        reach = np.where(is_flat, sizes.max(), np.sqrt(((unit * sizes) ** 2).sum(axis=-1)))
        value = slots.value / length
        value[slots.value == 0.0] = 0.0
        return cls(
            is_row=slots.is_row,
            value=value,
            distance=value / reach,
            slope=unit * is_free[:, None],
            multiplier=slots.zeta * length,
            product=np.abs(slots.zeta * slots.value) / reach,
            compliance=slots.compliance / np.where(is_flat, 1.0, length) ** 2,
            room=(slots.price - slots.zeta) * np.where(is_flat, 1.0, length),
        )

    @property
    def near(self) -> np.ndarray:
        """(N+1, R) array of bool: the rows that touch, or are violated."""
        return self.distance >= -NEAR

    def strong(self, size: float) -> np.ndarray:
        """(N+1, R) array of bool: the strongly active rows.

        Parameters
        ----------
        size : float
            The largest slope or multiplier.
        """
        pull = np.minimum(self.multiplier, self.room) / size
        return self.near & (pull > CLEAR) & (pull > CLEARER * np.abs(self.distance))

    def only(self, kept: np.ndarray) -> Contact:
        """Without all rows but some.

        Parameters
        ----------
        kept : (N+1, R) array of bool
        """
        return replace(
            self,
            is_row=self.is_row & kept,
            value=np.where(kept, self.value, 0.0),
            distance=np.where(kept, self.distance, -np.inf),
            slope=np.where(kept[..., None], self.slope, 0.0),
            multiplier=np.where(kept, self.multiplier, 0.0),
            product=np.where(kept, self.product, 0.0),
            compliance=np.where(kept, self.compliance, 0.0),
            room=np.where(kept, self.room, np.inf),
        )

    def pull(self) -> np.ndarray:
        """(N+1, n+m) array: what the rows add to the slope of the Lagrangian."""
        return (self.multiplier[:, None] @ self.slope)[:, 0]


def sizes_of(q: np.ndarray, u: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """(n+m,) array: ranges of states (N+1, n) and of controls (N, m) with their limits (m, 2)."""
    bound = np.where(np.isfinite(limits), np.abs(limits), 0.0).max(axis=1)
    of_states = np.maximum(np.abs(q).max(axis=0), SMALLEST_STATE)
    of_controls = np.maximum(np.abs(u).max(axis=0), np.maximum(bound, SMALLEST_CONTROL))
    return np.concatenate([of_states, of_controls])


def rows_of(
    problem: OptimalControlProblem,
    point: tuple[np.ndarray, np.ndarray],
    zetas: tuple[np.ndarray, np.ndarray],
    factors: np.ndarray,
    cost: float,
) -> Slots:
    """Inequality rows of a problem, of the stages and of the end.

    Parameters
    ----------
    problem : OptimalControlProblem
    point : (n, N+1) and (m, N) arrays
        States with the end and controls, in the user's units.
    zetas : (r, N) and (r_e,) arrays
    factors : (n+m,) array
        Of the scales of states and controls.
    cost : float
        Of the scale of the cost.
    """
    (q, u), (zeta, zeta_end), n = point, zetas, problem.n
    rows, end = problem.functions.rows(q[:, :-1], u), problem.functions.end_rows(q[:, -1])
    r, r_end = len(rows.value), len(end.value)
    slots = Slots.empty(q.shape[1], max(r, r_end), len(factors))
    slots.is_row[:-1, :r] = slots.is_row[-1, :r_end] = True
    slots.value[:-1, :r], slots.value[-1, :r_end] = rows.value.T, end.value
    slots.slope[:-1, :r] = rows.jacobian.transpose(2, 0, 1) * factors
    slots.slope[-1, :r_end, :n] = end.jacobian * factors[:n]
    slots.zeta[:-1, :r], slots.zeta[-1, :r_end] = zeta.T / cost, zeta_end / cost
    for stages, group in ((slice(-1), problem.inequalities), (-1, problem.end_inequalities)):
        for slot, row in enumerate(group):
            if row.soft:
                slots.compliance[stages, slot] = row.soft.compliance * cost
                slots.price[stages, slot] = row.soft.price / cost
    slots.value[:] -= slots.compliance * slots.zeta
    return slots


def limits_of(u: np.ndarray, limits: np.ndarray, slope: np.ndarray, sizes: np.ndarray) -> Slots:
    """The limits of controls as rows, of each control the nearer one; at the end there are none.

    Parameters
    ----------
    u : (N, m) array
    limits : (m, 2) array
        Infinite where there is none.
    slope : (N, n+m) array
        Of the Lagrangian without these limits.
    sizes : (n+m,) array
    """
    bounded = np.flatnonzero(np.isfinite(limits).any(axis=1))
    at, each = slope.shape[1] - u.shape[1] + bounded, np.arange(len(bounded))
    below, above = limits[bounded, 0] - u[:, bounded], u[:, bounded] - limits[bounded, 1]
    side, value = np.where(above >= below, 1.0, -1.0), np.maximum(below, above)
    outward = np.maximum(-side * slope[:, at], 0.0)
    slots = Slots.empty(len(u) + 1, len(bounded), slope.shape[1])
    slots.is_row[:-1] = True
    slots.value[:-1] = value
    slots.slope[:-1, each, at] = side
    slots.zeta[:-1] = np.where(value / sizes[at] >= -NEAR, outward, 0.0)
    return slots
