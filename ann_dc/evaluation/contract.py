"""The contract of every evaluator: what a network computes, one class an array library.

1. A state is a vector x (n,) of the live neurons, in the order of `Network.places`; what comes back
   are NumPy arrays, whatever the evaluator calculates with.
2. Pinned neurons read their inputs, absent ones zero; neither has a drive.
3. `drives` returns zero for a drive that points outward at a rail, and the row of the Jacobian is
   zero there. Residuals, equilibria and certificates read these drives.
4. `rhs` is the projection of M d on what the rails allow, in the norm of M^{-1}, with d the drives
   as they arrive: see `rules`. A neuron with a diagonal row of M moves with its cut drive. A neuron
   that the metric couples to others and that stands at a rail is judged by its move and by the
   current that holds it there, not by its drive. No move goes past a rail, and the result depends
   on the state alone, whatever an evaluator keeps from call to call. `move` is M d without rails.
5. Derivatives of the flow (`fastest_rate`, spectra) hold the neurons that rest: M among the others
   (`Metric.clamp`) times the rows of `drive_jacobian`.
6. Derivatives are exact and come from the same list of nodes as the values.
7. A domain is open, and the argument of a reciprocal keeps the side of the pole where it starts.

`tests/evaluation/test_contract.py` holds every evaluator to it, `test_rules.py` to rule 4.
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
from ann_dc.evaluation.rules import rests
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network


class Evaluator(ABC):
    """What a network computes at a state ``x``, a vector (n,) of the live neurons.

    Parameters
    ----------
    network : Network
    tape : Tape
        What the evaluator reads: the network's own, or one with other numbers.
    """

    def __init__(self, network: Network, tape: Tape) -> None:
        self.network, self.tape = network, tape

    @property
    def node_index(self) -> dict[str, int]:
        """Row of every node in `values`, by its name."""
        return self.network.node_index

    @abstractmethod
    def values(self, x: np.ndarray) -> np.ndarray:
        """Values of every node at a state.

        Parameters
        ----------
        x : (n,) array

        Returns
        -------
        (nodes, N + 2) array
            In the order of ``node_index``: the stages, and one column beyond either end.
        """

    @abstractmethod
    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, before its time constant.

        Parameters
        ----------
        x : (n,) array

        Returns
        -------
        (neurons, N) array
        """

    @abstractmethod
    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds: the projection of M drive on what the rails allow.

        Parameters
        ----------
        x : (n,) array

        Returns
        -------
        (n,) array
        """

    @abstractmethod
    def move(self, drive: np.ndarray) -> np.ndarray:
        """The metric times a vector, M drive, in time proportional to n.

        Parameters
        ----------
        drive : (n,) array

        Returns
        -------
        (n,) array
        """

    def clamped(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return `move` while some neurons are held: the metric among the others (`Metric.among`).

        Parameters
        ----------
        held : (n,) array of bool
            Those among them that the metric does not couple make no difference.

        Returns
        -------
        callable
            Drives (n,) to moves (n,).
        """
        return self.network.metric.among(self.network.row, held)

    @abstractmethod
    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Relative (constraint, stationarity) residuals at a state; see `rules.residuals`.

        Parameters
        ----------
        x : (n,) array

        Returns
        -------
        constraint, stationarity : float
        """

    @abstractmethod
    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of d drive / dx at a state; zero at a rail.

        Parameters
        ----------
        x : (n,) array

        Returns
        -------
        (nnz,) array
            In the order of ``tape.entries``.
        """

    @abstractmethod
    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """The first function block that a state takes outside its domain.

        Of a state whose drives are finite; what is not is for `residuals` to say.

        Parameters
        ----------
        x : (n,) array
        guard : DomainGuard
            From the start of the run.

        Returns
        -------
        block, stage : int
            Both -1 where there is none.
        """

    def domain_guard(self, x: np.ndarray) -> DomainGuard:
        """Watches the domains of all function blocks, from a start ``x`` (n,) on."""
        return DomainGuard.at(self.tape, self.values(x))

    def drive_jacobian(self, x: np.ndarray) -> Any:
        """d drive / dx at a state; block tridiagonal by stage where wires reach neighbours only.

        Parameters
        ----------
        x : (n,) array

        Returns
        -------
        (n, n) sparse array
        """
        return self.sparse(self.jacobian_entries(x))

    def fastest_rate(self, x: np.ndarray, iterations: int = 20) -> float:
        """Estimate of the spectral radius of d rhs / dx at a state, by power iterations.

        The neurons that rest at the state are held.

        Parameters
        ----------
        x : (n,) array
        iterations : int

        Returns
        -------
        float
            In units of 1 / network time; 1 where there is none.
        """
        v, rate = np.random.default_rng(0).standard_normal(len(x)), 1.0
        entries, (row, column) = self.jacobian_entries(x), self.tape.entries[:, :2].T
        length, move = math.sqrt(v @ v), self.clamped(~self.free(x))
        for _ in range(iterations):
            drive = np.bincount(row, entries * v[column], len(v)) / length
            v = move(drive)
            length = math.sqrt(v @ v)
            if not 0 < length < math.inf:
                break
            rate = length
        return rate

    def sparse(self, data: np.ndarray) -> Any:
        """A drive Jacobian as a matrix.

        Parameters
        ----------
        data : (nnz,) array
            Its entries, in the order of ``tape.entries``.

        Returns
        -------
        (n, n) sparse array
        """
        return sparse.csr_array((data, *self._pattern), shape=(self.network.size,) * 2)

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray]:
        rows = self.tape.entries[:, 0]
        pointers = np.searchsorted(rows, np.arange(self.network.size + 1))
        return self.tape.entries[:, 1].astype(np.int32), pointers.astype(np.int32)

    @cached_property
    def has_rails(self) -> bool:
        """Whether any neuron has a rail."""
        return bool(np.isfinite(self.tape.limits).any())

    def resting(self, x: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """(n,) booleans: which neurons stand at a rail with their drive cut off.

        Parameters
        ----------
        x : (n,) array
        drives : (neurons, N) array
        """
        if not self.has_rails and np.isfinite(x).all():
            return np.zeros(self.network.size, bool)
        low, high = self.tape.limits[self.tape.places[:, 0]].T
        return rests(np.real(x), self.network.pack(drives), low, high)

    def free(self, x: np.ndarray) -> np.ndarray:
        """(n,) booleans: which neurons no rail holds; drives are computed only where one might.

        Parameters
        ----------
        x : (n,) array
        """
        if not self.has_rails:
            return np.ones(self.network.size, bool)
        return ~self.resting(x, self.drives(x))
