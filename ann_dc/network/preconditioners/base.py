r"""The metric of a network, whatever its kind: how the drives of all neurons become their moves.

.. math:: \dot x = M\, d(x), \qquad M = M^T > 0 .

Every neuron has a time constant; a metric says which neurons besides move with a drive. It is
symmetric and positive definite, so that it changes how fast a network settles and never where:
M d = 0 only where d = 0. No kind spreads the drive of a dual neuron.

1. `apply` is M d in time proportional to the neurons, for drives with any leading batch axes.
2. `factors` is M as sparse matrices, from which its `inverse` comes.
3. `wires` is what has to be built besides the neighbour wiring.
4. A neuron that is pinned or absent has no rate and takes no part.
5. `clamp` is M among the other neurons while some are held at a rail: with S_FF for a stiffness.
"""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from scipy import sparse


class Kind(enum.Enum):
    """The kinds of metric; the value is the sentence that a user reads.

    Examples
    --------
    >>> Kind.GRID.value
    'neighbour grid'
    """

    TIME_CONSTANTS = "time constants alone"
    PYRAMID = "pyramid of coarse coordinators"
    COUPLED_PYRAMID = "pyramid with coupled components"
    GRID = "neighbour grid"
    TREE = "feed-forward tree"


ALL_KINDS = tuple(Kind)
"""What equations can be integrated with; hardware may build less."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """What a metric has to know of the row of cells that it belongs to; P neurons, N stages.

    Attributes
    ----------
    rates : (P, N) array
        1 / tau, zero where a neuron is pinned or absent.
    primal : (m,) array of int
        Rows of the primal neurons (q, u, t).
    chains : (C, 2) array of int
        Rows of the (q, t) neurons of every chain.
    """

    rates: np.ndarray
    primal: np.ndarray
    chains: np.ndarray

    @property
    def stages(self) -> int:
        """N."""
        return self.rates.shape[1]

    @cached_property
    def component(self) -> np.ndarray:
        """(P, N) integers: place in the state vector, -1 where there is no neuron."""
        component = -np.ones(self.rates.shape, np.int64)
        live = self.rates.T > 0
        component.T[live] = np.arange(live.sum())
        return component

    @cached_property
    def state_rates(self) -> np.ndarray:
        """(n,): 1 / tau of every component of the state vector."""
        return self.rates.T[self.rates.T > 0]

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and stages (n,) of the components of the state vector."""
        stage, neuron = np.nonzero(self.rates.T > 0)
        return neuron, stage

    @property
    def chain_components(self) -> np.ndarray:
        """(C, 2N) integers: components of q_0, t_0, q_1, ... of every chain, -1 where dead."""
        return self.component[self.chains].transpose(0, 2, 1).reshape(len(self.chains), -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Factors:
    """M = spread stiffness^{-1} spread', over the components of a state vector.

    Attributes
    ----------
    spread : (n, a) sparse array
        How much a node of the metric moves every neuron.
    stiffness : (a, a) sparse array
        Symmetric positive definite: how hard it is to move a node.
    """

    spread: Any
    stiffness: Any

    def matrix(self) -> sparse.csr_array:
        """M (n, n); full where the stiffness is not diagonal."""
        diagonal = self.stiffness.diagonal()
        if self.stiffness.nnz == len(diagonal):
            return sparse.csr_array(self.spread @ sparse.diags_array(1 / diagonal) @ self.spread.T)
        between = scipy.sparse.linalg.splu(self.stiffness.tocsc())
        return sparse.csr_array(self.spread @ between.solve(self.spread.T.toarray()))

    def inverse(self) -> Callable[[np.ndarray], np.ndarray]:
        """v (n,) -> M^{-1} v, by one sparse factorisation.

        M^{-1} v = lambda with stiffness y = spread' lambda and spread y = v.
        """
        corner = sparse.csc_array((self.spread.shape[0],) * 2)
        rows = [[self.stiffness, -self.spread.T], [self.spread, corner]]
        solver = scipy.sparse.linalg.splu(sparse.block_array(rows, format="csc"))
        nodes = np.zeros(self.stiffness.shape[0])
        return lambda v: solver.solve(np.concatenate([nodes, v]))[len(nodes) :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Wires:
    """What a metric adds to the neighbour wiring.

    Attributes
    ----------
    weights : (n, nodes) sparse array
        Weight of the wire between a neuron and a node of the metric. Where a node stands for a
        neuron, as in a grid or a tree, it has that neuron's place: (n, n).
    nodes : int
        Nodes that have to be built besides the neurons.
    both_ways : bool
        Whether each wire is there twice, to the node and back.
    """

    weights: Any
    nodes: int = 0
    both_ways: bool = False

    @property
    def count(self) -> int:
        """Number of wires; each way, where there are two."""
        return int(self.weights.count_nonzero())

    def per_cell(self, stages: int) -> float:
        """Wires a cell; each way, where there are two."""
        return self.count / stages


Clamp: TypeAlias = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Drives (..., n) -> moves (..., n), zero for held neurons, and currents (..., n), zero for all
others, with moves = M (drives + currents)."""


class Metric(ABC):
    """How drives become moves; see the module for the contract."""

    @property
    @abstractmethod
    def kind(self) -> Kind:
        """Which kind it is."""

    @abstractmethod
    def check(self, row: Row) -> None:
        """Refuse a row that it does not fit.

        Raises
        ------
        NetworkError
            With what was given and what was expected.
        """

    @abstractmethod
    def apply(self, row: Row, drives: np.ndarray) -> np.ndarray:
        """M d.

        Parameters
        ----------
        row : Row
        drives : (..., P, N) array
            Zero where there is no neuron.

        Returns
        -------
        (..., P, N) array
        """

    def moves(self, row: Row, drives: np.ndarray) -> np.ndarray:
        """Return M d for drives (..., n) over the components of a state vector."""
        table = np.zeros((*drives.shape[:-1], *row.rates.shape), drives.dtype)
        neuron, stage = row.places
        table[..., neuron, stage] = drives
        return self.apply(row, table)[..., neuron, stage]

    def clamp(self, row: Row, held: np.ndarray) -> Clamp:
        """Return the map from drives to moves while some neurons are held.

        The current of a held neuron is that of an ideal diode at its rail: it keeps the move of the
        neuron at zero, and the metric spreads it like a drive. The moves of the other neurons are
        argmin 1/2 v' M^{-1} v - d'v over all v that are zero where a neuron is held.

        Parameters
        ----------
        row : Row
        held : (n,) array of bool

        Returns
        -------
        Clamp
            Factored once.

        Examples
        --------
        >>> from ann_dc.network.preconditioners import TimeConstants
        >>> row = Row(rates=np.ones((1, 2)), primal=np.array([0]), chains=np.zeros((0, 2), int))
        >>> clamp = TimeConstants().clamp(row, np.array([False, True]))
        >>> [found.tolist() for found in clamp(np.array([2.0, 3.0]))]
        [[2.0, 0.0], [0.0, -3.0]]
        """
        if not held.any():
            return lambda drives: (self.moves(row, drives), np.zeros_like(drives))
        within = scipy.linalg.cho_factor(self.moves(row, np.eye(len(held))[held])[:, held])

        def clamped(drives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            pull, currents = self.moves(row, drives)[..., held], np.zeros_like(drives)
            columns = pull.reshape(-1, pull.shape[-1]).T
            found = scipy.linalg.cho_solve(within, columns, check_finite=False)
            currents[..., held] = -found.T.reshape(pull.shape)
            return np.where(held, 0.0, self.moves(row, drives + currents)), currents

        return clamped

    def among(self, row: Row, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return M d for drives (..., n) while some neurons are held, as a function of d.

        Held ones that the metric does not couple make no difference, and move with their drives.

        Parameters
        ----------
        row : Row
        held : (n,) array of bool
        """
        held = held & self.reach(row)[row.places[0]]
        if not held.any():
            return lambda drives: self.moves(row, drives)
        clamp = self.clamp(row, held)
        return lambda drives: clamp(drives)[0]

    @abstractmethod
    def factors(self, row: Row) -> Factors:
        """M as sparse factors, with of order N or N log N entries."""

    def inverse(self, row: Row) -> Callable[[np.ndarray], np.ndarray]:
        """v (n,) -> M^{-1} v, by one sparse factorisation."""
        return self.factors(row).inverse()

    @abstractmethod
    def wires(self, row: Row) -> Wires:
        """What has to be built besides the neighbour wiring."""

    @abstractmethod
    def reach(self, row: Row) -> np.ndarray:
        """(P,) booleans: which neurons of the cell move with the drives of others too.

        The rest move with their own alone, M d = d / tau.
        """
