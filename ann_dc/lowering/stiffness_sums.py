"""Solve with a stiffness as sums, in sequence along the array or by cyclic reduction.

`substitution` needs fewer coefficients: it is for machines that execute one operation at a time.
`reduction` needs fewer sequential sums: it is for machines that execute all operations at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from ann_dc.evaluation.tape import Tape
from ann_dc.lowering.preconditioner_sums import Derivatives
from ann_dc.lowering.program import SUM, ZERO, Listing
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.elimination import eliminate
from ann_dc.network.preconditioners.stiffness import Stiffness

StiffnessSolve: TypeAlias = Callable[[Derivatives, Network, Tape, Listing, np.ndarray], None]
"""Function that computes the derivatives of coupled neurons by a solve with the stiffness."""


def substitution(
    derivatives: Derivatives, network: Network, tape: Tape, listing: Listing, drives: np.ndarray
) -> None:
    """Replace the derivatives by z: K y = d is solved forward and K' z = y backward.

    The number of sequential sums is proportional to the horizon; net inputs are ``drives`` (P, N).
    """
    count, neurons = len(tape.coupled) - 1, network.cell.neurons
    rows = {
        (half, p): listing.row(f"{half} of {neurons[p].name}")
        for half in ("elimination", "derivative")
        for p in np.unique(tape.coupled[:-1, 0]).tolist()
    }
    y, z = [ZERO] * count, [ZERO] * count
    inverse = tape.factor[tape.coupled[1:, 2] - 1].tolist()
    back: list[list[tuple[int, float]]] = [[] for _ in range(count)]
    for i, (neuron, stage, first) in enumerate(tape.coupled[:-1].tolist()):
        before = slice(first, int(tape.coupled[i + 1, 2]) - 1)
        columns, values = tape.factor_columns[before].tolist(), tape.factor[before].tolist()
        edges = [(int(drives[neuron, stage]), inverse[i])]
        for column, value in zip(columns, values):
            edges.append((y[column], -value * inverse[i]))
            back[column].append((i, value))
        y[i] = listing.word(rows["elimination", neuron])
        listing.sum(SUM, y[i], edges)
    for i in reversed(range(count)):
        neuron, stage, _ = tape.coupled[i].tolist()
        edges = [(z[later], -value * inverse[i]) for later, value in back[i]]
        z[i] = listing.word(rows["derivative", neuron])
        listing.sum(SUM, z[i], [*edges, (y[i], inverse[i])])
        derivatives[int(network.state_index[neuron, stage])] = [(z[i], 1.0)]


def reduction(
    derivatives: Derivatives, network: Network, _: Tape, listing: Listing, drives: np.ndarray
) -> None:
    """Replace the derivatives by T^{1/2} S^{-1} T^{1/2} d, with S^{-1} by odd-even reduction.

    The number of sequential sums is proportional to the logarithm of the horizon.
    """
    if not isinstance(network.preconditioner, Stiffness):
        return
    layout = network.layout
    solve, roots = eliminate(network.preconditioner, layout), np.sqrt(layout.state_rates)
    live = solve.component >= 0
    words = np.where(live, drives[layout.places][solve.component], ZERO)
    factors = np.where(live, roots[solve.component], 0.0)
    sums, passed = _BlockSums(network, listing), []
    for depth, level in enumerate(solve.levels):
        component = solve.component[2**depth - 1 :: 2**depth]
        passed.append((component[0::2], words[0::2], factors[0::2, None]))
        own = factors[1::2, :, None] * np.eye(words.shape[1]), words[1::2], 0
        left = -level.left * factors[0::2, None][: len(level.left)], words[0::2], 0
        right = -level.right * factors[2::2, None], words[2::2], 0
        words = sums.add(f"rest {depth} of", component[1::2], (own, left, right))
        factors = np.ones(words.shape)
    answers = words  # of no block
    for depth, (component, ready, factor) in reversed(list(enumerate(passed))):
        level = solve.levels[depth]
        own = level.inverse * factor, ready, 0
        left = -level.left.transpose(0, 2, 1), answers, 0
        right = -level.right.transpose(0, 2, 1), answers, 1
        words = sums.add(f"move {depth} of", component, (own, left, right))
        answers = _interleaved(words, answers)
    for index, word in zip(solve.component[live].tolist(), answers[live].tolist()):
        derivatives[index] = [(word, float(roots[index]))]


Term: TypeAlias = tuple[np.ndarray, np.ndarray, int]
"""Matrices (T, b, b), words (T, b), and the block to which the first product belongs."""


class _BlockSums:
    """Sums over blocks of words; an empty position of a block has no sum."""

    def __init__(self, network: Network, listing: Listing) -> None:
        neurons, _ = network.layout.places
        self.names = [network.cell.neurons[neuron].name for neuron in neurons]
        self.listing = listing

    def add(self, title: str, component: np.ndarray, terms: tuple[Term, ...]) -> np.ndarray:
        """Append the sums of matrix-vector products of blocks; return their words (B, b)."""
        rows: dict[str, int] = {}
        found = np.full(component.shape, ZERO)
        for block, j in np.argwhere(component >= 0).tolist():
            name = self.names[component[block, j]]
            if name not in rows:
                rows[name] = self.listing.row(f"{title} {name}")
            edges: list[tuple[int, float]] = []
            for matrices, words, first in terms:
                if 0 <= block - first < len(matrices):
                    weights = matrices[block - first, j].tolist()
                    edges += zip(words[block - first].tolist(), weights)
            found[block, j] = self.listing.word(rows[name])
            self.listing.sum(SUM, int(found[block, j]), edges)
        return found


def _interleaved(even: np.ndarray, odd: np.ndarray) -> np.ndarray:
    both = np.empty((len(even) + len(odd), *even.shape[1:]), even.dtype)
    both[0::2], both[1::2] = even, odd
    return both
