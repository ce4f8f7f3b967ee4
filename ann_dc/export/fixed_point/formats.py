"""Fixed-point formats: fraction bits of all words and integer coefficients.

A number of b bits with f fraction bits lies within 2^{b-1-f}. The fraction bits of a row of words
follow from its largest value in simulated trajectories, times `HEADROOM`; a word has guard
additional fraction bits. A sum of w_e s_e, with f_e fraction bits in s_e, has coefficients W_e =
w_e 2^{F - f_e}. The common F is as large as 64 bits allow, so the sum is exact and is rounded once,
from F to the fraction bits of the target word. A W_e longer than b bits is stored as its leading b
bits and an exponent.
"""

from __future__ import annotations

import numpy as np

from ann_dc.errors import ExportError
from ann_dc.export.fixed_point.machine import Machine
from ann_dc.export.fixed_point.tables import Table, made_table
from ann_dc.lowering.program import FUNCTION, PRODUCT, RECTIFY, SUMS, UPDATE, Program
from ann_dc.lowering.walk import Ranges
from ann_dc.network.functions import FUNCTIONS

HEADROOM = 1.5
"""Largest representable number of a row relative to the largest value in the trajectories."""
POPULATION = 1 / 16
"""Least range of a neuron's row relative to the widest row of its population."""
NOISE = 16
"""Least range of a row relative to the rounding error that reaches it."""
GUARD, WIDEST = 12, 32
"""Additional fraction bits of words compared with their factors; maximum number of bits of a word.
"""
ACCUMULATOR = 62
"""Maximum number of bits of a sum, without its sign."""
STEEPEST = 1 / 64
"""Largest jump of a function between adjacent arguments, relative to the largest value of a word.
"""


def _fractions(program: Program, ranges: Ranges, bits: int) -> np.ndarray:
    """Compute the fraction bits (rows,) of every row, for words of ``bits`` bits."""
    largest = np.zeros(len(program.names))
    seen = np.maximum(np.abs(ranges.low), np.abs(ranges.high))
    np.maximum.at(largest, program.rows, seen)
    if not np.isfinite(largest).all():
        name = program.names[int(np.argmin(np.isfinite(largest)))]
        raise ExportError(
            f"{name}: it overflows in the runs that determine the word ranges; use an initial "
            "guess closer to the solution, or design the network again"
        )
    _widen_states(program, largest)
    least = 2.0 ** (2 - bits)  # of a word's range, twice its last bit
    for kind, target, a, b, _ in program.operations.tolist():
        if kind == UPDATE:
            continue
        row, noise = program.rows[target], 0.0
        if kind in SUMS:
            noise = float(
                np.abs(program.weights[a:b]) @ largest[program.rows[program.sources[a:b]]]
            )
        elif kind == PRODUCT:
            noise = largest[program.rows[a]] * largest[program.rows[b]]
        largest[row] = max(largest[row], NOISE * least * noise)
    largest[largest == 0] = 1.0
    return bits - 1 - np.ceil(np.log2(HEADROOM * largest)).astype(np.int64)


def _widen_states(program: Program, largest: np.ndarray) -> None:
    """Widen neurons' rows to a fraction of the population's range, and inputs to 1."""
    rows = np.unique(program.rows[program.states])
    populations = np.array([program.names[row].partition(".")[0] for row in rows])
    for name in np.unique(populations):
        own = rows[populations == name]
        largest[own] = np.maximum(largest[own], POPULATION * largest[own].max())
    for words in program.inputs.values():
        row = program.rows[words[0]]
        largest[row] = max(largest[row], 1.0)


def quantised(program: Program, ranges: Ranges, bits: int) -> tuple[Machine, np.ndarray]:
    """Convert a program to integers with words of 4 to 32 bits.

    Returns the machine, without thresholds and with a period of one step, and the fraction bits
    (W,) of every word. Raises `ExportError`, which names the node, if a value in the trajectories
    is not finite, a sum does not fit into 64 bits, or a table does not fit into the words.
    """
    writer = _Writer(program, ranges, bits)
    for operation in program.operations.tolist():
        writer.operate(*operation)
    return writer.machine(), writer.fraction


class _Writer:
    """Sequential conversion of operations to integers."""

    def __init__(self, program: Program, ranges: Ranges, bits: int) -> None:
        self.program, self.ranges, self.bits = program, ranges, bits
        self.guard = min(GUARD, WIDEST - bits)
        self.fraction = _fractions(program, ranges, bits)[program.rows]
        self.operations: list[tuple[int, ...]] = []
        self.edges: list[tuple[int, int, int]] = []
        self.tables: dict[tuple[int, int, int], Table] = {}

    def operate(self, kind: int, target: int, a: int, b: int, neuron: int) -> None:
        word = int(self.program.states[target]) if kind == UPDATE else target
        own = int(self.fraction[word]) + self.guard
        if kind in SUMS:
            first, shift = len(self.edges), self.sum(a, b, own, word)
            a, b = first, len(self.edges)
        elif kind == PRODUCT:
            shift = int(self.fraction[a] + self.fraction[b]) - own
            self.check(shift, 2 * self.bits - 2, word)
        elif kind == RECTIFY:
            a, shift = 0, int(self.fraction[b]) + self.guard - own
            self.check(shift, self.bits + self.guard - 1, word)
        else:
            a, shift = self.table(a, b, word), 0
        self.operations.append((kind, target, a, b, shift, neuron))

    def sum(self, first: int, last: int, own: int, word: int) -> int:
        """Append the edges of a sum and return its rounding shift."""
        sources, weights = self.program.sources[first:last], self.program.weights[first:last]
        if not len(sources):
            return 0
        room = ACCUMULATOR - self.bits - self.guard - np.log2(np.abs(weights))
        room += self.fraction[sources] + self.guard
        scale = min(int(np.floor(room.min())), own + ACCUMULATOR - 1)
        coefficients, exponents = self.coefficients(sources, weights, scale)
        while self.bound(coefficients << exponents) >= 2**ACCUMULATOR // 2 ** max(own - scale, 0):
            scale -= 1
            coefficients, exponents = self.coefficients(sources, weights, scale)
            if not coefficients.any():
                raise ExportError(self.refusal(word, "its sum does not fit into 64 bits"))
        self.edges += zip(sources.tolist(), coefficients.tolist(), exponents.tolist())
        return scale - own

    def coefficients(
        self, sources: np.ndarray, weights: np.ndarray, scale: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Convert weights to integers with exponents; the sum has ``scale`` fraction bits."""
        exact = np.ldexp(weights, scale - self.fraction[sources] - self.guard)
        exponents = np.maximum(np.frexp(exact)[1] - (self.bits - 1), 0)
        exponents += np.abs(np.rint(np.ldexp(exact, -exponents))) >= 2 ** (self.bits - 1)
        return np.rint(np.ldexp(exact, -exponents)).astype(np.int64), exponents.astype(np.int64)

    def bound(self, coefficients: np.ndarray) -> int:
        """Return an upper bound of a sum for all possible words."""
        return sum(map(abs, coefficients.tolist())) << (self.bits + self.guard - 1)

    def check(self, shift: int, width: int, word: int) -> None:
        """Check that a rounding shift leaves a number of the given width within 64 bits."""
        if not width - ACCUMULATOR <= shift < ACCUMULATOR:
            raise ExportError(self.refusal(word, f"its rounding would be by {shift} bits"))

    def refusal(self, word: int, why: str) -> str:
        """Return an error message that names the row of a word."""
        name = self.program.names[self.program.rows[word]]
        return (
            f"bits: words of {self.bits} bits cannot carry {name}: {why}; use wider words, or "
            "units in which its numbers are of order 1"
        )

    def table(self, code: int, argument: int, word: int) -> int:
        """Return the index of the table of an operation, which is created if it is missing."""
        formats = int(self.fraction[argument]), int(self.fraction[word])
        key = int(self.program.rows[word]), *formats
        if key not in self.tables:
            found = made_table(code, self.seen(word), formats, self.bits, self.guard)
            if not max(found.jump, found.error / 2 ** (self.bits - 1)) <= STEEPEST:
                name = FUNCTIONS[code].name
                why = f"the value of {name} jumps between adjacent arguments, as near a pole"
                raise ExportError(self.refusal(word, why))
            self.tables[key] = found
        return list(self.tables).index(key)

    def seen(self, word: int) -> tuple[float, float]:
        """Return the range of arguments of a row of function blocks in the trajectories."""
        program = self.program
        own = program.rows[program.operations[:, 1]] == program.rows[word]
        read = program.operations[own & (program.operations[:, 0] == FUNCTION), 3]
        return float(self.ranges.low[read].min()), float(self.ranges.high[read].max())

    def machine(self) -> Machine:
        """Build the machine, at the start of the program."""
        program, tables, top = self.program, list(self.tables.values()), 2 ** (self.bits - 1)
        first = np.cumsum([0, *(len(found.entries) for found in tables)]).tolist()
        words = np.clip(np.rint(np.ldexp(program.words, self.fraction)), -top, top - 1)
        words = words.astype(np.int64) << self.guard
        top, fine = top << self.guard, self.fraction[program.states] + self.guard
        limits = np.clip(np.rint(np.ldexp(program.limits, fine[:, None])), -top, top - 1)
        limits = limits.astype(np.int64)
        start = np.rint(np.ldexp(program.start, fine)).astype(np.int64)
        words[program.states] = start = np.clip(start, limits[:, 0], limits[:, 1])
        rows = [(*found.domain, found.shift, at) for found, at in zip(tables, first)]
        none = np.zeros_like(start)
        return Machine(
            bits=self.bits,
            guard=self.guard,
            period=1,
            operations=np.array(self.operations, np.int64).reshape(-1, 6),
            edges=np.array(self.edges, np.int64).reshape(-1, 3),
            tables=np.array(rows, np.int64).reshape(-1, 4),
            entries=np.concatenate([np.zeros(0, np.int64), *(found.entries for found in tables)]),
            words=words,
            neurons=np.column_stack([program.states, start, limits, none, program.drives, none]),
        )
