"""Inequalities as distances: stage by stage, then the end.

A constraint g <= 0 is divided by the length of its gradient on its boundary, in the problem's
scales. A positive value is the distance that a path must move to satisfy the constraint. Soft
constraints need not hold and are omitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import sparse

from ann_dc.problem.boundary import boundary_slopes
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.scales import straight_line


class WorstStage(NamedTuple):
    """Stage of the largest violation of an inequality, N at the end.

    `distance` is in scales, and `excess` is g in its unit.
    """

    inequality: Inequality
    distance: float
    excess: float
    stage: int


class RowDistances:
    """Distances of paths to the hard constraints, positive if violated, with derivatives.

    `columns` (N+1, n+m) are the indices of the unknowns, -1 if a variable is none. `length`
    (count,) is the value of a distance of one, for all stages and the end.
    """

    def __init__(self, problem: OptimalControlProblem, columns: np.ndarray) -> None:
        self.problem, n, stages = problem, problem.n, problem.horizon
        self.kinds = _hard(problem.inequalities), _hard(problem.end_inequalities)
        r, r_end = map(len, self.kinds)
        self.count = r * stages + r_end
        line = straight_line(problem)
        self.factors = np.array(line.scales.states + line.scales.controls)[:, 0]
        slopes = np.ones(0), np.ones(0)
        if self.count:
            slopes = boundary_slopes(problem.functions, line.q, line.u, self.factors)
            slopes = tuple(slope[kind] for slope, kind in zip(slopes, self.kinds))
        self.length = np.concatenate([np.tile(slopes[0], stages), slopes[1]])
        of_stages = np.repeat(columns[:-1], r, axis=0), np.repeat(columns[-1:, :n], r_end, axis=0)
        column = np.concatenate([part.ravel() for part in of_stages])
        row = np.concatenate(
            [
                np.repeat(np.arange(r * stages), columns.shape[1]),
                np.repeat(np.arange(r * stages, self.count), n),
            ]
        )
        self.kept = column >= 0
        self.places = row[self.kept], column[self.kept]

    def of(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the distances (count,) of a path (n, N+1) with controls (m, N), scaled."""
        if not self.count:
            return np.zeros(0)
        (rows, _), (end, _) = self._at(q, u)
        return np.concatenate([rows.T.ravel(), end]) / self.length

    def jacobian(self, q: np.ndarray, u: np.ndarray, unknowns: int) -> sparse.csr_array:
        """Return the derivatives (count, unknowns) of the distances."""
        entries = np.zeros(0)
        if self.count:
            (_, rows), (_, end) = self._at(q, u)
            of_stages = rows.transpose(2, 0, 1) * self.factors
            of_end = end * self.factors[: self.problem.n]
            entries = np.concatenate([of_stages.ravel(), of_end.ravel()])[self.kept]
            entries = entries / self.length[self.places[0]]
        return sparse.csr_array((entries, self.places), shape=(self.count, unknowns))

    def worst(self, distance: np.ndarray) -> list[WorstStage]:
        """Return the worst stage of every inequality, the worst inequality first.

        `distance` (count,) is that of a path.
        """
        rows, at_end = (
            [group[i] for i in kind]
            for group, kind in zip(
                (self.problem.inequalities, self.problem.end_inequalities), self.kinds
            )
        )
        last = len(rows) * self.problem.horizon
        places = [np.arange(i, last, len(rows)) for i in range(len(rows))]
        places += [np.array([place]) for place in range(last, self.count)]
        found = []
        for inequality, own in zip((*rows, *at_end), places):
            at = int(own[np.argmax(distance[own])])
            stage = at // len(rows) if at < last else self.problem.horizon
            excess = float(distance[at] * self.length[at])
            found.append(WorstStage(inequality, float(distance[at]), excess, stage))
        return sorted(found, key=lambda row: -row.distance)

    def _at(self, q: np.ndarray, u: np.ndarray):
        """Return values and gradients of the constraints of the stages and of the end."""
        functions, (own, at_end) = self.problem.functions, self.kinds
        rows, end = functions.rows(q[:, :-1], u), functions.end_rows(q[:, -1])
        return (rows.value[own], rows.jacobian[own]), (end.value[at_end], end.jacobian[at_end])


def _hard(rows: Sequence[Inequality]) -> list[int]:
    return [i for i, row in enumerate(rows) if row.soft is None]
