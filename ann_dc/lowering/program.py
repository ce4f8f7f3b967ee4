r"""Step of a network as one list of operations on numbered words, in real numbers.

.. math:: x_{k+1} = \mathrm{clip}(x_k + h\, M\, d(x_k))

Every node of every cell that another node reads has a word, and every operation writes one word: a
weighted sum of words, a product of two words, or a function of one word. Fixed neurons and values
beyond the ends of the cell array are words of inputs. Shared neurons have one word for all cells,
and nodes that are always zero have none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

Edges = Iterable[tuple[int, float]]
"""Words that a sum reads, and their weights."""

SUM, PRODUCT, FUNCTION, RECTIFY, DRIVE, UPDATE = range(6)
"""Operation kinds: a drive is a sum that a limit may set to zero, an update adds a sum to a state.
"""
SUMS = (SUM, DRIVE, UPDATE)
ZERO, ONE = 0, 1
"""Words that are always zero and always one."""
GROUP = 32
"""Number of lanes that advance together; their words fit into a processor's cache."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Program:
    """Ordered operations of one step: K operations, E edges, W words, n neurons.

    Attributes
    ----------
    operations : (K, 5) array of int
        Kind; written word (for an update: neuron); operands; neuron of a drive or an update, else
        -1. Operands are the first and last edge of a sum, two words of a product, or code and word
        of a function.
    sources, weights : (E,) arrays
        Words that sums read, and their weights.
    words : (W,) array
        Values of the words that no operation writes, zero elsewhere.
    rows : (W,) array of int
        Named row of each word: a node at all stages, whose words have one format.
    states, start, limits : (n,), (n,) and (n, 2) arrays
        Words, initial values and saturation limits of the neurons, in the order of the state.
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
        """Words (n,) of the net inputs, in the order of the state vector."""
        found = self.operations[self.operations[:, 0] == DRIVE]
        return found[np.argsort(found[:, 4]), 1]


class Listing:
    """Growing content of a `Program`; ``values`` are its words."""

    def __init__(self) -> None:
        self.operations: list[tuple[int, int, int, int, int]] = []
        self.sources: list[int] = []
        self.weights: list[float] = []
        self.names: list[str] = ["zero"]
        self.rows: list[int] = [0]
        self.values: list[float] = [0.0]

    def row(self, name: str) -> int:
        """Add a row of words and return its number."""
        self.names.append(name)
        return len(self.names) - 1

    def new(self, row: int, values: Iterable[float]) -> np.ndarray:
        """Add words to a row, with the given initial values."""
        first = len(self.values)
        self.values.extend(float(value) for value in values)
        self.rows.extend([row] * (len(self.values) - first))
        return np.arange(first, len(self.values))

    def word(self, row: int) -> int:
        """Add one word to a row."""
        return int(self.new(row, [0.0])[0])

    def sum(self, kind: int, target: int, edges: Edges, neuron: int = -1) -> None:
        """Add a sum; repeated reads of a word become one read with the summed weight."""
        first, total = len(self.sources), {}
        for word, weight in edges:
            total[word] = total.get(word, 0.0) + weight
        used = {word: w for word, w in total.items() if w != 0.0 and word != ZERO}
        self.sources.extend(used)
        self.weights.extend(used.values())
        self.operations.append((kind, target, first, len(self.sources), neuron))

    def needed(self) -> np.ndarray:
        """Return the operations (K, 5) whose results are read."""
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
