r"""The integer machine: what C and hardware have to do, bit for bit.

Words are signed integers of ``bits`` bits, each with as many fraction bits as its row has. A sum
multiplies words by integer coefficients and is exact until its end; then, as after a product and
within a table, there is one rounding,

.. math:: \mathrm{round}(a, s) = \lfloor (a + 2^{s-1}) / 2^s \rfloor ,

(for s < 0 the integer times 2^{-s}), and what does not fit into a word becomes the nearest that
does. States have ``guard`` more fraction bits than their words and stop at their rails.

After every ``period`` steps the words of all neurons are marked. The network is settled where each
is within its threshold of its last mark: what jitters by some last bits does not matter, what
drifts does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.formulas import compiled, inlined
from ann_dc.export.fixed_point.arithmetic.program import (
    DRIVE,
    FUNCTION,
    PRODUCT,
    RECTIFY,
    UPDATE,
)


class Machine(NamedTuple):
    """The integers of a network; all arrays int64. K operations, E edges, W words, n neurons."""

    bits: int
    """Of a word, sign included."""
    guard: int
    """Fraction bits that a state has beyond those of its word."""
    period: int
    """Steps from one mark to the next."""
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
    """(n, 5): word, state at the start, lowest and highest state, threshold."""


class Integers:
    """The golden model: a machine at work, in int64.

    Parameters
    ----------
    machine : Machine

    Attributes
    ----------
    words, states, marks : arrays of int64
        What the machine holds.
    steps : int
        Taken so far.
    drift : (n,) array of int64
        How far words were from their marks at most, in the last run.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine, self.steps = machine, 0
        self.words, self.states = machine.words.copy(), machine.neurons[:, 1].copy()
        self.marks = self.words[machine.neurons[:, 0]]
        self.drift = np.zeros_like(self.states)

    def run(self, steps: int, settle: bool = False) -> int:
        """Take steps; with ``settle``, none after the network is settled.

        Parameters
        ----------
        steps : int
        settle : bool

        Returns
        -------
        int
            How many were taken since the start.
        """
        m = self.machine
        self.drift[:] = 0
        self.steps = _run(
            (m.operations, m.edges, m.tables, m.entries, m.neurons),
            (m.bits, m.guard, m.period),
            (self.steps, self.steps + steps),
            settle,
            (self.words, self.states, self.marks, self.drift),
        )
        return self.steps


@inlined
def rounded(a, shift):
    """a / 2^shift, to the nearest integer, halves upward."""
    if shift > 0:
        return (a + (1 << (shift - 1))) >> shift
    return a << -shift


@inlined
def _looked_up(tables, entries, table, x):
    low, shift = tables[table, 0], tables[table, 2]
    place = min(max(x, low), tables[table, 1]) - low
    at = tables[table, 3] + (place >> shift)
    share = place - ((place >> shift) << shift)
    return entries[at] + rounded((entries[at + 1] - entries[at]) * share, shift)


@inlined
def _added(edges, words, first, last):
    total = np.int64(0)
    for e in range(first, last):
        total += edges[e, 1] * words[edges[e, 0]]
    return total


@inlined
def _stopped(value, state, low, high):
    """A drive, zero where it pushes a state out past its rail."""
    if (state <= low and value < 0) or (state >= high and value > 0):
        return np.int64(0)
    return value


@inlined
def _settled(marks, drift, words, neurons):
    """Whether all words are near their marks; then they are marked anew."""
    settled = True
    for n in range(neurons.shape[0]):
        word = words[neurons[n, 0]]
        drift[n] = max(drift[n], abs(word - marks[n]))
        settled = settled and abs(word - marks[n]) <= neurons[n, 4]
        marks[n] = word
    return settled


@compiled
def _run(code, sizes, span, settle, memory):  # noqa: C901 - one branch an operation
    operations, edges, tables, entries, neurons = code
    bits, guard, period = sizes
    words, states, marks, drift = memory
    top = (1 << (bits - 1)) - 1
    for step in range(span[0], span[1]):
        for k in range(operations.shape[0]):
            kind, target, shift = operations[k, 0], operations[k, 1], operations[k, 4]
            a, b, neuron = operations[k, 2], operations[k, 3], operations[k, 5]
            if kind == PRODUCT:
                value = rounded(words[a] * words[b], shift)
            elif kind == FUNCTION:
                value = _looked_up(tables, entries, a, words[b])
            elif kind == RECTIFY:
                value = rounded(max(words[b], 0), shift)
            else:
                value = rounded(_added(edges, words, a, b), shift)
            if kind == UPDATE:
                low, high = neurons[neuron, 2], neurons[neuron, 3]
                states[neuron] = min(max(states[neuron] + value, low), high)
                target, value = neurons[neuron, 0], rounded(states[neuron], guard)
            value = min(max(value, -top - 1), top)
            if kind == DRIVE:
                value = _stopped(value, states[neuron], neurons[neuron, 2], neurons[neuron, 3])
            words[target] = value
        if (step + 1) % period == 0 and _settled(marks, drift, words, neurons) and settle:
            return step + 1
    return span[1]
