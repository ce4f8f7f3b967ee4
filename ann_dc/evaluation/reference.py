"""A network's evaluation in NumPy: the reference for every other evaluator."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse

from ann_dc.evaluation.tape import BY_VALUE, BY_WEIGHT, PRODUCT, SUM, Tape, build_tape
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network


def evaluator(network: Network) -> ReferenceEvaluator:
    """The reference evaluator of a network; made once, and kept as long as the network itself.

    Examples
    --------
    >>> from ann_dc.network.cell import Cell, Connection, Neuron
    >>> decay = Connection(source="x", target="x", weight=-2.0)
    >>> row = Network(stages=2, cell=Cell(neurons=(Neuron(name="x"),), connections=(decay,)))
    >>> evaluator(row).rhs([1.0, 3.0]).tolist()
    [-2.0, -6.0]
    """
    kept = vars(network)  # beside the cached properties of the record
    if _KEPT not in kept:
        kept[_KEPT] = ReferenceEvaluator(network)
    return kept[_KEPT]


_KEPT = "_reference_evaluator"


class ReferenceEvaluator:
    """Evaluator of one network; arrays may carry leading batch axes and be complex."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.tape, self.edges = build_tape(network)

    # ---- values ------------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values (..., nodes, N + 2) of every node at a state vector (..., n)."""
        tape = self.tape
        x = np.asarray(x)
        values = np.empty((*x.shape[:-1], *tape.values.shape), x.dtype)
        values[...] = tape.values
        values[..., tape.places[:, 0], tape.places[:, 1] + 1] = x
        for kind, node, a, b in tape.blocks:
            if kind == SUM:
                values[..., node, 1:-1] = self._arriving(values, a, b)
            elif kind == PRODUCT:
                values[..., node, 1:-1] = values[..., a, 1:-1] * values[..., b, 1:-1]
            else:
                values[..., node, 1:-1] = FUNCTIONS[a].value(values[..., b, 1:-1])
        return values

    def _arriving(self, values: np.ndarray, first: int, last: int) -> np.ndarray:
        stages = self.network.stages
        total = np.zeros((*values.shape[:-2], stages), values.dtype)
        for edge in range(first, last):
            source, offset = self.tape.sources[edge]
            total += self.tape.weights[edge] * values[..., source, 1 + offset : 1 + offset + stages]
        return total

    def node(self, x: np.ndarray, name: str) -> np.ndarray:
        """Values (..., N) of one node, by name."""
        return self.values(np.asarray(x, float))[..., self.network.node_index[name], 1:-1]

    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (..., neurons, N); zero where it is pinned or absent."""
        values = self.values(x)
        arriving = np.stack(
            [self._arriving(values, first, last) for first, last in self.tape.drives], axis=-2
        )
        state = np.real(values[..., : len(self.tape.drives), 1:-1])
        low, high = self.tape.limits.T[:, :, None]
        drive = np.real(arriving)
        stopped = ((state <= low) & (drive < 0)) | ((state >= high) & (drive > 0))
        return np.where(stopped | ~self.network.live, 0, arriving)

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (..., n) = drive / tau + what the coordinators add."""
        x = _state(x)
        drives = self.drives(x)
        moves = drives * self.tape.rates
        coordinators = self.network.coordinators
        if coordinators is not None:
            q, t = self.tape.chains.T
            chain = np.stack([drives[..., q, :], drives[..., t, :]], axis=-1)
            added = coordinators.apply(chain.reshape(*chain.shape[:-2], -1))
            moves[..., q, :] += added[..., 0::2]
            moves[..., t, :] += added[..., 1::2]
        return self._stopped_at_rails(x, self.network.pack(moves))

    def _stopped_at_rails(self, x: np.ndarray, moves: np.ndarray) -> np.ndarray:
        """Moves (..., n) without those that coordinators would push past a rail."""
        low, high = self.tape.limits[self.tape.places[:, 0]].T
        state, move = np.real(x), np.real(moves)
        stopped = ((state <= low) & (move < 0)) | ((state >= high) & (move > 0))
        return np.where(stopped, 0, moves)

    # ---- derivatives -------------------------------------------------------------------------

    def slot_values(self, x: np.ndarray) -> np.ndarray:
        """Derivatives (slots, N + 2) at one state vector (n,)."""
        values, tape, stages = self.values(x), self.tape, self.network.stages
        slots = tape.slot_start.astype(values.dtype)
        for target, source, offset, kind, index in tape.slots:
            if kind == BY_WEIGHT:
                factor = tape.weights[index]
            elif kind == BY_VALUE:
                factor = values[index, 1:-1]
            else:
                _, node, code, argument = tape.blocks[index]
                factor = FUNCTIONS[code].slope(values[argument, 1:-1], values[node, 1:-1])
            slots[target, 1:-1] += factor * slots[source, 1 + offset : 1 + offset + stages]
        return slots

    def drive_jacobian(self, x: np.ndarray) -> Any:
        """d drive / dx as a sparse (n, n) matrix, block tridiagonal by stage.

        The row of a neuron that is stopped at a rail is zero.
        """
        slots = self.slot_values(np.asarray(x))
        entries = slots[self.tape.entries[:, 2], self.tape.entries[:, 3] + 1]
        stopped = self.stopped(x, self.drives(x))
        return self.sparse(np.where(stopped[self.tape.entries[:, 0]], 0, entries))

    def stopped(self, x: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """(n,) booleans: which neurons stand at a rail with their drive cut off."""
        low, high = self.tape.limits[self.tape.places[:, 0]].T
        state = np.real(x)
        return ((state <= low) | (state >= high)) & (self.network.pack(drives) == 0)

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray]:
        rows = self.tape.entries[:, 0]
        pointers = np.searchsorted(rows, np.arange(self.network.size + 1))
        return self.tape.entries[:, 1].astype(np.int32), pointers.astype(np.int32)

    def sparse(self, data: np.ndarray) -> Any:
        """Entries of the drive Jacobian, in the order of ``tape.entries``, as a matrix."""
        n = self.network.size
        return sparse.csr_array((data, *self._pattern), shape=(n, n))

    @cached_property
    def metric(self) -> Any:
        """M of dx/ds = M drive (n, n): diag(1/tau) plus the coordinators, symmetric positive."""
        network = self.network
        diagonal = sparse.diags_array(network.pack(self.tape.rates))
        if network.coordinators is None:
            return diagonal.tocsr()
        component = network.state_index
        rows = np.stack([component[self.tape.chains[:, 0]], component[self.tape.chains[:, 1]]], -1)
        rows = rows.reshape(-1)
        dense = network.coordinators.metric(2 * network.stages)
        dense = dense[np.ix_(rows >= 0, rows >= 0)]
        where = rows[rows >= 0]
        i, j = np.nonzero(dense)
        added = sparse.coo_array((dense[i, j], (where[i], where[j])), shape=diagonal.shape)
        return sparse.csr_array(diagonal + added)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """d rhs / dx, dense (n, n): the fixed metric times the block-tridiagonal drive Jacobian."""
        return (self.metric @ self.drive_jacobian(_state(x))).toarray()


def _state(x) -> np.ndarray:
    """A state as floating-point (or complex) numbers."""
    return np.asarray(x, dtype=np.result_type(np.asarray(x), float))


def tape_with_penalty(network: Network, rho: np.ndarray | float) -> Tape:
    """The network's tape with other rho: (P,), or one number for all PI duals."""
    tape, weights = evaluator(network).tape, evaluator(network).tape.weights.copy()
    rho = np.broadcast_to(rho, len(network.cell.neurons))
    for dual in network.cell.duals:
        if dual.path in evaluator(network).edges:
            weights[evaluator(network).edges[dual.path]] = rho[network.neuron_index[dual.neuron]]
    return tape._replace(weights=weights)
