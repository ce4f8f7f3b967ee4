r"""Preconditioners of the network flow: the matrix M in dx/ds = M d(x).

.. math:: \dot x = M\, d(x), \qquad M = M^T > 0 .

Every neuron has a time constant. A preconditioner defines the further neurons that a net input
moves. M is symmetric and positive definite, so it changes the speed of settling but not the
equilibrium: M d = 0 only if d = 0. Preconditioners do not spread the net input of a dual neuron.

1. `apply` is M d in time proportional to the number of neurons, for any leading batch axes.
2. `factors` is M as sparse matrices, from which its `inverse` is computed.
3. `wires` is the wiring in addition to that between neighbours.
4. A fixed or omitted neuron has rate zero and is not included.
5. `clamp` is M among the other neurons while some are saturated: with S_FF for a stiffness.
"""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.conversion import declare_words, of_word
from ann_dc.errors import UnknownNameError


class PreconditionerKind(enum.Enum):
    """Kinds of preconditioner; the value is the text shown to users.

    Examples
    --------
    >>> PreconditionerKind.RESISTIVE_GRID.value
    'resistive grid'
    """

    DIAGONAL = "diagonal"
    MULTILEVEL = "multilevel"
    COUPLED_MULTILEVEL = "coupled multilevel"
    RESISTIVE_GRID = "resistive grid"
    CYCLIC_REDUCTION = "cyclic reduction"

    @property
    def is_stiffness(self) -> bool:
        """True if M is the inverse of a stiffness between neighbours."""
        return self in (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION)


Kinds: TypeAlias = PreconditionerKind | str | Iterable[PreconditionerKind | str]
"""One preconditioner kind or several, also by their words (`KINDS`)."""

ALL_KINDS = tuple(PreconditionerKind)
"""Kinds that the integration of the equations supports; hardware may support fewer."""
KINDS = {kind.value.replace(" ", "-"): kind for kind in PreconditionerKind}
"""Kinds by the words of Python, the command line and study files."""
declare_words(PreconditionerKind, KINDS)


def several(kinds: Kinds) -> tuple[PreconditionerKind, ...]:
    """Return one kind or several as a tuple; words are converted.

    Examples
    --------
    >>> several("diagonal")
    (<PreconditionerKind.DIAGONAL: 'diagonal'>,)
    """
    given = (kinds,) if isinstance(kinds, (PreconditionerKind, str)) else kinds
    of = partial(of_word, PreconditionerKind, "preconditioner", error=UnknownNameError)
    return tuple(of(kind) if isinstance(kind, str) else kind for kind in given)


@dataclass(frozen=True, kw_only=True, eq=False)
class ArrayLayout:
    """Layout of the cell array, the input of a preconditioner; P neurons, N stages.

    Attributes
    ----------
    rates : (P, N) array
        1 / tau, zero for fixed and omitted neurons.
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
        """Number of stages N."""
        return self.rates.shape[1]

    @cached_property
    def component(self) -> np.ndarray:
        """Position in the state vector, (P, N) integers; -1 without a neuron."""
        component = -np.ones(self.rates.shape, np.int64)
        live = self.rates.T > 0
        component.T[live] = np.arange(live.sum())
        return component

    @cached_property
    def state_rates(self) -> np.ndarray:
        """Rates 1 / tau of every component of the state vector, (n,)."""
        return self.rates.T[self.rates.T > 0]

    @cached_property
    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and stages (n,) of the components of the state vector."""
        stage, neuron = np.nonzero(self.rates.T > 0)
        return neuron, stage

    @property
    def chain_components(self) -> np.ndarray:
        """Components of q_0, t_0, q_1, ... of every chain, (C, 2N); -1 if not live."""
        return self.component[self.chains].transpose(0, 2, 1).reshape(len(self.chains), -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Factors:
    """Factors of M = spread stiffness^{-1} spread', over state vector components.

    ``spread`` (n, a) is the displacement of every neuron per displacement of a node of the
    preconditioner, ``stiffness`` (a, a) that between the nodes, symmetric positive definite.
    """

    spread: Any
    stiffness: Any

    def matrix(self) -> sparse.csr_array:
        """Return M (n, n); dense if the stiffness is not diagonal."""
        diagonal = self.stiffness.diagonal()
        if self.stiffness.nnz == len(diagonal):
            return sparse.csr_array(self.spread @ sparse.diags_array(1 / diagonal) @ self.spread.T)
        between = scipy.sparse.linalg.splu(self.stiffness.tocsc())
        return sparse.csr_array(self.spread @ between.solve(self.spread.T.toarray()))

    def inverse(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function v (n,) -> M^{-1} v, by one sparse factorisation.

        M^{-1} v = lambda with stiffness y = spread' lambda and spread y = v.
        """
        corner = sparse.csc_array((self.spread.shape[0],) * 2)
        rows = [[self.stiffness, -self.spread.T], [self.spread, corner]]
        solver = scipy.sparse.linalg.splu(sparse.block_array(rows, format="csc"))
        nodes = np.zeros(self.stiffness.shape[0])
        return lambda v: solver.solve(np.concatenate([nodes, v]))[len(nodes) :]


@dataclass(frozen=True, kw_only=True, eq=False)
class Wires:
    """Wires of a preconditioner in addition to the neighbour wiring.

    Attributes
    ----------
    weights : (n, nodes) sparse array
        Weight of the wire between a neuron and a node of the preconditioner. If the nodes are
        neurons, as in a resistive grid or in cyclic reduction, the shape is (n, n).
    nodes : int
        Number of nodes in addition to the neurons; 0 by default.
    both_ways : bool
        True if each wire exists twice, to the node and back; False by default.
    """

    weights: Any
    nodes: int = 0
    both_ways: bool = False

    @property
    def count(self) -> int:
        """Number of wires in each direction."""
        return int(self.weights.count_nonzero())

    def per_cell(self, stages: int) -> float:
        """Return the number of wires per cell in each direction."""
        return self.count / stages


Clamp: TypeAlias = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Map of net inputs d (..., n) to state derivatives and currents, (..., n) each.

Derivatives = M (d + currents). Derivatives are zero for saturated neurons, currents for all others.
"""


class Preconditioner(ABC):
    """Preconditioner; the module docstring gives its properties."""

    @property
    @abstractmethod
    def kind(self) -> PreconditionerKind:
        """Kind of the preconditioner."""

    @abstractmethod
    def check(self, row: ArrayLayout) -> None:
        """Check that the preconditioner fits a cell array.

        Raises `NetworkError` with the given and the expected sizes.
        """

    @abstractmethod
    def apply(self, row: ArrayLayout, drives: np.ndarray) -> np.ndarray:
        """Return M d (..., P, N) for net inputs (..., P, N), zero without a neuron."""

    def derivatives(self, row: ArrayLayout, drives: np.ndarray) -> np.ndarray:
        """Return M d for net inputs (..., n) over the components of a state vector."""
        table = np.zeros((*drives.shape[:-1], *row.rates.shape), drives.dtype)
        neuron, stage = row.places
        table[..., neuron, stage] = drives
        return self.apply(row, table)[..., neuron, stage]

    def clamp(self, row: ArrayLayout, held: np.ndarray) -> Clamp:
        """Return the map from net inputs to state derivatives, and currents, for saturated neurons.

        ``held`` (n,) is True for saturated neurons. The current of a saturated neuron, that of an
        ideal diode at its limit, makes its derivative zero and spreads like a net input. The
        derivatives of the others are argmin 1/2 v' M^{-1} v - d'v over all v that are zero at
        saturated neurons. The matrix is factored once.
        """
        if not held.any():
            return lambda drives: (self.derivatives(row, drives), np.zeros_like(drives))
        within = scipy.linalg.cho_factor(self.derivatives(row, np.eye(len(held))[held])[:, held])

        def clamped(drives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            pull, currents = self.derivatives(row, drives)[..., held], np.zeros_like(drives)
            columns = pull.reshape(-1, pull.shape[-1]).T
            found = scipy.linalg.cho_solve(within, columns, check_finite=False)
            currents[..., held] = -found.T.reshape(pull.shape)
            return np.where(held, 0.0, self.derivatives(row, drives + currents)), currents

        return clamped

    def among(self, row: ArrayLayout, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function M d of net inputs (..., n) for saturated neurons.

        Saturated neurons that the preconditioner does not couple have no effect on others; their
        derivatives follow their net inputs. ``held`` (n,) is True for saturated neurons.
        """
        held = held & self.reach(row)[row.places[0]]
        if not held.any():
            return lambda drives: self.derivatives(row, drives)
        clamp = self.clamp(row, held)
        return lambda drives: clamp(drives)[0]

    @abstractmethod
    def factors(self, row: ArrayLayout) -> Factors:
        """Return M as sparse factors with O(N) or O(N log N) entries."""

    def inverse(self, row: ArrayLayout) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function v (n,) -> M^{-1} v, by one sparse factorisation."""
        return self.factors(row).inverse()

    @abstractmethod
    def wires(self, row: ArrayLayout) -> Wires:
        """Return the wires in addition to the neighbour wiring."""

    @abstractmethod
    def reach(self, row: ArrayLayout) -> np.ndarray:
        """Return (P,) booleans: True for neurons that net inputs of other neurons move.

        For the other neurons M d = d / tau.
        """
