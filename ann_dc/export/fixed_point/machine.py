r"""The integer machine: what C and hardware have to do, bit for bit.

Words are signed integers of ``bits`` bits, each with as many fraction bits as its row has. A sum
multiplies words by integer coefficients and is exact until its end; then, as after a product and
within a table, there is one rounding,

.. math:: \mathrm{round}(a, s) = \lfloor (a + 2^{s-1}) / 2^s \rfloor ,

(for s < 0 the integer times 2^{-s}), and what does not fit into a word becomes the nearest that
does. States have ``guard`` more fraction bits than their words and stop at their rails. A network
is settled where every drive is within its threshold.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.formulas import compiled, inner
from ann_dc.export.fixed_point.program import (
    DRIVE,
    FUNCTION,
    PRODUCT,
    RECTIFY,
    SUM,
    UPDATE,
)


class Machine(NamedTuple):
    """The integers of a network; all arrays int64. K operations, E edges, W words, n neurons."""

    bits: int
    """Of a word, sign included."""
    guard: int
    """Fraction bits that a state has beyond those of its word."""
    cut: int
    """Operations before it end with the drives."""
    operations: np.ndarray
    """(K, 6): kind, word or neuron that is written, first and last edge (or two words; or table
    and word), shift of the rounding, neuron or -1."""
    edges: np.ndarray
    """(E, 2): word that a sum reads, and its coefficient."""
    tables: np.ndarray
    """(T, 4): lowest and highest argument, shift from arguments to entries, first entry."""
    entries: np.ndarray
    """(V,): entries of all tables."""
    words: np.ndarray
    """(W,): at the start."""
    neurons: np.ndarray
    """(n, 5): word, state at the start, lowest and highest state, threshold of the drive."""


class Integers:
    """The golden model: a machine at work, in int64.

    Parameters
    ----------
    machine : Machine

    Attributes
    ----------
    words, states : arrays of int64
        What the machine holds.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self.words, self.states = machine.words.copy(), machine.neurons[:, 1].copy()
        self.peak = np.zeros(len(self.states), np.int64)

    def run(self, steps: int, settle: bool = False) -> int:
        """Take steps; with ``settle``, none from the first state on that is settled.

        Parameters
        ----------
        steps : int
        settle : bool

        Returns
        -------
        int
            How many were taken.
        """
        self.peak[:] = 0
        m = self.machine
        code = m.operations, m.edges, m.tables, m.entries, m.neurons
        sizes = m.bits, m.guard, m.cut
        return _run(code, sizes, steps, settle, (self.words, self.states, self.peak))


@inner
def rounded(a, shift):
    """a / 2^shift, to the nearest integer, halves upward."""
    if shift > 0:
        return (a + (1 << (shift - 1))) >> shift
    return a << -shift


@inner
def _looked_up(table, entries, x):
    low, high, shift, first = table
    place = min(max(x, low), high) - low
    at = first + (place >> shift)
    share = place - ((place >> shift) << shift)
    return entries[at] + rounded((entries[at + 1] - entries[at]) * share, shift)


@inner
def _computed(operation, code, words):
    """What an operation gives before it has to fit."""
    _, edges, tables, entries, _ = code
    kind, _, a, b, shift, _ = operation
    if kind == PRODUCT:
        return rounded(words[a] * words[b], shift)
    if kind == FUNCTION:
        return _looked_up(tables[a], entries, words[b])
    if kind == RECTIFY:
        return rounded(max(words[b], 0), shift)
    total = np.int64(0)
    for e in range(a, b):
        total += edges[e, 1] * words[edges[e, 0]]
    return rounded(total, shift)


@inner
def _stopped(value, state, low, high):
    """A drive, zero where it pushes a state out past its rail."""
    if (state <= low and value < 0) or (state >= high and value > 0):
        return np.int64(0)
    return value


@compiled
def _run(code, sizes, steps, settle, memory):  # noqa: C901 - one branch an operation
    operations, _, _, _, neurons = code
    bits, guard, cut = sizes
    words, states, peak = memory
    top = (1 << (bits - 1)) - 1
    for step in range(steps):
        quiet = True
        for k in range(operations.shape[0]):
            if k == cut and settle and quiet:
                return step
            kind, target, _, _, _, neuron = operations[k]
            value = _computed(operations[k], code, words)
            if kind == UPDATE:
                _, _, low, high, _ = neurons[neuron]
                states[neuron] = min(max(states[neuron] + value, low), high)
                target, value = neurons[neuron, 0], rounded(states[neuron], guard)
            value = min(max(value, -top - 1), top)
            if kind == DRIVE:
                _, _, low, high, threshold = neurons[neuron]
                value = _stopped(value, states[neuron], low, high)
                peak[neuron] = max(peak[neuron], abs(value))
                quiet = quiet and abs(value) <= threshold
            words[target] = value
    return steps
