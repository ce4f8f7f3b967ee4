r"""Integer machine: the arithmetic that C code and hardware reproduce bit for bit.

Words are signed integers of ``bits + guard`` bits, with the fraction bits of their row. Factors of
products and arguments of tables are rounded to ``bits`` bits; sums read all bits. A coefficient is
an integer of ``bits`` bits times a power of two. A sum is exact until its end. One rounding
follows, also after a product and within a table,

.. math:: \mathrm{round}(a, s) = \lfloor (a + 2^{s-1}) / 2^s \rfloor ,

(for s < 0 the integer times 2^{-s}). A result or a table argument that does not fit is clipped to
the nearest representable value and sets a permanent flag: the lane is saturated.

After every ``period`` steps the words of all neurons are stored as a mark. A lane is settled at a
mark if

- each neuron is within a threshold of its last mark (still),
- the net input of each neuron is within another threshold (small residual), and
- no value has been clipped since the start (not saturated).

A lane is one set of inputs. Lanes advance together and are independent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.formulas import compiled, inlined
from ann_dc.lowering.program import DRIVE, FUNCTION, GROUP, PRODUCT, RECTIFY, UPDATE

WORD, START, LOW, HIGH, STILL, DRIVEN, SMALL = range(7)
"""Columns of a machine's neurons."""


class Machine(NamedTuple):
    """Integers of a network: int64 arrays; K operations, E edges, W words, n neurons."""

    bits: int
    """Bits of an input, a control, a coefficient and a factor, sign included."""
    guard: int
    """Additional fraction bits of a word."""
    period: int
    """Steps between marks."""
    operations: np.ndarray
    """Rows (K, 6): kind, written word or neuron, first and last edge (or two words; or table and
    word), rounding shift, neuron or -1.
    """
    edges: np.ndarray
    """Rows (E, 3): word read by a sum, its coefficient, and the exponent of its power of two."""
    tables: np.ndarray
    """Rows (T, 4): lowest and highest argument, shift from arguments to entries, first entry."""
    entries: np.ndarray
    """Entries of all tables: (V,)."""
    words: np.ndarray
    """Initial values of all words: (W,)."""
    neurons: np.ndarray
    """Rows (n, 7): word, initial value, low and high limit, threshold of its drift, word of its net
    input, threshold of the net input.
    """

    @property
    def wide(self) -> int:
        """Bits of a word."""
        return self.bits + self.guard


class Settled(NamedTuple):
    """Final state of every lane of a run with a step limit."""

    steps: np.ndarray
    """Steps until a lane settled, or the limit: (B,)."""
    settled: np.ndarray
    """True for lanes that settled: (B,) bool."""
    states: np.ndarray
    """Words of the neurons after these steps: (n, B)."""
    saturated: np.ndarray
    """Lanes in which a number was clipped: (B,) bool."""


class Integers:
    """Golden model: execution of a machine in int64.

    The words of all lanes are ``lanes`` (W, B). The arrays ``drift`` and ``drive`` (n, B) are the
    largest distance of every neuron from its mark in the last run, and its largest net input at
    marks.
    """

    def __init__(self, machine: Machine, lanes: int = 1) -> None:
        self.machine, self.steps = machine, 0
        self.lanes = np.repeat(machine.words[:, None], lanes, axis=1)
        self.saturated = np.zeros(lanes, np.bool_)
        self.marks = self.states_of_lanes.copy()
        self.drift, self.drive = np.zeros_like(self.marks), np.zeros_like(self.marks)

    @property
    def words(self) -> np.ndarray:
        """Words of the first lane, as a writable view: (W,)."""
        return self.lanes[:, 0]

    @property
    def states(self) -> np.ndarray:
        """Words of the neurons of the first lane: (n,)."""
        return self.words[self.machine.neurons[:, WORD]]

    @property
    def states_of_lanes(self) -> np.ndarray:
        """Words of the neurons of all lanes: (n, B)."""
        return self.lanes[self.machine.neurons[:, WORD]]

    def load(self, words: np.ndarray, values: np.ndarray) -> None:
        """Write inputs (k,) or (k, B) into words (k,); one beyond ``bits`` bits saturates."""
        top = 1 << (self.machine.bits - 1)
        given = np.broadcast_to(values.T, (self.lanes.shape[1], len(words))).T
        fit = np.clip(given, -top, top - 1)
        self.saturated |= (fit != given).any(0)
        self.lanes[words] = fit << self.machine.guard

    def run(self, steps: int) -> None:
        """Execute steps."""
        m = self.machine
        self.drift[:] = 0
        self.drive[:] = 0
        first = self.steps
        for at in range(0, self.lanes.shape[1], GROUP):
            group = slice(at, at + GROUP)
            own = [np.ascontiguousarray(part[..., group]) for part in self._memory()]
            _run(
                (m.operations, m.edges, m.tables, m.entries, m.neurons),
                (m.bits, m.guard, m.period),
                (first, first + steps),
                tuple(own),
            )
            for part, now in zip(self._memory(), own):
                part[..., group] = now
        self.steps += steps

    def _memory(self) -> tuple[np.ndarray, ...]:
        return self.lanes, self.saturated, self.marks, self.drift, self.drive

    def settle(self, limit: int) -> Settled:
        """Execute at most ``limit`` steps until every lane has settled."""
        m = self.machine
        steps = np.full(self.lanes.shape[1], limit)
        settled, states = np.zeros(len(steps), np.bool_), self.states_of_lanes
        while self.steps < limit and not (settled | self.saturated).all():
            self.run(min(m.period - self.steps % m.period, limit - self.steps))
            if self.steps % m.period:
                break
            found = (self.drift <= m.neurons[:, STILL, None]).all(0) & ~self.saturated
            found &= (self.drive <= m.neurons[:, SMALL, None]).all(0) & ~settled
            steps[found], states[:, found] = self.steps, self.states_of_lanes[:, found]
            settled |= found
        states[:, ~settled] = self.states_of_lanes[:, ~settled]
        return Settled(steps, settled, states, self.saturated.copy())


def first_cut_off(machine: Machine, limit: int) -> np.ndarray | None:
    """Return the first operation whose result is clipped within ``limit`` steps, if any."""
    model = Integers(machine)
    before = model.lanes.copy()
    while model.steps < limit and not model.saturated[0]:
        before[:] = model.lanes
        model.run(1)
    model.lanes[:], model.saturated[:] = before, False
    for operation in machine.operations:
        model.machine = machine._replace(operations=operation[None])
        model.run(1)
        if model.saturated[0]:
            return operation
    return None


@inlined
def rounded(a, shift):
    """Return a / 2^shift, rounded to the nearest integer, halves upward."""
    if shift > 0:
        return (a + (1 << (shift - 1))) >> shift
    return a << -shift


@inlined
def _looked_up(tables, entries, table, x, saturated, lane):
    low, high, shift = tables[table, 0], tables[table, 1], tables[table, 2]
    saturated[lane] |= x < low or x > high
    place = min(max(x, low), high) - low
    at = tables[table, 3] + (place >> shift)
    share = place - ((place >> shift) << shift)
    return entries[at] + rounded((entries[at + 1] - entries[at]) * share, shift)


@inlined
def _added(edges, words, first, last, total):
    total[:] = 0
    for e in range(first, last):
        word, coefficient = edges[e, 0], edges[e, 1] << edges[e, 2]
        for lane in range(total.shape[0]):
            total[lane] += coefficient * words[word, lane]


@inlined
def _marked(neurons, memory):
    """Mark all neurons."""
    words, _, marks, drift, drive = memory
    for n in range(neurons.shape[0]):
        for lane in range(words.shape[1]):
            word, driven = words[neurons[n, WORD], lane], abs(words[neurons[n, DRIVEN], lane])
            moved = abs(word - marks[n, lane])
            drift[n, lane] = max(drift[n, lane], moved)
            drive[n, lane] = max(drive[n, lane], driven)
            marks[n, lane] = word


@inlined
def _kept(values, low, high, top, saturated):
    """Clip values to two limits; clipping at an end of the word range sets the flag."""
    for lane in range(values.shape[0]):
        value = min(max(values[lane], low), high)
        saturated[lane] |= value != values[lane] and (value == top or value == -top - 1)
        values[lane] = value


@compiled
def _run(code, sizes, span, memory):  # noqa: C901 - one branch an operation
    operations, edges, tables, entries, neurons = code
    bits, guard, period = sizes
    words, saturated = memory[0], memory[1]
    top, lanes = (1 << (bits + guard - 1)) - 1, words.shape[1]
    value = np.zeros(lanes, np.int64)
    for step in range(span[0], span[1]):
        for k in range(operations.shape[0]):
            kind, target, shift = operations[k, 0], operations[k, 1], operations[k, 4]
            a, b, neuron = operations[k, 2], operations[k, 3], operations[k, 5]
            low, high = -top - 1, top
            if kind == PRODUCT:
                for i in range(lanes):
                    value[i] = rounded(words[a, i], guard) * rounded(words[b, i], guard)
            elif kind == FUNCTION:
                for i in range(lanes):
                    x = rounded(words[b, i], guard)
                    value[i] = _looked_up(tables, entries, a, x, saturated, i)
            elif kind == RECTIFY:
                for i in range(lanes):
                    value[i] = max(words[b, i], 0)
            else:
                _added(edges, words, a, b, value)
            if kind != FUNCTION:
                for i in range(lanes):
                    value[i] = rounded(value[i], shift)
            if kind == UPDATE:
                target, low, high = (
                    neurons[neuron, WORD],
                    neurons[neuron, LOW],
                    neurons[neuron, HIGH],
                )
                for i in range(lanes):
                    value[i] += words[target, i]
            if kind == DRIVE:  # before it is clipped: what a rail sets to zero is not cut off
                least, most = neurons[neuron, LOW], neurons[neuron, HIGH]
                for i in range(lanes):
                    state = words[neurons[neuron, WORD], i]
                    if (state <= least and value[i] < 0) or (state >= most and value[i] > 0):
                        value[i] = 0
            _kept(value, low, high, top, saturated)
            for i in range(lanes):
                words[target, i] = value[i]
        if (step + 1) % period == 0:
            _marked(neurons, memory)
