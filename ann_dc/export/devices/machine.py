"""Simulation of analog elements: values at a state and derivatives of integrators.

Sums are evaluated with sparse matrices. Other elements are assigned to ranks: an element reads only
sums of lower ranks, so a rank is computed at once. Sums that read sums of the same rank are solved
for together.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ann_dc.evaluation.rules import pushes_out
from ann_dc.export.devices.elements import (
    CONSTANT,
    FUNCTION,
    INTEGRATOR,
    PRODUCT,
    SUM,
    Element,
)
from ann_dc.network.functions import function_block


class Machine:
    """Executable set of analog-computer elements.

    Parameters
    ----------
    elements : sequence of Element
        Integrators first; all other elements read only earlier elements.
    scales : (E,) array, optional
        Value that one machine unit of every element represents; used by functions.
    """

    def __init__(self, elements: Sequence[Element], scales: np.ndarray | None = None) -> None:
        self.elements = elements
        self.scales = np.ones(len(elements)) if scales is None else scales
        kinds = [e.kind for e in elements]
        self.integrators = np.flatnonzero([kind == INTEGRATOR for kind in kinds])
        limits = [(elements[i].low, elements[i].high) for i in self.integrators.tolist()]
        self._limits = np.array(limits).reshape(-1, 2).T
        self._fixed = np.array([e.value if e.kind == CONSTANT else 0.0 for e in elements])
        self._weights = _weights(elements)
        self._moves = self._weights[self.integrators]
        ranks = np.array(_ranks(elements), np.int64)
        self._steps = [
            self._rank(np.flatnonzero(ranks == r)) for r in range(ranks.max(initial=-1) + 1)
        ]

    @property
    def start(self) -> np.ndarray:
        """Initial values (n,) of the integrators."""
        return np.array([self.elements[i].value for i in self.integrators.tolist()])

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (E,) of all elements at integrator states x (n,)."""
        values = self._fixed.copy()
        values[self.integrators] = x
        for step in self._steps:
            step(values)
        return values

    def moves(self, x: np.ndarray) -> np.ndarray:
        """Return dX/dT (n,) of the integrators; zero if a limit would be exceeded."""
        moves = self._moves @ self.values(x)
        low, high = self._limits
        return np.where(pushes_out(x, moves, low, high), 0.0, moves)

    def within(self, x: np.ndarray) -> np.ndarray:
        """Return the state with every integrator within its limits."""
        return np.clip(x, *self._limits)

    def _rank(self, places: np.ndarray):
        """Return the function that computes the elements of one rank in the values (E,)."""
        of = {k: [p for p in places.tolist() if self.elements[p].kind == k] for k in _NO_SUMS}
        parts = [_NO_SUMS[kind](self, found) for kind, found in of.items() if found]
        sums = np.array([p for p in places.tolist() if self.elements[p].kind == SUM], np.int64)
        rows = self._weights[sums]
        among = rows[:, sums]
        solve = (
            splu(sparse.csc_array(sparse.eye_array(len(sums)) - among), permc_spec="NATURAL").solve
            if among.nnz
            else None
        )

        def compute(values: np.ndarray) -> None:
            for part in parts:
                part(values)
            if len(sums):
                given = rows @ values
                values[sums] = given if solve is None else solve(given)

        return compute

    def _products(self, places: list[int]):
        a, b = np.array([self.elements[p].reads for p in places]).T

        def compute(values: np.ndarray) -> None:
            values[places] = values[a] * values[b]

        return compute

    def _functions(self, places: list[int]):
        groups = []
        for name in dict.fromkeys(self.elements[p].function for p in places):
            own = np.array([p for p in places if self.elements[p].function == name])
            x = np.array([self.elements[p].reads[0] for p in own])
            groups.append((function_block(name), own, x))

        def compute(values: np.ndarray) -> None:
            for block, own, x in groups:
                values[own] = block.value(values[x] * self.scales[x]) / self.scales[own]

        return compute


_NO_SUMS = {
    PRODUCT: Machine._products,
    FUNCTION: Machine._functions,
}


def _weights(elements: Sequence[Element]) -> sparse.csr_array:
    entries = [(row, place, w) for row, e in enumerate(elements) for place, w in e.wires.items()]
    rows, columns, weights = np.array(entries, float).reshape(-1, 3).T
    at = rows.astype(np.int64), columns.astype(np.int64)
    return sparse.csr_array(sparse.coo_array((weights, at), shape=(len(elements),) * 2))


def _ranks(elements: Sequence[Element]) -> list[int]:
    """Return the rank of every element.

    A sum has the highest rank of the elements that it reads; any other element has one more.
    """
    ranks: list[int] = []
    for e in elements:
        if e.kind in (INTEGRATOR, CONSTANT):
            ranks.append(0)
        elif e.kind == SUM:
            ranks.append(max((ranks[p] for p in e.wires), default=0))
        else:
            ranks.append(max(ranks[p] for p in e.reads) + 1)
    return ranks
