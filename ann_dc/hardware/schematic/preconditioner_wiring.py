r"""Preconditioner as layers of weighted sums: wires from integrators to neurons.

The neurons z that move with the net inputs of others obey :math:`z' = M d`. With a separate
integrator D per neuron, D' = d, they are the weighted sum z = z_0 + M D, and the preconditioner
needs no further integrator. Its nodes lie between D and z,

.. math:: v = W v + (D, c) ,

one sum per node, with the wires of the preconditioner kind. Without the constants c these are:

- multilevel: every coarse-level neuron adds up the integrals below its hat function, :math:`Y =
  \phi' D`, and every neuron the outputs of the coarse-level neurons above, :math:`z = T D + \phi
  S\, Y`;
- cyclic reduction: downward level by level, :math:`y = T^{1/2} D - W y`, with a sum for every block
  that has blocks below, and upward, :math:`z = T^{1/2} S_{ee}^{-1} y - T^{1/2} W' T^{-1/2} z`;
- resistive grid: nodes connected by resistors, :math:`G z = D` with G = M^{-1}. A node adds up the
  signals from its neighbours, :math:`z_i = (D_i - \sum_{j \ne i} G_{ij} z_j) / G_{ii}`.

The initial values z_0 are constants c of the neurons, so integrators start at zero and store only
changes. Otherwise the integrators of a network near its settled point would store M^{-1} z_0, which
is large at the fixed ends: fifty times the change for the car at N = 36. Sums of such a range have
an equally large noise gain and need correspondingly faster op amps. In a grid, D includes z_0,
because a resistor network has no noise gain.

Errors of these wires change the trajectory but move no equilibrium. If all D are at rest, all net
inputs are zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.elements import Adder, GridNode, Wire
from ann_dc.network.cell import ONE
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.elimination import Elimination
from ann_dc.network.preconditioners.multilevel import Multilevel, hat_positions
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

OWN = "own."
"""Prefix of the separate integrator of a neuron that a preconditioner reaches."""

Node = tuple[str, int]
"""Name and stage."""

SMALLEST = 1e-9
"""Threshold relative to a node's largest weight, below which a weight is not a wire."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PreconditionerWiring:
    """Nodes of a preconditioner, integrators first, and the wires between them.

    Nodes are (name, stage): ``own.<neuron>`` for the integrators; the neurons come last. The sparse
    ``weights`` W (nodes, nodes) lead into a node (row) from another node (column), and
    ``constants`` c (nodes,) from the constant one. If ``passive``, the neurons are nodes of a
    resistor network, which settles by itself.
    """

    nodes: tuple[Node, ...]
    weights: Any
    constants: np.ndarray
    passive: bool = False

    @cached_property
    def own(self) -> np.ndarray:
        """Indices of the separate integrators."""
        return np.flatnonzero([name.startswith(OWN) for name, _ in self.nodes])

    @cached_property
    def moved(self) -> np.ndarray:
        """Indices of the neurons, in the order of their integrators."""
        place = {node: i for i, node in enumerate(self.nodes)}
        own = (self.nodes[i] for i in self.own)
        return np.array([place[name.removeprefix(OWN), stage] for name, stage in own], int)

    def values(self, integrals: np.ndarray) -> np.ndarray:
        """Return the values of all nodes (first axis) from those of the integrators."""
        given = np.zeros((len(self.nodes), *integrals.shape[1:]))
        given.T[...] = self.constants
        given[self.own] = integrals
        one = sparse.eye_array(len(self.nodes))
        return scipy.sparse.linalg.splu(sparse.csc_array(one - self.weights)).solve(given)

    @property
    def start(self) -> np.ndarray:
        """Values of the neurons, in the order of `moved`, for integrators at zero."""
        return self.values(np.zeros(len(self.own)))[self.moved]

    @property
    def preconditioner(self) -> np.ndarray:
        """M: displacement of the neurons (rows) per value of an integrator (columns)."""
        return self.values(np.eye(len(self.own)))[self.moved] - self.start[:, None]


def wiring_of(network: Network) -> PreconditionerWiring | None:
    """Return the wires of a network's preconditioner, or None if it is diagonal."""
    preconditioner, row = network.preconditioner, network.layout
    reached = np.flatnonzero(preconditioner.reach(row)[network.places[:, 0]])
    if not len(reached):
        return None
    layers = _Layers(network, reached)
    if isinstance(preconditioner, Multilevel):
        _pyramid(layers, preconditioner)
    elif isinstance(preconditioner, CyclicReduction):
        _tree(layers, preconditioner.elimination(row))
    elif isinstance(preconditioner, ResistiveGrid):
        _grid(layers, preconditioner)
    return layers.wiring(passive=isinstance(preconditioner, ResistiveGrid))


class _Layers:
    """Nodes in layers, each with its wires from the layers before."""

    def __init__(self, network: Network, reached: np.ndarray) -> None:
        self.network, self.reached = network, reached
        self.rates = network.layout.state_rates[reached]
        self.nodes = [(OWN + name, stage) for name, stage in self.neurons("")]
        self.weights: Any = sparse.csr_array((len(self.nodes), len(self.nodes)))

    def neurons(self, before: str) -> list[Node]:
        """Return the reached neurons with a prefix in their names."""
        places = self.network.places[self.reached]
        names = [neuron.name for neuron in self.network.cell.neurons]
        return [(before + names[neuron], int(stage)) for neuron, stage in places]

    def add(self, nodes: list[Node], weights: Any) -> None:
        """Add a layer (rows) with its weights from all earlier nodes and itself (columns)."""
        width = len(self.nodes) + len(nodes)
        weights = sparse.csr_array(weights)
        weights.resize((len(nodes), width))
        old = self.weights.copy()
        old.resize((len(self.nodes), width))
        self.nodes += nodes
        self.weights = sparse.vstack([old, weights], format="csr")

    def wiring(self, *, passive: bool) -> PreconditionerWiring:
        """Return the wiring without weights at rounding level."""
        weights = sparse.csr_array(self.weights)
        largest = abs(weights).max(axis=1).toarray().ravel()
        rows = np.repeat(np.arange(len(largest)), np.diff(weights.indptr))
        weights.data[np.abs(weights.data) < SMALLEST * largest[rows]] = 0.0
        weights.eliminate_zeros()
        neurons = np.arange(len(self.nodes) - len(self.reached), len(self.nodes))
        constants = np.zeros(len(self.nodes))
        if not passive:
            start = self.network.start_state[self.reached]
            constants[neurons] = start - weights[neurons][:, neurons] @ start
        return PreconditionerWiring(
            nodes=tuple(self.nodes), weights=weights, constants=constants, passive=passive
        )


# ---- pyramid -------------------------------------------------------------------------------------


def _pyramid(layers: _Layers, pyramid: Multilevel) -> None:
    """Add the coarse-level neurons, then the neurons of the chains."""
    network, place = layers.network, _places(layers)
    components = network.layout.chain_components  # (C, 2N)
    nodes: list[Node] = []
    down, up = [], [sparse.diags_array(layers.rates)]
    for gain in pyramid.gains:
        hats = _hats(components, place, len(gain) - 1, len(layers.reached))
        active = np.flatnonzero((np.abs(gain).sum(axis=-1) > 0).ravel())
        down.append(hats[:, active].T)
        between = sparse.block_diag(list(gain), format="csc")[:, active]
        up.append(hats @ between)
        nodes += list(_coarse_nodes(network, len(gain) - 1, active))
    layers.add(nodes, sparse.vstack(down))
    layers.add(layers.neurons(""), sparse.hstack(up))


def _places(layers: _Layers) -> np.ndarray:
    """Return the index of each state component among the reached ones, or -1."""
    place = -np.ones(layers.network.size + 1, np.int64)  # the last one is that of no component
    place[layers.reached] = np.arange(len(layers.reached))
    return place


def _hats(components: np.ndarray, place: np.ndarray, intervals: int, count: int) -> Any:
    """Return the weights (reached, points C) of coarse-level neurons in neurons."""
    chains, positions = components.shape
    index, share = hat_positions(positions, intervals)
    chain = np.arange(chains)[:, None]
    shares, rows, columns = [], [], []
    for point, weight in ((index, 1 - share), (index + 1, share)):
        used = (components >= 0) & (weight > 0)
        shares.append(np.broadcast_to(weight, used.shape)[used])
        rows.append(place[components[used]])
        columns.append((point * chains + chain)[used])
    entries = (np.concatenate(shares), (np.concatenate(rows), np.concatenate(columns)))
    return sparse.csc_array(entries, shape=(count, (intervals + 1) * chains))


def _coarse_nodes(network: Network, intervals: int, active: np.ndarray) -> Iterator[Node]:
    """Yield the coarse-level neurons, each in the cell below its position."""
    chains = network.cell.chains
    last = 2 * network.stages - 1
    taken: dict[Node, int] = {}
    for point, chain in zip(*np.divmod(active, len(chains))):
        stage = int(point * last / intervals) // 2
        name = f"coarse.{intervals}.{chains[chain][0].partition('.')[2]}"
        beside = taken.get((name, stage), 0)  # two points of a fine grid may share a cell
        taken[name, stage] = beside + 1
        yield (f"{name}.{beside}" if beside else name), stage


# ---- tree and grid -------------------------------------------------------------------------------


def _tree(layers: _Layers, found: Elimination) -> None:
    """Add the sums of the downward sweep, then the neurons, the last block first."""
    below, inverse = _hat_matrices(found, _places(layers), len(layers.reached))
    root = np.sqrt(layers.rates)
    is_summed = abs(below).sum(axis=1) > 0
    leaves, summed = sparse.diags_array(np.where(is_summed, 0.0, root)), np.flatnonzero(is_summed)
    down = sparse.diags_array(root) - below @ leaves
    names = layers.neurons("tree.")
    sums = sparse.csr_array(sparse.hstack([down, -below[:, summed]]))
    layers.add([names[i] for i in summed], sums[summed])
    up = sparse.csc_array(sparse.diags_array(root) @ inverse)
    back = sparse.diags_array(root) @ below.T @ sparse.diags_array(1 / root)
    layers.add(layers.neurons(""), sparse.hstack([up @ leaves, up[:, summed], -back]))


def _hat_matrices(found: Elimination, place: np.ndarray, count: int) -> tuple[Any, Any]:
    """Return W (remaining, eliminated) of all levels and S_ee^{-1} of all blocks."""
    hats, inverses = sparse.lil_array((count, count)), sparse.lil_array((count, count))
    blocks = place[found.component]

    def put(matrix, rows: np.ndarray, columns: np.ndarray, block: np.ndarray) -> None:
        i, j = np.flatnonzero(rows >= 0), np.flatnonzero(columns >= 0)
        matrix[np.ix_(rows[i], columns[j])] = block[np.ix_(i, j)]

    for level in found.levels:
        for e, block in enumerate(level.inverse):
            put(inverses, blocks[2 * e], blocks[2 * e], block)
        for o, block in enumerate(level.left):
            put(hats, blocks[2 * o + 1], blocks[2 * o], block)
        for o, block in enumerate(level.right):
            put(hats, blocks[2 * o + 1], blocks[2 * o + 2], block)
        blocks = blocks[1::2]
    return sparse.csr_array(hats), sparse.csr_array(inverses)


def _grid(layers: _Layers, grid: ResistiveGrid) -> None:
    """Add the nodes with resistors to their neighbours."""
    stiffness = sparse.csr_array(grid.matrix(layers.network.layout))[layers.reached][
        :, layers.reached
    ]
    root = sparse.diags_array(1 / np.sqrt(layers.rates))
    conductance = sparse.csr_array(root @ stiffness @ root)  # G = M^{-1}
    per_node = sparse.diags_array(1 / conductance.diagonal())
    between = sparse.csr_array(per_node @ conductance)
    between.setdiag(0.0)
    between.eliminate_zeros()
    layers.add(layers.neurons(""), sparse.hstack([per_node, -between]))


def preconditioner_parts(wiring: PreconditionerWiring, stages: int) -> Iterator[Adder | GridNode]:
    """Yield a part for every node name except integrators, in the order of layers.

    A part is a `GridNode` if the wiring is passive, and an `Adder` otherwise.
    """
    wires: dict[str, dict[tuple[str, int], np.ndarray]] = {}
    present: dict[str, np.ndarray] = {}
    for row, (name, stage) in enumerate(wiring.nodes):
        if name.startswith(OWN):
            continue
        present.setdefault(name, np.zeros(stages, bool))[stage] = True
        arriving = wires.setdefault(name, {})
        first, last = wiring.weights.indptr[row : row + 2]
        for column in range(first, last):
            source, where = wiring.nodes[wiring.weights.indices[column]]
            weight = arriving.setdefault((source, where - stage), np.zeros(stages))
            weight[stage] = wiring.weights.data[column]
        if wiring.constants[row]:
            arriving.setdefault((ONE, 0), np.zeros(stages))[stage] = wiring.constants[row]
    kind = GridNode if wiring.passive else Adder
    for name, arriving in wires.items():
        yield kind(
            name=name,
            wires=tuple(
                Wire(source=source, offset=offset, weight=weight)
                for (source, offset), weight in sorted(arriving.items())
            ),
            present=present[name],
        )


def preconditioner_values(network: Network, states: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values of preconditioner nodes, with integrators but without neurons.

    With z' = M d and D' = d, z = z_0 + M D, so D is M^{-1} (z - z_0). States (T, n) give values (T,
    N) by node name, zero in cells without the node. The result is empty for a diagonal
    preconditioner.
    """
    wiring = wiring_of(network)
    if wiring is None:
        return {}
    neurons = [wiring.nodes[i] for i in wiring.moved]  # in the order of their integrators
    places = [(network.neuron_index[name], stage) for name, stage in neurons]
    component = network.state_index[tuple(np.transpose(places))]
    preconditioner = evaluator(network).preconditioner[component][:, component].toarray()
    moved = np.asarray(states, float)[:, component].T - wiring.start[:, None]
    integrals = scipy.linalg.solve(preconditioner, moved, assume_a="pos")
    found: dict[str, np.ndarray] = {}
    for (name, stage), value in zip(wiring.nodes, wiring.values(integrals)):
        if name not in network.neuron_index:
            shape = len(states), network.stages
            found.setdefault(name, np.zeros(shape))[:, stage] = value
    return found
