"""A network flattened into the arrays that every evaluator reads.

The nodes stand in one order: neurons, inputs, the constant one, then the blocks. The values of all
nodes form an array (nodes, N + 2): one column a stage, and one on either side for what a
neighbour beyond the end of the row would say. A node is evaluated at all stages before the next
one, so that the stage axis is the inner loop.

The Jacobian comes from the same list in forward mode. A *slot* is the derivative of one node by
one neuron of its own or a nearby cell, at all stages; which slots exist follows from the wiring,
and with it that the Jacobian of an optimiser is block tridiagonal.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.metric_arrays import metric_arrays
from ann_dc.network.cell import ONE, Connection, Product, Role, Sum
from ann_dc.network.functions import CODE
from ann_dc.network.network import Network

SUM, PRODUCT, FUNCTION = 0, 1, 2
BY_WEIGHT, BY_VALUE, BY_SLOPE = 0, 1, 2
STATE, PRIMAL, POSITION, DUAL = 0, 1, 2, 3


@lru_cache(maxsize=256)
def reading(offset: int, stages: int) -> tuple[slice, slice]:
    """Which stages a connection brings something to, and the columns (of N + 2) that it reads.

    A neighbour's end of the row lies in the outer columns; further out there is nothing.

    Parameters
    ----------
    offset : int
        From the target to the source, in stages.
    stages : int
        N.

    Examples
    --------
    >>> reading(-1, 4), reading(-3, 4)
    ((slice(0, 4, None), slice(0, 4, None)), (slice(2, 4, None), slice(0, 2, None)))
    """
    offset, stages = int(offset), int(stages)  # equal keys of any type share what is kept
    first = min(max(0, -1 - offset), stages)
    last = max(min(stages, stages + 1 - offset), first)
    return slice(first, last), slice(first + 1 + offset, last + 1 + offset)


class Tape(NamedTuple):
    """The arrays that evaluators read; P neurons, E connections, B blocks, n live neurons."""

    blocks: np.ndarray
    """(B, 4): kind, node, then (first, last) connection, (a, b) or (function code, x)."""
    drives: np.ndarray
    """(P, 2): first and last connection of every neuron."""
    sources: np.ndarray
    """(E, 2): source node and template offset."""
    weights: np.ndarray
    """(E, N)."""
    rates: np.ndarray
    """(P, N): 1 / tau, zero where a neuron is pinned or absent."""
    limits: np.ndarray
    """(P, 2): rails."""
    roles: np.ndarray
    """(P,): `PRIMAL`, `DUAL` or `STATE`; `POSITION` for a primal neuron of a chain (q or t)."""
    places: np.ndarray
    """(n, 2): neuron and stage of the components of the state vector."""
    shared: np.ndarray
    """(S,): rows of the neurons that all cells share, which live in the last one."""
    values: np.ndarray
    """(nodes, N + 2): inputs, pins, ends and the constant one filled in, the rest zero."""
    slots: np.ndarray
    """(operations, 5): target slot, source slot, offset, kind and index of the factor."""
    entries: np.ndarray
    """(nnz, 4): row, column, slot and stage of every entry of the Jacobian, by row."""
    slot_start: np.ndarray
    """(slots, N + 2): ones where a slot is a neuron by itself, zero elsewhere."""
    chains: np.ndarray
    """(C, 2): rows of the (q, t) neurons under a pyramid; empty where there is none."""
    grids: np.ndarray
    """(grid points of all levels, C, C), finest level first."""
    grid_starts: np.ndarray
    """(levels + 1,): where each level starts in ``grids``."""
    hats: np.ndarray
    """(2N,): grid point to the left on the finest level."""
    shares: np.ndarray
    """(2N,): share of the grid point to the right."""
    coupled: np.ndarray
    """(S + 1, 3): neuron and stage of those that a stiffness couples, in the order of elimination,
    and where their rows of ``factor`` start; the last row is the end."""
    factor: np.ndarray
    """(entries,): K of K K' = M^{-1} over them, lower triangular, row by row; at the end of a row
    one over its diagonal."""
    factor_columns: np.ndarray
    """(entries,): column of each."""
    stiff: np.ndarray
    """(S, w): M^{-1} over them in bands, row by row: w - 1 entries before the diagonal and it."""
    reached: np.ndarray
    """(R,): rows of the neurons that the metric couples to others."""


def build_tape(network: Network) -> tuple[Tape, dict[str, int]]:
    """The tape of a network, and where its connections are.

    Parameters
    ----------
    network : Network

    Returns
    -------
    tape : Tape
    edges : dict of str to int
        Row of every connection in ``weights``, by name.

    Raises
    ------
    NetworkError
        If the metric does not fit the network, or the drive of a shared neuron depends on another
        one outside its own cell.
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
    _check_buses(slots, drives, sources, weights, network)
    tape = Tape(
        blocks=blocks,
        drives=drives,
        sources=sources,
        weights=weights,
        rates=network.row.rates,
        limits=np.array([(n.limiter.low, n.limiter.high) for n in cell.neurons], float),
        roles=_roles(network),
        places=np.ascontiguousarray(network.places, np.int64),
        shared=network.shared,
        values=constant_values(network),
        slots=_integers(slots.operations, 5),
        slot_start=slots.start(),
        entries=_entries(slots.drives, network),
        **metric_arrays(network.metric, network.row),
    )
    return tape, {edge.name: row for row, edge in enumerate(edges)}


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
    """(nodes, N + 2): inputs, pins, ends and the constant one filled in, the rest zero.

    The only part of a tape that other inputs change.

    Parameters
    ----------
    network : Network
    """
    nodes = network.node_index
    values = np.zeros((len(nodes), network.stages + 2))
    values[nodes[ONE]] = 1.0
    for name in network.cell.inputs:
        values[nodes[name], 1:-1] = network.input_values[name]
    for pin in network.pins:
        values[nodes[pin.neuron], pin.stage + 1] = network.input_values[pin.input][pin.stage]
    for node, source in network.left.items():
        values[nodes[node], 0] = network.input_values[source][0]
    return values


class _Slots:
    """Which derivatives exist, and the operations that compute them in order."""

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
        """d(target) += factor * d(source), for every derivative that the source has."""
        for (neuron, place), slot in self.nodes[source].items():
            key = neuron, 0 if neuron in self.shared else place + offset
            if key not in target:
                target[key] = self.count
                self.count += 1
            self.operations.append((target[key], slot, offset, kind, index))

    def add_edges(self, target: dict, sources: np.ndarray, first: int, last: int) -> None:
        """What connections add to a sum or a neuron."""
        for edge in range(first, last):
            self.add(target, sources[edge, 0], sources[edge, 1], BY_WEIGHT, edge)

    def start(self) -> np.ndarray:
        """(slots, N + 2): a neuron's derivative by itself is one."""
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
    """What a shared neuron adds up has one derivative by every other neuron.

    Another shared one it reads in its own cell, and of no cell what that has of its neighbours.
    """
    for row in network.shared.tolist():
        first, last = drives[row]
        elsewhere = np.any(weights[first:last, :-1], axis=1)
        for (source, _), is_summed in zip(sources[first:last].tolist(), elsewhere.tolist()):
            on_bus = any(neuron in slots.shared for neuron, _ in slots.nodes[source])
            if (is_summed and on_bus) or any(place for _, place in slots.nodes[source]):
                name = network.cell.neurons[row].name
                raise NetworkError(
                    f"{name}: what all cells send to it may depend on their own neurons, and on "
                    "those that they share in the last cell only"
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
