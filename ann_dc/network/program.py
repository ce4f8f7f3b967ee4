"""A network flattened into arrays, and its evaluation in NumPy.

Every evaluator reads the same ordered list of nodes: neurons, inputs, the constant one, then the
blocks. The values of all nodes form an array (nodes, N + 2): one column a stage, and one
on either side for what a neighbour beyond the end of the row would say. A node is evaluated at
all stages before the next one, so that the stage axis is the inner loop.

The Jacobian comes from the same list in forward mode. A *slot* is the derivative of one node by
one neuron in its own, the previous or the next cell, at all stages; which slots exist follows
from the wiring, and with it that the Jacobian is block tridiagonal.
"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import sparse

from ann_dc.errors import NetworkError
from ann_dc.network.cell import ONE, Connection, Product, Role, Sum
from ann_dc.network.coordinators import Coordinators, chain_rows
from ann_dc.network.functions import CODE, FUNCTIONS

if TYPE_CHECKING:
    from ann_dc.network.network import Network

SUM, PRODUCT, FUNCTION = 0, 1, 2
BY_WEIGHT, BY_VALUE, BY_SLOPE = 0, 1, 2
STATE, PRIMAL, POSITION, DUAL = 0, 1, 2, 3


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
    values: np.ndarray
    """(nodes, N + 2): inputs, pins, ends and the constant one filled in, the rest zero."""
    slots: np.ndarray
    """(operations, 5): target slot, source slot, offset, kind and index of the factor."""
    entries: np.ndarray
    """(nnz, 4): row, column, slot and stage of every entry of the Jacobian, by row."""
    slot_start: np.ndarray
    """(slots, N + 2): ones where a slot is a neuron by itself, zero elsewhere."""
    chains: np.ndarray
    """(C, 2): rows of the (q, t) neurons under the coordinators; empty without any."""
    grids: np.ndarray
    """(grid points of all levels, C, C), finest level first."""
    levels: np.ndarray
    """(levels + 1,): where each level starts in ``grids``."""
    hats: np.ndarray
    """(2N,): grid point to the left on the finest level."""
    shares: np.ndarray
    """(2N,): share of the grid point to the right."""


class Program:
    """Evaluator of one network; arrays may carry leading batch axes and be complex."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self.nodes = _node_rows(network)
        self.tape, self.edges = _tape(network, self.nodes)

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
        return self.values(np.asarray(x, float))[..., self.nodes[name], 1:-1]

    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (..., neurons, N); zero where it is pinned or absent."""
        values = self.values(x)
        arriving = np.stack(
            [self._arriving(values, first, last) for first, last in self.tape.drives], axis=-2
        )
        state = values[..., : len(self.tape.drives), 1:-1].real
        low, high = self.tape.limits.T[:, :, None]
        stopped = ((state <= low) & (arriving.real < 0)) | ((state >= high) & (arriving.real > 0))
        return np.where(stopped | ~self.network.live, 0, arriving)

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (..., n) = drive / tau + what the coordinators add."""
        drives = self.drives(x)
        moves = drives * self.tape.rates
        coordinators = self.network.coordinators
        if coordinators is not None:
            q, t = self.tape.chains.T
            chain = np.stack([drives[..., q, :], drives[..., t, :]], axis=-1)
            added = coordinators.apply(chain.reshape(*chain.shape[:-2], -1))
            moves[..., q, :] += added[..., 0::2]
            moves[..., t, :] += added[..., 1::2]
        return self.network.pack(moves)

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

    def drive_jacobian(self, x: np.ndarray) -> sparse.csr_array:
        """d drive / dx as a sparse (n, n) matrix, block tridiagonal by stage."""
        slots = self.slot_values(np.asarray(x))
        return self.sparse(slots[self.tape.entries[:, 2], self.tape.entries[:, 3] + 1])

    @cached_property
    def _pattern(self) -> tuple[np.ndarray, np.ndarray]:
        rows = self.tape.entries[:, 0]
        pointers = np.searchsorted(rows, np.arange(self.network.size + 1))
        return self.tape.entries[:, 1].astype(np.int32), pointers.astype(np.int32)

    def sparse(self, data: np.ndarray) -> sparse.csr_array:
        """Entries of the drive Jacobian, in the order of ``tape.entries``, as a matrix."""
        n = self.network.size
        return sparse.csr_array((data, *self._pattern), shape=(n, n))

    @cached_property
    def metric(self) -> sparse.csr_array:
        """M of dx/ds = M drive (n, n): diag(1/tau) plus the coordinators, symmetric positive."""
        network = self.network
        diagonal = sparse.diags_array(network.pack(self.tape.rates))
        if network.coordinators is None:
            return diagonal.tocsr()
        component = -np.ones(network.live.shape, int)
        component[network.places[:, 0], network.places[:, 1]] = np.arange(network.size)
        rows = np.stack([component[self.tape.chains[:, 0]], component[self.tape.chains[:, 1]]], -1)
        rows = rows.reshape(-1)
        dense = network.coordinators.metric(2 * network.stages)
        dense = dense[np.ix_(rows >= 0, rows >= 0)]
        where = rows[rows >= 0]
        i, j = np.nonzero(dense)
        added = sparse.coo_array((dense[i, j], (where[i], where[j])), shape=diagonal.shape)
        return sparse.csr_array(diagonal + added)

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """d rhs / dx, dense (n, n): the fixed metric times the block-tridiagonal drive Jacobian.

        A neuron at a rail contributes no row (its drive is cut off).
        """
        jacobian = self.drive_jacobian(x)
        if np.isfinite(self.tape.limits).any():
            state = np.asarray(x).real
            low, high = self.tape.limits[self.tape.places[:, 0]].T
            free = (state > low) & (state < high)
            jacobian = sparse.csr_array(jacobian * free[:, None])
        return (self.metric @ jacobian).toarray()


# ---- building the tape -----------------------------------------------------------------------


def _node_rows(network: Network) -> dict[str, int]:
    cell = network.cell
    names = [*(n.name for n in cell.neurons), *cell.inputs, ONE, *(b.name for b in cell.blocks)]
    return {name: row for row, name in enumerate(names)}


def _tape(network: Network, nodes: dict[str, int]) -> tuple[Tape, dict[str, int]]:
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
    slots, slot_start, columns = _slots(blocks, drives, sources, network, len(nodes))
    tape = Tape(
        blocks=blocks,
        drives=drives,
        sources=sources,
        weights=_rows([e.weight for e in edges], stages),
        rates=np.where(network.live, 1.0 / _rows([n.tau for n in cell.neurons], stages), 0.0),
        limits=np.array([(n.limiter.low, n.limiter.high) for n in cell.neurons], float),
        roles=_roles(network),
        places=np.ascontiguousarray(network.places, np.int64),
        values=_constants(network, nodes),
        slots=slots,
        slot_start=slot_start,
        entries=_entries(columns, network),
        **pyramid_arrays(network, network.coordinators),
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
    roles[chain_rows(network).ravel()] = POSITION
    return roles


def _constants(network: Network, nodes: dict[str, int]) -> np.ndarray:
    values = np.zeros((len(nodes), network.stages + 2))
    values[nodes[ONE]] = 1.0
    for name in network.cell.inputs:
        values[nodes[name], 1:-1] = network.inputs[name]
    for pin in network.pins:
        values[nodes[pin.neuron], pin.stage + 1] = network.inputs[pin.input][pin.stage]
    for node, source in network.left.items():
        values[nodes[node], 0] = network.inputs[source][0]
    return values


def _slots(blocks, drives, sources, network: Network, nodes: int):
    """Which derivatives exist, and the operations that compute them in order."""
    table: list[dict[tuple[int, int], int]] = [{} for _ in range(nodes)]
    operations: list[tuple[int, int, int, int, int]] = []
    starts: list[bool] = []

    def new(is_neuron: bool = False) -> int:
        starts.append(is_neuron)
        return len(starts) - 1

    def accumulate(target, source: int, offset: int, kind: int, index: int) -> None:
        for (neuron, place), slot in table[source].items():
            key = (neuron, place + offset)
            if abs(key[1]) > 1:
                raise NetworkError(
                    f"{network.cell.neurons[neuron].name} reaches beyond the neighbouring cells; "
                    "a cell may read its two neighbours only"
                )
            if key not in target:
                target[key] = new()
            operations.append((target[key], slot, offset, kind, index))

    for row in range(len(drives)):
        table[row][(row, 0)] = new(is_neuron=True)
    for order, (kind, node, a, b) in enumerate(blocks):
        if kind == SUM:
            for edge in range(a, b):
                accumulate(table[node], sources[edge, 0], sources[edge, 1], BY_WEIGHT, edge)
        elif kind == PRODUCT:
            accumulate(table[node], a, 0, BY_VALUE, b)
            accumulate(table[node], b, 0, BY_VALUE, a)
        else:
            accumulate(table[node], b, 0, BY_SLOPE, order)
    columns: list[dict[tuple[int, int], int]] = [{} for _ in drives]
    for row, (first, last) in enumerate(drives):
        for edge in range(first, last):
            accumulate(columns[row], sources[edge, 0], sources[edge, 1], BY_WEIGHT, edge)
    slot_start = np.zeros((len(starts), network.stages + 2))
    slot_start[np.array(starts, bool), 1:-1] = 1.0
    return _integers(operations, 5), slot_start, columns


def _entries(columns, network: Network) -> np.ndarray:
    stages = network.stages
    component = -np.ones((len(columns), stages + 2), np.int64)
    component[network.places[:, 0], network.places[:, 1] + 1] = np.arange(network.size)
    entries = []
    for row, slots in enumerate(columns):
        for (neuron, place), slot in slots.items():
            r, c = component[row, 1:-1], component[neuron, 1 + place : 1 + place + stages]
            k = np.flatnonzero((r >= 0) & (c >= 0))
            entries.append(np.column_stack([r[k], c[k], np.full(len(k), slot), k]))
    table = np.concatenate(entries) if entries else np.zeros((0, 4), np.int64)
    return np.ascontiguousarray(table[np.lexsort((table[:, 1], table[:, 0]))])


def pyramid_arrays(network: Network, coordinators: Coordinators | None) -> dict[str, np.ndarray]:
    """The part of a tape that describes the coordinators."""
    if coordinators is None:
        return {
            "chains": np.zeros((0, 2), np.int64),
            "grids": np.zeros((0, 0, 0)),
            "levels": np.zeros(1, np.int64),
            "hats": np.zeros(0, np.int64),
            "shares": np.zeros(0),
        }
    if coordinators.chains != len(network.cell.chains):
        raise NetworkError(
            f"coordinators: made for {coordinators.chains} chains, but the cell "
            f"has {len(network.cell.chains)}"
        )
    hats, shares = coordinators.hats(2 * network.stages)
    sizes = [len(gain) for gain in coordinators.gains]
    return {
        "chains": chain_rows(network),
        "grids": np.concatenate(coordinators.gains),
        "levels": np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        "hats": hats,
        "shares": shares,
    }
