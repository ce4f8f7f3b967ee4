"""Network in the form of flat arrays that every evaluator reads.

The nodes have one order: neurons, inputs, the constant one, then the blocks. The values of all
nodes form an array (nodes, N + 2): one column per stage, and one column at either end for the
values that a neighbour beyond the end of the row would have. A node is evaluated at all stages
before the next node, so the stage axis is the inner loop.

The Jacobian is computed from the same list in forward mode. A *slot* is the derivative of one node
by one neuron of the same or a nearby cell, at all stages. The wiring determines which slots exist.
Therefore the Jacobian of an optimiser is block tridiagonal.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.preconditioner_arrays import preconditioner_arrays
from ann_dc.evaluation.rules import DUAL, POSITION, PRIMAL, STATE
from ann_dc.network.cell import ONE, Connection, Product, Role, Sum
from ann_dc.network.functions import CODE
from ann_dc.network.network import Network

SUM, PRODUCT, FUNCTION = 0, 1, 2
BY_WEIGHT, BY_VALUE, BY_SLOPE = 0, 1, 2


@lru_cache(maxsize=256)
def reading(offset: int, stages: int) -> tuple[slice, slice]:
    """Return the stages (of N) that a connection feeds and the columns (of N + 2) that it reads.

    The offset counts stages from the target to the source. The outer columns contain the values of
    a neighbour beyond the end of the row; sources further outside do not exist.
    """
    offset, stages = int(offset), int(stages)  # equal keys of any type share what is kept
    first = min(max(0, -1 - offset), stages)
    last = max(min(stages, stages + 1 - offset), first)
    return slice(first, last), slice(first + 1 + offset, last + 1 + offset)


class Tape(NamedTuple):
    """Arrays that evaluators read; P neurons, E connections, B blocks, n live neurons."""

    blocks: np.ndarray
    """Blocks (B, 4): kind, node, then (first, last) connection, (a, b) or (function code, x)."""
    drives: np.ndarray
    """First and last connection of every neuron (P, 2)."""
    sources: np.ndarray
    """Source node and template offset of every connection (E, 2)."""
    weights: np.ndarray
    """Connection weights (E, N)."""
    rates: np.ndarray
    """Rates 1 / tau (P, N), zero for pinned and absent neurons."""
    limits: np.ndarray
    """Saturation limits (P, 2)."""
    roles: np.ndarray
    """Roles (P,): `PRIMAL`, `DUAL` or `STATE`; `POSITION` for a primal neuron of a chain (q or t).
    """
    places: np.ndarray
    """Neuron and stage of the components of the state vector (n, 2)."""
    shared: np.ndarray
    """Rows (S,) of the neurons shared by all cells, stored in the last cell."""
    values: np.ndarray
    """Initial values (nodes, N + 2): inputs, pins, ends and the constant one; zero elsewhere."""
    slots: np.ndarray
    """Slot operations (operations, 5): target slot, source slot, offset, kind and index of the
    factor.
    """
    entries: np.ndarray
    """Row, column, slot and stage of every Jacobian entry (nnz, 4), sorted by row."""
    slot_start: np.ndarray
    """Initial slots (slots, N + 2): one if a slot is the derivative of a neuron by itself, else
    zero.
    """
    chains: np.ndarray
    """Rows of the (q, t) neurons under a pyramid (C, 2); empty without a pyramid."""
    grids: np.ndarray
    """Multilevel gains (grid points of all levels, C, C), finest level first."""
    grid_starts: np.ndarray
    """First row of each level in ``grids`` (levels + 1,)."""
    hats: np.ndarray
    """Left grid points on the finest level (2N,)."""
    shares: np.ndarray
    """Interpolation weights of the right grid points (2N,)."""
    coupled: np.ndarray
    """Neuron, stage and start in ``factor`` of the neurons that a stiffness couples (S + 1, 3).
    Rows have elimination order; the last row marks the end.
    """
    factor: np.ndarray
    """Lower triangular K of K K' = M^{-1} over the coupled neurons (entries,), row by row.

    The last entry of a row is the reciprocal of the diagonal.
    """
    factor_columns: np.ndarray
    """Column of each entry of ``factor`` (entries,)."""
    stiff: np.ndarray
    """M^{-1} over the coupled neurons in bands (S, w): w - 1 entries before the diagonal, then the
    diagonal.
    """
    reached: np.ndarray
    """Rows (R,) of the neurons that the preconditioner couples to others."""


def build_tape(network: Network) -> tuple[Tape, dict[str, int]]:
    """Return the tape of a network and the ``weights`` row of each named connection.

    Raises `NetworkError` if the preconditioner does not fit the network. The same error is raised
    if the net input of a shared neuron depends on another shared neuron outside its cell.
    """
    nodes = network.node_index
    cell, stages = network.cell, network.stages
    arriving: dict[str, list[Connection]] = {}
    for connection in cell.connections:
        arriving.setdefault(connection.target, []).append(connection)
    edges: list[Connection] = []

    def span(target: str) -> tuple[int, int]:
        first = len(edges)
        edges.extend(arriving.get(target, ()))
        return first, len(edges)

    blocks = []
    for block in cell.blocks:
        if isinstance(block, Sum):
            blocks.append((SUM, nodes[block.name], *span(block.name)))
        elif isinstance(block, Product):
            blocks.append((PRODUCT, nodes[block.name], nodes[block.a], nodes[block.b]))
        else:
            blocks.append((FUNCTION, nodes[block.name], CODE[block.function], nodes[block.x]))
    drives = [span(neuron.name) for neuron in cell.neurons]
    sources = _integers([(nodes[e.source], int(e.template)) for e in edges], 2)
    blocks, drives = _integers(blocks, 4), _integers(drives, 2)
    slots = _slots(blocks, drives, sources, network, len(nodes))
    weights = _rows([e.weight for e in edges], stages)
    for row in np.flatnonzero(sources[:, 0] == nodes[ONE]):  # a constant, which knows no ends
        weights[row, _unread(sources[row, 1], stages)] = 0.0
    _check_buses(slots, drives, sources, weights, network)
    tape = Tape(
        blocks=blocks,
        drives=drives,
        sources=sources,
        weights=weights,
        rates=network.layout.rates,
        limits=np.array([(n.limiter.low, n.limiter.high) for n in cell.neurons], float),
        roles=_roles(network),
        places=np.ascontiguousarray(network.places, np.int64),
        shared=network.shared,
        values=constant_values(network),
        slots=_integers(slots.operations, 5),
        slot_start=slots.start(),
        entries=_entries(slots.drives, network),
        **preconditioner_arrays(network.preconditioner, network.layout),
    )
    return tape, {edge.name: row for row, edge in enumerate(edges)}


def _unread(offset: int, stages: int) -> np.ndarray:
    """Return a mask (N,) of the stages for which a connection has no source."""
    mask = np.ones(stages, bool)
    mask[reading(offset, stages)[0]] = False
    return mask


def _integers(rows: list, width: int) -> np.ndarray:
    return np.array(rows, np.int64).reshape(-1, width)


def _rows(values: list, stages: int) -> np.ndarray:
    rows = [np.broadcast_to(np.asarray(v, float), (stages,)) for v in values]
    return np.array(rows, float).reshape(-1, stages)


def _roles(network: Network) -> np.ndarray:
    codes = {Role.STATE: STATE, Role.PRIMAL: PRIMAL, Role.DUAL: DUAL}
    roles = np.array([codes[neuron.role] for neuron in network.cell.neurons], np.int64)
    roles[network.chain_rows.ravel()] = POSITION
    return roles


def constant_values(network: Network) -> np.ndarray:
    """Return the constant node values (nodes, N + 2), zero for all other nodes.

    Constant values are inputs, pins, ends and the constant one. No other part of a tape depends on
    the inputs.
    """
    nodes = network.node_index
    values = np.zeros((len(nodes), network.stages + 2))
    values[nodes[ONE]] = 1.0
    for name in network.cell.inputs:
        values[nodes[name], 1:-1] = network.input_values[name]
    for pin in network.fixed:
        values[nodes[pin.neuron], pin.stage + 1] = network.input_values[pin.input][pin.stage]
    for node, source in network.left_boundary.items():
        values[nodes[node], 0] = network.input_values[source][0]
    return values


class _Slots:
    """Existing derivatives and the ordered operations that compute them."""

    def __init__(self, network: Network, nodes: int) -> None:
        self.network, self.shared = network, set(network.shared.tolist())
        self.neurons = len(network.cell.neurons)
        self.operations: list[tuple[int, int, int, int, int]] = []
        self.count = self.neurons
        self.nodes: list[dict[tuple[int, int], int]] = [{} for _ in range(nodes)]
        self.drives: list[dict[tuple[int, int], int]] = [{} for _ in range(self.neurons)]
        for row in range(self.neurons):
            self.nodes[row][row, 0] = row

    def add(self, target: dict, source: int, offset: int, kind: int, index: int) -> None:
        """Add d(target) += factor * d(source) for all derivatives of the source."""
        for (neuron, place), slot in self.nodes[source].items():
            key = neuron, 0 if neuron in self.shared else place + offset
            if key not in target:
                target[key] = self.count
                self.count += 1
            self.operations.append((target[key], slot, offset, kind, index))

    def add_edges(self, target: dict, sources: np.ndarray, first: int, last: int) -> None:
        """Add the operations of the connections of a sum or neuron."""
        for edge in range(first, last):
            self.add(target, sources[edge, 0], sources[edge, 1], BY_WEIGHT, edge)

    def start(self) -> np.ndarray:
        """Return the initial slots (slots, N + 2), with ones for a neuron by itself."""
        start = np.zeros((self.count, self.network.stages + 2))
        start[: self.neurons, 1:-1] = 1.0
        return start


def _slots(blocks, drives, sources, network: Network, nodes: int) -> _Slots:
    slots = _Slots(network, nodes)
    for order, (kind, node, a, b) in enumerate(blocks):
        target = slots.nodes[node]
        if kind == SUM:
            slots.add_edges(target, sources, a, b)
        elif kind == PRODUCT:
            slots.add(target, a, 0, BY_VALUE, b)
            slots.add(target, b, 0, BY_VALUE, a)
        else:
            slots.add(target, b, 0, BY_SLOPE, order)
    for row, (first, last) in enumerate(drives):
        slots.add_edges(slots.drives[row], sources, first, last)
    return slots


def _check_buses(slots: _Slots, drives, sources, weights, network: Network) -> None:
    """Check that the net input of a shared neuron has one derivative per neuron.

    The neuron reads other shared neurons in its cell only, and no node that depends on neighbouring
    cells.
    """
    for row in network.shared.tolist():
        first, last = drives[row]
        elsewhere = np.any(weights[first:last, :-1], axis=1)
        for (source, _), is_summed in zip(sources[first:last].tolist(), elsewhere.tolist()):
            on_bus = any(neuron in slots.shared for neuron, _ in slots.nodes[source])
            if (is_summed and on_bus) or any(place for _, place in slots.nodes[source]):
                name = network.cell.neurons[row].name
                raise NetworkError(
                    f"{name}: the inputs from all cells may depend on neurons of the same cell "
                    "only, or on shared neurons in the last cell"
                )


def _entries(columns, network: Network) -> np.ndarray:
    stages, component = network.stages, network.state_index
    known = [
        (row, *place, slot) for row, slots in enumerate(columns) for place, slot in slots.items()
    ]
    neuron, source, offset, slot = _integers(known, 4).T[:, :, None]
    k = np.arange(stages)
    read = k + offset
    inside = (read >= 0) & (read < stages)
    r, c = component[neuron, k], component[source, np.where(inside, read, 0)]
    own = ~np.isin(neuron, network.shared) | ~np.isin(source, network.shared) | (k == stages - 1)
    alive = inside & (r >= 0) & (c >= 0) & own
    k, slot = np.broadcast_to(k, alive.shape), np.broadcast_to(slot, alive.shape)
    table = np.column_stack([part[alive] for part in (r, c, slot, k)])
    return np.ascontiguousarray(table[np.lexsort((table[:, 1], table[:, 0]))])
