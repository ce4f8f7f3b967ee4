"""Cyclic reduction: the resistive grid's preconditioner as a feed-forward tree.

The result is exactly that of the grid, with hats that depend on the plant. A grid is a loop that
must settle faster than the network; the tree has no loop. Net inputs are passed down from neighbour
to neighbour over twice the distance each time, and state derivatives return by the same wires
(`elimination`). The disadvantage is wires that cross the whole array.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy import sparse

from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind, Wires
from ann_dc.network.preconditioners.elimination import Elimination, eliminate
from ann_dc.network.preconditioners.stiffness import Stiffness


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class CyclicReduction(Stiffness):
    """Stiffness between neighbours, realised by cyclic reduction.

    Examples
    --------
    One neuron in each of three cells: the outer ones feed the middle one.

    >>> own = np.full((3, 1, 1), 1.0)
    >>> tree = CyclicReduction(own=own, following=np.full((2, 1, 1), -0.5))
    >>> row = ArrayLayout(rates=np.ones((1, 3)), primal=np.array([0]), chains=np.zeros((0, 2), int))
    >>> tree.wires(row).weights.toarray().tolist()
    [[0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]
    """

    @property
    def kind(self) -> PreconditionerKind:
        """Kind of the preconditioner, `PreconditionerKind.CYCLIC_REDUCTION`."""
        return PreconditionerKind.CYCLIC_REDUCTION

    def elimination(self, row: ArrayLayout) -> Elimination:
        """Return the levels of the tree."""
        return eliminate(self, row)

    def wires(self, row: ArrayLayout) -> Wires:
        """Return the hats -W from eliminated (row) to remaining neurons (column).

        The wires include the couplings S_ee^{-1} within an eliminated block, above the diagonal.
        """
        found = self.elimination(row)
        place, entries = found.component, []
        for level in found.levels:
            gone, left = place[0::2], place[1::2]
            within = np.triu(level.inverse, 1)
            entries.append(_entries(gone, gone, within))
            entries.append(_entries(gone[: len(left)], left, -level.left.transpose(0, 2, 1)))
            right = -level.right.transpose(0, 2, 1)
            entries.append(_entries(gone[1:], left[: len(right)], right))
            place = left
        rows, columns, values = map(np.concatenate, zip(*entries))
        shape = (len(row.state_rates),) * 2
        weights = sparse.csr_array(sparse.coo_array((values, (rows, columns)), shape=shape))
        return Wires(weights=weights, nodes=int((found.component[1::2] >= 0).sum()), both_ways=True)


def _entries(
    rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (row, column, weight) of blocks (B, b, b) between existing components."""
    block, i, j = np.nonzero((blocks != 0) & (rows[:, :, None] >= 0) & (columns[:, None, :] >= 0))
    return rows[block, i], columns[block, j], blocks[block, i, j]
