"""Soft rows at a point: what they cost, and which of them are exceeded, by how much.

A soft row is exceeded where it has reached its price, and by g = d zeta below it where it is
compliant. Neither is a fault of the point, which is the optimum of the softened problem; but a row
that was meant to hold does not, so it is told, in the row's own unit.
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
"""Share of the price below which a multiplier may be missing from it and still count as there."""


class _Row(NamedTuple):
    """A soft row at the stages where it stands; the last stage is q_N."""

    row: Inequality
    g: np.ndarray
    stages: np.ndarray
    zeta: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class SoftRows:
    """The soft rows of a point.

    Attributes
    ----------
    at_price : int
        Rows of all stages and of the end that are exceeded at their price.
    yielding : int
        Compliant rows that are exceeded below it.
    cost : float
        What they add to the objective, in its unit.
    worst : str
        Name of the row that is exceeded most, in units of its own g; empty where none is.
    excess : float
        By how much, in the unit of the row.
    stage : int
        At which stage, N at the end.
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
        """Those of a problem at a point; None where it has none.

        Parameters
        ----------
        problem : OptimalControlProblem
        point : (n, N+1) and (m, N) arrays
            States with the end and controls, in the user's units.
        zetas : (r, N) and (r_e,) arrays
        """
        rows = _soft_rows(problem, *point, *zetas)
        if not rows:
            return None
        at_price, yielding, worst = 0, 0, ("", 0.0, 0)
        for row, g, stages, zeta in rows:
            soft = row.soft
            assert soft is not None
            there = (g > soft.compliance * soft.price) & (zeta >= (1 - AT_PRICE) * soft.price)
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
    def told(self) -> str:
        """How many are exceeded, and which one most, in words."""
        if not self.worst:
            return "all kept"
        found = [f"{self.at_price} exceeded at their price"] if self.at_price else []
        found += [f"{self.yielding} give way below it"] if self.yielding else []
        return (
            f"{', '.join(found)}; {self.worst} most, by {self.excess:.4g} at stage {self.stage}; "
            f"cost {self.cost:.4g}"
        )

    def __str__(self) -> str:
        return f"soft rows              {self.told}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Slacks:
    """The slacks of soft rows, as solvers that know no prices have them: g <= sum of slacks.

    Attributes
    ----------
    share : (r, S) array
        Of every slack in every row.
    price, stiffness : (S,) arrays
        What a slack costs, price s + stiffness s^2 / 2.
    """

    share: np.ndarray
    price: np.ndarray
    stiffness: np.ndarray

    @classmethod
    def of(cls, rows: Sequence[Inequality]) -> Slacks:
        """One for what costs the price, one for what the row gives way, where it has them.

        Parameters
        ----------
        rows : sequence of r Inequality
        """
        found = []
        for place, soft in enumerate(row.soft for row in rows):
            if soft is not None and math.isfinite(soft.price):
                found.append((place, soft.price, 0.0))
            if soft is not None and soft.compliance:
                found.append((place, 0.0, 1.0 / soft.compliance))
        places, prices, stiffness = np.array(found).reshape(-1, 3).T
        share = np.arange(len(rows))[:, None] == places
        return cls(share=share.astype(float), price=prices, stiffness=stiffness)

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.price)

    def cost(self, ca: Any, slack: Any) -> Any:
        """What they cost, in the unit of the objective."""
        return ca.dot(self.price, slack) + ca.dot(self.stiffness, slack**2) / 2


def penalty(problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray) -> float:
    """What the soft rows of a path cost, in the unit of the objective.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end.
    u : (m, N) array
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
