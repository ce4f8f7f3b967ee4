"""Soft constraints at a point: cost and violations.

A soft constraint is exceeded if its multiplier has reached the penalty weight; if compliant, it is
also exceeded below the weight, by g = d zeta. Neither is an error of the point, which is the
optimum of the softened problem. The violation is reported in the unit of the constraint because the
constraint does not hold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality

AT_PRICE = 1e-6
"""Relative distance within which a multiplier counts as equal to the penalty weight."""


class _Row(NamedTuple):
    """Soft constraint at its stages; the last stage is q_N."""

    row: Inequality
    g: np.ndarray
    stages: np.ndarray
    zeta: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class SoftRows:
    """Soft constraints of a point that are exceeded, and their cost in the objective's unit.

    `at_price` counts constraints exceeded at their penalty weight, `yielding` compliant ones
    exceeded below it. `worst` has the largest violation `excess` in units of its g (empty if none
    is exceeded), at that stage, N at the end.
    """

    at_price: int
    yielding: int
    cost: float
    worst: str
    excess: float
    stage: int

    @classmethod
    def of(
        cls,
        problem: OptimalControlProblem,
        point: tuple[np.ndarray, np.ndarray],
        zetas: tuple[np.ndarray, np.ndarray],
    ) -> SoftRows | None:
        """Evaluate the soft constraints at a point; None if the problem has none.

        States (n, N+1), controls (m, N) and multipliers (r, N), (r_e,) are in the user's units.
        """
        rows = _soft_rows(problem, *point, *zetas)
        if not rows:
            return None
        at_price, yielding, worst = 0, 0, ("", 0.0, 0)
        for row, g, stages, zeta in rows:
            soft = row.soft
            assert soft is not None
            there = (g > soft.compliance * soft.weight) & (zeta >= (1 - AT_PRICE) * soft.weight)
            at_price += int(there.sum())
            below = (g > 0) & ~there & (zeta > 0)
            yielding += int(below.sum()) if soft.compliance else 0
            exceeded = np.where(there | (below & bool(soft.compliance)), g, 0.0)
            if exceeded.max() > worst[1]:
                at = int(np.argmax(exceeded))
                worst = (row.name, float(exceeded[at]), int(stages[at]))
        return cls(
            at_price=at_price,
            yielding=yielding,
            cost=penalty(problem, *point),
            worst=worst[0],
            excess=worst[1],
            stage=worst[2],
        )

    @property
    def reported(self) -> str:
        """Numbers of exceeded constraints and the largest violation, as text."""
        if not self.worst:
            return "all satisfied"
        found = [f"{self.at_price} violated at their penalty weight"] if self.at_price else []
        found += [f"{self.yielding} violated below it"] if self.yielding else []
        return (
            f"{', '.join(found)}; {self.worst} most, by {self.excess:.4g} at stage {self.stage}; "
            f"cost {self.cost:.4g}"
        )

    def __str__(self) -> str:
        return f"soft constraints              {self.reported}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Slacks:
    """Slacks of soft constraints for solvers without penalties: g <= sum of slacks.

    `share` (r, S) is the coefficient of every slack in every constraint. A slack s costs price s +
    stiffness s^2 / 2.
    """

    share: np.ndarray
    price: np.ndarray
    stiffness: np.ndarray

    @classmethod
    def of(cls, rows: Sequence[Inequality]) -> Slacks:
        """Return one slack per finite penalty weight and per compliance of r constraints."""
        found = []
        for place, soft in enumerate(row.soft for row in rows):
            if soft is not None and math.isfinite(soft.weight):
                found.append((place, soft.weight, 0.0))
            if soft is not None and soft.compliance:
                found.append((place, 0.0, 1.0 / soft.compliance))
        places, prices, stiffness = np.array(found).reshape(-1, 3).T
        share = np.arange(len(rows))[:, None] == places
        return cls(share=share.astype(float), price=prices, stiffness=stiffness)

    @property
    def count(self) -> int:
        """Number of slacks."""
        return len(self.price)

    def cost(self, ca: Any, slack: Any) -> Any:
        """Return the cost of the slacks, in the unit of the objective."""
        return ca.dot(self.price, slack) + ca.dot(self.stiffness, slack**2) / 2


def penalty(problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray) -> float:
    """Return the cost of the soft constraints of a path, in the unit of the objective.

    `q` (n, N+1) includes the end; `u` is (m, N).
    """
    none = np.zeros((len(problem.inequalities), problem.horizon))
    rows = _soft_rows(problem, q, u, none, np.zeros(len(problem.end_inequalities)))
    return float(sum(row.row.soft.cost(row.g).sum() for row in rows if row.row.soft))


def _soft_rows(problem: OptimalControlProblem, q, u, zeta, zeta_end) -> list[_Row]:
    if not problem.soft:
        return []
    stages, last = np.arange(problem.horizon), np.array([problem.horizon])
    of_stages = problem.functions.rows(q[:, :-1], u).value
    of_end = problem.functions.end_rows(q[:, -1]).value
    rows = [_Row(r, g, stages, z) for r, g, z in zip(problem.inequalities, of_stages, zeta)]
    at_end = zip(problem.end_inequalities, of_end[:, None], zeta_end[:, None])
    rows += [_Row(r, g, last, z) for r, g, z in at_end]
    return [row for row in rows if row.row.soft]
