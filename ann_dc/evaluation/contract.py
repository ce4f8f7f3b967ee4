"""Contract of all evaluators: the quantities that a network computes.

1. A state is a vector x (n,) of the live neurons in the order of `Network.places`. Results are
   NumPy arrays, whichever array library the evaluator uses.
2. Pinned neurons read their inputs and absent neurons read zero; neither has a net input d.
3. `drives` returns zero for a net input that points outward at a saturation limit, and the row of
   the Jacobian is zero there. Residuals, equilibria and certificates read these net inputs.
4. `rhs` is the projection of M d on the saturation limits in the norm of M^{-1}, where d are the
   uncut net inputs (see `rules`). A neuron with a diagonal row of M uses its cut net input. A
   saturated neuron that the preconditioner couples to others is judged by its derivative and its
   holding current, not by its net input. No derivative leads past a limit. The result depends on
   the state alone, whatever an evaluator caches. `derivative` is M d without limits.
5. Derivatives of the flow (`fastest_rate`, spectra) hold the saturated neurons: M among the others
   (`Preconditioner.clamp`) times the rows of `drive_jacobian`.
6. Derivatives are exact and come from the same list of nodes as the values.
7. A domain is open. The argument of a reciprocal stays on the initial side of the pole.

`tests/evaluation/test_contract.py` checks every evaluator against the contract, `test_rules.py`
against rule 4.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.rules import is_saturated
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network


class Evaluator(ABC):
    """Base class of the quantities that a network computes at a state x (n,).

    The tape is that of the network or a tape with other numbers.
    """

    def __init__(self, network: Network, tape: Tape) -> None:
        self.network, self.tape = network, tape

    @property
    def node_index(self) -> dict[str, int]:
        """Row of every node in `values`, by name."""
        return self.network.node_index

    @abstractmethod
    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (nodes, N + 2) of all nodes at a state (n,).

        Rows have the order of `node_index`. The columns are the stages, with one additional column
        at either end.
        """

    @abstractmethod
    def drives(self, x: np.ndarray) -> np.ndarray:
        """Return the net inputs (neurons, N) at a state (n,), before the time constants."""

    @abstractmethod
    def rhs(self, x: np.ndarray) -> np.ndarray:
        """Return dx/ds (n,), the projection of M times the net inputs on the limits."""

    @abstractmethod
    def derivative(self, drive: np.ndarray) -> np.ndarray:
        """Multiply a vector (n,) by the preconditioner M, in time proportional to n."""

    def clamped(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return `derivative` with the masked neurons (n,) held.

        The callable maps net inputs (n,) to derivatives (n,) with the preconditioner among the
        other neurons (`Preconditioner.among`). Held neurons that the preconditioner does not couple
        make no difference.
        """
        return self.network.preconditioner.among(self.network.layout, held)

    @abstractmethod
    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Return the relative residuals (constraint, stationarity); see `rules.residuals`."""

    @abstractmethod
    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Return the entries (nnz,) of d drive / dx at a state (n,).

        The entries have the order of ``tape.entries`` and are zero at a saturation limit.
        """

    @abstractmethod
    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """Return (block, stage) of the first function block outside its domain.

        Both are -1 if there is none. The net inputs of the state must be finite (`residuals`
        detects others). The guard is the one from the start of the run.
        """

    def domain_guard(self, x: np.ndarray) -> DomainGuard:
        """Return a guard of all function-block domains for a run from a state x (n,)."""
        return DomainGuard.at(self.tape, self.values(x))

    def drive_jacobian(self, x: np.ndarray) -> Any:
        """Return d drive / dx at a state (n,) as a sparse (n, n) array.

        The matrix is block tridiagonal by stage if all connections reach neighbours only.
        """
        return self.sparse(self.jacobian_entries(x))

    def fastest_rate(self, x: np.ndarray, iterations: int = 20) -> float:
        """Estimate the spectral radius of d rhs / dx at a state by power iterations.

        The saturated neurons are held. The rate is in units of 1 / network time; 1 if there is
        none.
        """
        v, rate = np.random.default_rng(0).standard_normal(len(x)), 1.0
        entries, (row, column) = self.jacobian_entries(x), self.tape.entries[:, :2].T
        length, derivative = math.sqrt(v @ v), self.clamped(~self.free(x))
        for _ in range(iterations):
            drive = np.bincount(row, entries * v[column], len(v)) / length
            v = derivative(drive)
            length = math.sqrt(v @ v)
            if not 0 < length < math.inf:
                break
            rate = length
        return rate

    def sparse(self, data: np.ndarray) -> Any:
        """Return a drive Jacobian as a sparse (n, n) array.

        The data (nnz,) have the order of ``tape.entries``.
        """
        return sparse.csr_array((data, *self._pattern), shape=(self.network.size,) * 2)

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray]:
        rows = self.tape.entries[:, 0]
        pointers = np.searchsorted(rows, np.arange(self.network.size + 1))
        return self.tape.entries[:, 1].astype(np.int32), pointers.astype(np.int32)

    @cached_property
    def has_limits(self) -> bool:
        """True if any neuron has a saturation limit."""
        return bool(np.isfinite(self.tape.limits).any())

    def saturated(self, x: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Return the mask (n,) of neurons at a limit with an outward net input.

        The net inputs have shape (neurons, N).
        """
        if not self.has_limits and np.isfinite(x).all():
            return np.zeros(self.network.size, bool)
        low, high = self.tape.limits[self.tape.places[:, 0]].T
        return is_saturated(np.real(x), self.network.pack(drives), low, high)

    def free(self, x: np.ndarray) -> np.ndarray:
        """Return the mask (n,) of neurons that are not held at a saturation limit.

        Net inputs are computed only if a neuron may be held.
        """
        if not self.has_limits:
            return np.ones(self.network.size, bool)
        return ~self.saturated(x, self.drives(x))
