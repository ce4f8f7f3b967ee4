"""Resistive grid between the primal neurons of neighbouring cells.

The net inputs are currents into the grid, the state derivatives are its voltages. The longest wire
reaches the next cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from scipy import sparse

from ann_dc.network.preconditioners.base import ArrayLayout, PreconditionerKind, Wires
from ann_dc.network.preconditioners.stiffness import Stiffness


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class ResistiveGrid(Stiffness):
    """Stiffness between neighbours, realised as a resistive grid.

    Examples
    --------
    One neuron in each of three cells, every one tied to the next:

    >>> import numpy as np
    >>> own = np.full((3, 1, 1), 1.0)
    >>> grid = ResistiveGrid(own=own, following=np.full((2, 1, 1), -0.5))
    >>> row = ArrayLayout(rates=np.ones((1, 3)), primal=np.array([0]), chains=np.zeros((0, 2), int))
    >>> grid.apply(row, np.array([[1.0, 0.0, 0.0]])).round(2).tolist()
    [[1.5, 1.0, 0.5]]
    >>> grid.wires(row).count
    2
    """

    @property
    def kind(self) -> PreconditionerKind:
        """Kind of the preconditioner, `PreconditionerKind.RESISTIVE_GRID`."""
        return PreconditionerKind.RESISTIVE_GRID

    def wires(self, row: ArrayLayout) -> Wires:
        """Return one wire, with weight S, between each two neurons that S couples."""
        return Wires(weights=sparse.csr_array(sparse.triu(self.matrix(row), k=1)))
