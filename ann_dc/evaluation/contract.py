"""The contract of every evaluator: what a network computes, one class an array library.

1. A state is a vector x (n,) of the live neurons, in the order of `Network.places`; what comes back
   are NumPy arrays, whatever the evaluator calculates with.
2. Pinned neurons read their inputs, absent ones zero; neither has a drive.
3. The drive of a neuron at its rail is zero while it pushes outward, and so is its row of the
   Jacobian; no move, of coordinators either, goes past a rail.
4. Derivatives are exact and come from the same list of nodes as the values.
5. A domain is open, and the argument of a reciprocal keeps the side of the pole where it starts.

`tests/evaluation/test_contract.py` holds every evaluator to it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.rules import rests
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network


class Evaluator(ABC):
    """What a network computes at a state.

    Attributes
    ----------
    network : Network
    tape : Tape
        What the evaluator reads: the network's own, or one with other numbers.
    """

    def __init__(self, network: Network, tape: Tape) -> None:
        self.network, self.tape = network, tape

    @property
    def node_index(self) -> dict[str, int]:
        """Row of every node in `values`."""
        return self.network.node_index

    @abstractmethod
    def values(self, x: np.ndarray) -> np.ndarray:
        """Values (nodes, N + 2) of every node: the stages, and one column beyond either end."""

    @abstractmethod
    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (neurons, N), before its time constant."""

    @abstractmethod
    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (n,) = M drive: time constants and coordinators."""

    @abstractmethod
    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Relative (constraint, stationarity) residuals; see `rules.residuals`."""

    @abstractmethod
    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of d drive / dx (nnz,), in the order of ``tape.entries``; zero at a rail."""

    @abstractmethod
    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """(block, stage) of the first function block outside its domain, or (-1, -1).

        Of a state whose drives are finite; what is not is for `residuals` to say.
        """

    def domain_guard(self, x: np.ndarray) -> DomainGuard:
        """Watches the domains of all function blocks, from a start on."""
        return DomainGuard.at(self.tape, self.values(x))

    def drive_jacobian(self, x: np.ndarray) -> Any:
        """d drive / dx as a sparse (n, n) matrix, block tridiagonal by stage."""
        return self.sparse(self.jacobian_entries(x))

    def sparse(self, data: np.ndarray) -> Any:
        """Entries of the drive Jacobian, in the order of ``tape.entries``, as a matrix."""
        return sparse.csr_array((data, *self._pattern), shape=(self.network.size,) * 2)

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray]:
        rows = self.tape.entries[:, 0]
        pointers = np.searchsorted(rows, np.arange(self.network.size + 1))
        return self.tape.entries[:, 1].astype(np.int32), pointers.astype(np.int32)

    def resting(self, x: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """(n,) booleans: which neurons stand at a rail with their drive cut off."""
        low, high = self.tape.limits[self.tape.places[:, 0]].T
        return rests(np.real(x), self.network.pack(drives), low, high)
