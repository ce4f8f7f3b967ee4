r"""A network's step as one list of operations on numbered words, in real numbers.

.. math:: x_{k+1} = \mathrm{clip}(x_k + h\, M\, d(x_k))

Every node of every cell that something reads has a word, and every operation writes one: a sum of
weighted words, a product of two, a function of one. Pins and what is read beyond the ends of the
row are the words of inputs, shared neurons have one word for all cells, and what is always zero
has none. What computes these operations needs to know nothing else of networks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

Edges = Iterable[tuple[int, float]]
"""Words that a sum reads, and their weights."""

SUM, PRODUCT, FUNCTION, RECTIFY, DRIVE, UPDATE = range(6)
"""Kinds of operations: a drive is a sum that a rail may stop, an update adds a sum to a state."""
SUMS = (SUM, DRIVE, UPDATE)
ZERO = 0
"""The word that is always zero."""
GROUP = 32
"""Lanes that take their steps together: their words fit into a processor's cache."""


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

    @property
    def drives(self) -> np.ndarray:
        """Words (n,) of the drives, in the order of the state vector."""
        found = self.operations[self.operations[:, 0] == DRIVE]
        return found[np.argsort(found[:, 4]), 1]


class Listing:
    """Words and operations, as they are needed.

    Attributes
    ----------
    operations, sources, weights, names, rows, values : lists
        As in a `Program`; ``values`` are its words.
    """

    def __init__(self) -> None:
        self.operations: list[tuple[int, int, int, int, int]] = []
        self.sources: list[int] = []
        self.weights: list[float] = []
        self.names: list[str] = ["zero"]
        self.rows: list[int] = [0]
        self.values: list[float] = [0.0]

    def row(self, name: str) -> int:
        """A new row of words."""
        self.names.append(name)
        return len(self.names) - 1

    def new(self, row: int, values: Iterable[float]) -> np.ndarray:
        """New words of a row, which hold these values at first."""
        first = len(self.values)
        self.values.extend(float(value) for value in values)
        self.rows.extend([row] * (len(self.values) - first))
        return np.arange(first, len(self.values))

    def word(self, row: int) -> int:
        """One new word of a row."""
        return int(self.new(row, [0.0])[0])

    def sum(self, kind: int, target: int, edges: Edges, neuron: int = -1) -> None:
        """A sum; what reads a word twice reads it once with both weights."""
        first, total = len(self.sources), {}
        for word, weight in edges:
            total[word] = total.get(word, 0.0) + weight
        used = {word: w for word, w in total.items() if w != 0.0 and word != ZERO}
        self.sources.extend(used)
        self.weights.extend(used.values())
        self.operations.append((kind, target, first, len(self.sources), neuron))

    def needed(self) -> np.ndarray:
        """(K, 5): the operations, without those that nothing reads."""
        read, kept = np.zeros(len(self.values), bool), []
        for operation in reversed(self.operations):
            kind, target, a, b, _ = operation
            if kind not in (DRIVE, UPDATE) and not read[target]:
                continue
            kept.append(operation)
            if kind in SUMS:
                read[self.sources[a:b]] = True
            else:
                read[[a, b] if kind == PRODUCT else b] = True
        return np.array(kept[::-1], np.int64).reshape(-1, 5)
