r"""A network's step as one list of operations on numbered words, in real numbers.

.. math:: x_{k+1} = \mathrm{clip}(x_k + h\, M\, d(x_k))

Every node of every cell that something reads has a word, and every operation writes one: a sum of
weighted words, a product of two, a function of one. Pins and what is read beyond the ends of the
row are the words of inputs, shared neurons have one word for all cells, and what is always zero
has none. A metric is sums too: up and down a pyramid, or forward and back through the factor of a
stiffness. What computes these operations needs to know nothing else of networks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import PRODUCT as TAPE_PRODUCT
from ann_dc.evaluation.tape import SUM as TAPE_SUM
from ann_dc.network.cell import ONE
from ann_dc.network.functions import CODE
from ann_dc.network.network import Network

SUM, PRODUCT, FUNCTION, RECTIFY, DRIVE, UPDATE = range(6)
"""Kinds of operations. A drive is a sum that a rail may cut off; an update adds a sum to a state."""
ZERO = 0
"""The word that is always zero."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Program:
    """The operations of one step, in their order; K operations, E edges, W words, n neurons.

    Attributes
    ----------
    operations : (K, 5) array of int
        Kind, word (of an update: neuron) that is written, then first and last edge of a sum, or
        two words of a product, or code and word of a function; and the neuron of a drive or an
        update, else -1.
    sources : (E,) array of int
        Words that sums read.
    weights : (E,) array
    words : (W,) array
        Values of the words that nothing writes, zero elsewhere.
    rows : (W,) array of int
        Words of one row have one format: those of a node at all stages.
    names : tuple of str
        Of the rows.
    states : (n,) array of int
        Words of the neurons, in the order of the state vector.
    start : (n,) array
    limits : (n, 2) array
        Rails.
    inputs : mapping of str to (N,) array of int
        Words of the inputs.
    """

    operations: np.ndarray
    sources: np.ndarray
    weights: np.ndarray
    words: np.ndarray
    rows: np.ndarray
    names: tuple[str, ...]
    states: np.ndarray
    start: np.ndarray
    limits: np.ndarray
    inputs: dict[str, np.ndarray]


def program(network: Network, step: float) -> Program:
    """The operations of one step of a network.

    Parameters
    ----------
    network : Network
    step : float
        h, in units of network time.

    Returns
    -------
    Program
    """
    writer = _Writer(network, step)
    writer.blocks()
    writer.drives()
    writer.updates(writer.moves())
    return writer.finished()


class _Writer:
    """Words and operations, as they are needed."""

    def __init__(self, network: Network, step: float) -> None:
        self.network, self.step, self.tape = network, step, evaluator(network).tape
        self.operations: list[tuple[int, int, int, int, int]] = []
        self.sources: list[int] = []
        self.weights: list[float] = []
        self.names: list[str] = ["zero"]
        self.rows: list[int] = [0]
        self.values: list[float] = [0.0]
        self.address = np.full(self.tape.values.shape, ZERO, np.int64)
        self.inputs: dict[str, np.ndarray] = {}
        self._places()
        self.drive_words = np.full(self.tape.rates.shape, ZERO, np.int64)

    # ---- words -----------------------------------------------------------------------------------

    def row(self, name: str) -> int:
        """A new row of words."""
        self.names.append(name)
        return len(self.names) - 1

    def new(self, row: int, values: Iterable[float] = (0.0,)) -> np.ndarray:
        """New words of a row, which hold these values at first."""
        first = len(self.values)
        self.values.extend(float(value) for value in values)
        self.rows.extend([row] * (len(self.values) - first))
        return np.arange(first, len(self.values))

    def _places(self) -> None:
        """Words of inputs, of the constant one and of the neurons, and who else reads them."""
        network, nodes, stages = self.network, self.network.node_index, self.network.stages
        self.address[nodes[ONE]] = self.new(self.row(ONE), [1.0])
        for name in network.cell.inputs:
            words = self.new(self.row(name), network.input_values[name])
            self.inputs[name] = self.address[nodes[name], 1:-1] = words
        for index, neuron in enumerate(network.cell.neurons):
            live = np.flatnonzero(network.live[index])
            self.address[index, live + 1] = self.new(self.row(neuron.name), np.zeros(len(live)))
        for index in network.shared:
            self.address[index, 1:-1] = self.address[index, stages]
        for pin in network.pins:
            self.address[nodes[pin.neuron], pin.stage + 1] = self.inputs[pin.input][pin.stage]
        for node, source in network.left.items():
            self.address[nodes[node], 0] = self.inputs[source][0]

    # ---- operations ------------------------------------------------------------------------------

    def sum(self, kind: int, target: int, edges: Iterable[tuple[int, float]], neuron=-1) -> None:
        """A sum of (word, weight); what reads a word twice reads it once with both weights."""
        first, total = len(self.sources), {}
        for word, weight in edges:
            total[word] = total.get(word, 0.0) + weight
        used = {word: w for word, w in total.items() if w != 0.0 and word != ZERO}
        self.sources.extend(used)
        self.weights.extend(used.values())
        self.operations.append((kind, target, first, len(self.sources), neuron))

    def arriving(self, first: int, last: int, stage: int) -> Iterable[tuple[int, float]]:
        """(Word, weight) of what arrives in one cell over connections of the tape."""
        for edge in range(first, last):
            source, offset = self.tape.sources[edge]
            if 0 <= stage + 1 + offset < self.address.shape[1]:
                word = int(self.address[source, stage + 1 + offset])
                yield word, float(self.tape.weights[edge, stage])

    def blocks(self) -> None:
        """All blocks, each at all stages."""
        names = list(self.network.node_index)
        for kind, node, a, b in self.tape.blocks.tolist():
            stages = np.arange(self.network.stages)
            words = self.new(self.row(names[node]), np.zeros(len(stages)))
            self.address[node, 1:-1] = words
            for stage, word in zip(stages.tolist(), words.tolist()):
                if kind == TAPE_SUM:
                    self.sum(SUM, word, self.arriving(a, b, stage))
                elif kind == TAPE_PRODUCT:
                    factors = self.address[[a, b], stage + 1].tolist()
                    self.operations.append((PRODUCT, word, *factors, -1))
                else:
                    of = RECTIFY if a == CODE["rectify"] else FUNCTION
                    self.operations.append((of, word, a, int(self.address[b, stage + 1]), -1))

    def drives(self) -> None:
        """What arrives at every neuron; at one that all cells share, from all of them."""
        network, shared = self.network, set(self.network.shared.tolist())
        rows = [self.row(f"drive of {neuron.name}") for neuron in network.cell.neurons]
        for place, (neuron, stage) in enumerate(network.places.tolist()):
            self.drive_words[neuron, stage] = word = int(self.new(rows[neuron])[0])
            cells = range(network.stages) if neuron in shared else (stage,)
            first, last = self.tape.drives[neuron].tolist()
            edges = [edge for cell in cells for edge in self.arriving(first, last, cell)]
            self.sum(DRIVE, word, edges, place)

    # ---- the metric ------------------------------------------------------------------------------

    def moves(self) -> list[list[tuple[int, float]]]:
        """(Word, weight) of what moves every neuron, before h."""
        places, rates = self.network.places, self.tape.rates
        moves = [[(int(self.drive_words[p, k]), float(rates[p, k]))] for p, k in places]
        if len(self.tape.chains):
            self._pyramid(moves)
        if len(self.tape.coupled) > 1:
            self._stiffness(moves)
        return moves

    def _pyramid(self, moves: list[list[tuple[int, float]]]) -> None:
        tape, chains = self.tape, len(self.tape.chains)
        components = list(range(chains))
        positions = list(enumerate(zip(tape.hats.tolist(), tape.shares.tolist())))
        grid = np.full((tape.grid_starts[-1], chains), ZERO)
        below: list[list[list[tuple[int, float]]]] = [[[] for _ in components] for _ in grid]
        for p, (left, share) in positions:
            for j in components:
                drive = int(self.drive_words[tape.chains[j, p & 1], p >> 1])
                below[left][j].append((drive, 1.0 - share))
                below[left + 1][j].append((drive, share))
        levels = list(zip(tape.grid_starts[:-1].tolist(), tape.grid_starts[1:].tolist()))
        for level, (first, last) in enumerate(levels):
            rows = [self.row(f"grid {level} of {self._chain(j)}") for j in components]
            for a in range(first, last):
                for j in components:
                    grid[a, j] = self.new(rows[j])[0]
                    self.sum(SUM, int(grid[a, j]), below[a][j])
                    if level + 1 < len(levels):
                        for point, share in _half(a - first, last):
                            below[point][j].append((int(grid[a, j]), share))
        rates = self._responses(grid, levels)
        for p, (left, share) in positions:
            for j in components:
                index = self.network.state_index[tape.chains[j, p & 1], p >> 1]
                if index >= 0:
                    up = [(int(rates[left, j]), 1.0 - share), (int(rates[left + 1, j]), share)]
                    moves[index] += up

    def _responses(self, grid: np.ndarray, levels: list[tuple[int, int]]) -> np.ndarray:
        """Words of the rates at grid points: their own gains, and what comes from above."""
        rates = np.full(grid.shape, ZERO)
        for level in reversed(range(len(levels))):
            first, last = levels[level]
            rows = [self.row(f"rate {level} of {self._chain(j)}") for j in range(grid.shape[1])]
            for a in range(first, last):
                for i, row in enumerate(rows):
                    edges = [(int(w), float(g)) for w, g in zip(grid[a], self.tape.grids[a, i])]
                    if level + 1 < len(levels):
                        above = _half(a - first, last)
                        edges += [(int(rates[point, i]), share) for point, share in above]
                    rates[a, i] = self.new(row)[0]
                    self.sum(SUM, int(rates[a, i]), edges)
        return rates

    def _chain(self, j: int) -> str:
        return self.network.cell.chains[j][0]

    def _stiffness(self, moves: list[list[tuple[int, float]]]) -> None:
        """K y = d from the first row to the last, then K' z = y back again."""
        tape, count = self.tape, len(self.tape.coupled) - 1
        neurons = self.network.cell.neurons
        rows = {
            (half, p): self.row(f"{half} of {neurons[p].name}")
            for half in ("elimination", "move")
            for p in np.unique(tape.coupled[:-1, 0]).tolist()
        }
        y: list[int] = []
        back: list[list[tuple[int, float]]] = [[] for _ in range(count)]
        for i, (neuron, stage, first) in enumerate(tape.coupled[:-1].tolist()):
            diagonal = int(tape.coupled[i + 1, 2]) - 1
            inverse = float(tape.factor[diagonal])
            entries = range(first, diagonal)
            before = [(int(tape.factor_columns[e]), float(tape.factor[e])) for e in entries]
            edges = [(y[column], -value * inverse) for column, value in before]
            edges.append((int(self.drive_words[neuron, stage]), inverse))
            y.append(int(self.new(rows["elimination", neuron])[0]))
            self.sum(SUM, y[i], edges)
            for column, value in before:
                back[column].append((i, value))
        z = [ZERO] * count
        for i in reversed(range(count)):
            neuron, stage, _ = tape.coupled[i].tolist()
            inverse = float(tape.factor[tape.coupled[i + 1, 2] - 1])
            edges = [(z[later], -value * inverse) for later, value in back[i]]
            z[i] = int(self.new(rows["move", neuron])[0])
            self.sum(SUM, z[i], [*edges, (y[i], inverse)])
            moves[int(self.network.state_index[neuron, stage])] = [(z[i], 1.0)]

    def updates(self, moves: list[list[tuple[int, float]]]) -> None:
        """Every neuron by h times its move."""
        for place, edges in enumerate(moves):
            self.sum(UPDATE, place, [(word, self.step * weight) for word, weight in edges], place)

    # ---- the whole -------------------------------------------------------------------------------

    def finished(self) -> Program:
        """The program, without operations that nothing reads."""
        operations = np.array(self.operations, np.int64).reshape(-1, 5)
        sources = np.array(self.sources, np.int64)
        kept = _needed(operations, sources, len(self.values))
        rows, stages = self.network.places.T
        limits = np.array([(n.limiter.low, n.limiter.high) for n in self.network.cell.neurons])
        return Program(
            operations=operations[kept],
            sources=sources,
            weights=np.array(self.weights),
            words=np.array(self.values),
            rows=np.array(self.rows, np.int64),
            names=tuple(self.names),
            states=self.address[rows, stages + 1],
            start=self.network.start_state,
            limits=limits[rows],
            inputs=self.inputs,
        )


def _half(a: int, above: int) -> list[tuple[int, float]]:
    """(Point, share) on the next coarser level, which begins at ``above``, of point ``a``."""
    if a % 2:
        return [(above + a // 2, 0.5), (above + a // 2 + 1, 0.5)]
    return [(above + a // 2, 1.0)]


def _needed(operations: np.ndarray, sources: np.ndarray, words: int) -> np.ndarray:
    """(K,) booleans: which operations something reads."""
    read, kept = np.zeros(words, bool), np.zeros(len(operations), bool)
    for index in reversed(range(len(operations))):
        kind, target, a, b, _ = operations[index]
        kept[index] = kind in (DRIVE, UPDATE) or read[target]
        if not kept[index]:
            continue
        if kind in (SUM, DRIVE, UPDATE):
            read[sources[a:b]] = True
        else:
            read[[a, b] if kind == PRODUCT else b] = True
    return kept
