"""Active inequalities and control limits at a point, in the scales of the problem.

A constraint g(q, u) <= 0 is divided by the length of its gradient in scaled variables. Its value is
then a distance and its multiplier a gradient of the cost; neither depends on the scaling of the
constraint. The distance is relative to the range of the variables that the constraint reads. A
control limit is also a constraint; its multiplier is the cost decrease per outward displacement.

A soft constraint is in equilibrium at g = d zeta while zeta is below the penalty weight; its value
is g - d zeta. At the penalty weight it becomes a cost, P g (`expansion`).

A constraint is active if its distance is zero within `NEAR`. It is strongly active if its
multiplier is clearly positive, and weakly active otherwise (accidental contact or imminent
release).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem

NEAR = 1e-5
"""Distance below which a constraint is active, relative to the range of its variables."""
CLEAR = 1e-5
"""Smallest multiplier of strong activity, relative to the largest gradient or multiplier."""
CLEARER = 10.0
"""Smallest ratio of multiplier to distance of strong activity; excludes solver residues."""
SMALLEST_STATE = 0.1
"""Smallest range of a state, in its scale."""
SMALLEST_CONTROL = 1e-6
"""Smallest range of a control, in its scale: on a long chain every stage needs little."""


class Slots(NamedTuple):
    """Constraints in scaled variables, (N+1, R) slots per stage; the last stage is q_N.

    `is_row` is True if the slot contains a constraint; `value` is g, negative in empty slots, and
    `slope` (N+1, R, n+m) its gradient. Multipliers `zeta` and penalty weights `price`, infinite for
    hard constraints, are relative to the cost scale; `compliance` is zero for hard constraints.
    """

    is_row: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    zeta: np.ndarray
    compliance: np.ndarray
    price: np.ndarray

    @classmethod
    def empty(cls, stages: int, slots: int, z: int) -> Slots:
        """Return slots without constraints."""
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
        """Return these constraints joined with others of the same stages."""
        return Slots(*(np.concatenate(pair, axis=1) for pair in zip(self, other)))

    def pull(self) -> np.ndarray:
        """Return the contribution (N+1, n+m) to the gradient of the Lagrangian."""
        return (self.zeta[:, None] @ self.slope)[:, 0]

    def without(self, gone: np.ndarray) -> Slots:
        """Return the slots with the constraints in `gone` (N+1, R) of bool removed."""
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
    """Constraints by slots (N+1, R), with gradients normalised to unit length.

    `value` is g over the length of its gradient, and `distance` is relative to the range of the
    variables: positive if violated, infinite if the gradient is zero and the value is not. `slope`
    (N+1, R, n+m) is zero in components that an end fixes. `multiplier` is zeta times the length of
    the gradient, and `product` is abs(zeta g) relative to the range. `room` is the difference of
    penalty weight and multiplier, infinite for hard constraints.
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
        """Normalise constraints that are given in scaled variables.

        `sizes` (n+m,) are ranges; `is_free` (N+1, n+m) is True for variables that no end fixes.
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
        """Active or violated constraints, (N+1, R) array of bool."""
        return self.distance >= -NEAR

    def strong(self, size: float) -> np.ndarray:
        """Return the strongly active constraints (N+1, R) of bool.

        `size` is the largest gradient entry or multiplier.
        """
        pull = np.minimum(self.multiplier, self.room) / size
        return self.near & (pull > CLEAR) & (pull > CLEARER * np.abs(self.distance))

    def only(self, kept: np.ndarray) -> Contact:
        """Return the constraints selected by `kept` (N+1, R) of bool."""
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
        """Return the contribution (N+1, n+m) to the gradient of the Lagrangian."""
        return (self.multiplier[:, None] @ self.slope)[:, 0]


def sizes_of(q: np.ndarray, u: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return ranges (n+m,) of states (N+1, n) and controls (N, m) with limits (m, 2)."""
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
    """Return the inequality constraints of the stages and of the end.

    States (n, N+1), controls (m, N) and multipliers (r, N), (r_e,) are in the user's units.
    `factors` (n+m,) and `cost` are scales.
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
                slots.price[stages, slot] = row.soft.weight / cost
    slots.value[:] -= slots.compliance * slots.zeta
    return slots


def limits_of(u: np.ndarray, limits: np.ndarray, slope: np.ndarray, sizes: np.ndarray) -> Slots:
    """Return the control limits (m, 2) as constraints, the nearer limit of each control.

    The last stage has none. `slope` (N, n+m) is the gradient of the Lagrangian without the limits.
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
