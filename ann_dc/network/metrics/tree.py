"""The feed-forward tree: the metric of the grid, exactly, as hats that follow the plant.

Where the grid has to settle by itself, faster than the network, the tree has no loop: drives are
handed down from neighbour to neighbour over twice the distance each time, and the moves come back
the same way (`elimination`). The price is wires that reach across the whole row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy import sparse

from ann_dc.network.metrics.contract import Kind, Row, Wires
from ann_dc.network.metrics.elimination import Elimination, eliminate
from ann_dc.network.metrics.stiffness import Stiffness


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Tree(Stiffness):
    """The stiffness between neighbours as a tree.

    Examples
    --------
    One neuron in each of three cells: the outer ones feed the middle one.

    >>> own = np.full((3, 1, 1), 1.0)
    >>> tree = Tree(own=own, following=np.full((2, 1, 1), -0.5))
    >>> row = Row(rates=np.ones((1, 3)), primal=np.array([0]), chains=np.zeros((0, 2), int))
    >>> tree.wires(row).weights.toarray().tolist()
    [[0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]
    """

    @property
    def kind(self) -> Kind:
        """`Kind.TREE`."""
        return Kind.TREE

    def elimination(self, row: Row) -> Elimination:
        """The levels of the tree."""
        return eliminate(self, row)

    def wires(self, row: Row) -> Wires:
        """Hats -W from the eliminated neuron (row) to the remaining one (column).

        And the couplings S_ee^{-1} within an eliminated block, above the diagonal.
        """
        found = self.elimination(row)
        weights = sparse.lil_array((len(row.state_rates),) * 2)
        place = found.component
        for level in found.levels:
            for e, inverse in enumerate(level.inverse):
                _add(weights, place[2 * e], place[2 * e], np.triu(inverse, 1))
            for o, hat in enumerate(level.left):
                _add(weights, place[2 * o], place[2 * o + 1], -hat.T)
            for o, hat in enumerate(level.right):
                _add(weights, place[2 * o + 2], place[2 * o + 1], -hat.T)
            place = place[1::2]
        alive = row.component[row.primal] >= 0
        return Wires(weights=sparse.csr_array(weights), nodes=int(alive.sum()), both_ways=True)


def _add(weights, rows: np.ndarray, columns: np.ndarray, block: np.ndarray) -> None:
    """Add a block's weights between components that are there."""
    i, j = np.nonzero((block != 0) & (rows[:, None] >= 0) & (columns >= 0))
    weights[rows[i], columns[j]] = block[i, j]
