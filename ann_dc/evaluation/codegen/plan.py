"""What the generated code of a network depends on: its wiring, in the order of computation.

A block that another cell reads has to be there in all cells first. Blocks are therefore sorted into
*phases*: within one, everything stays in registers, and what a later phase or a neighbour reads is
stored. Numbers (weights but 1 and -1, rates, gains, inputs, N) are data and no part of a plan.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.code import key_of
from ann_dc.evaluation.codegen.elementary import CIRCULAR, WRITTEN
from ann_dc.evaluation.rules import FLOOR, SMALLEST_POSITION
from ann_dc.evaluation.tape import DUAL, FUNCTION, POSITION, PRIMAL, PRODUCT, STATE, SUM, Tape
from ann_dc.network.functions import FUNCTIONS, Tree

# ---- the numbers that the code of a metric reads: hats and gains, or the factors of a stiffness

FIELDS = (
    "nodes",
    "places",
    "points",
    "hats",
    "shares",
    "levels",
    "starts",
    "gains",
    "middle",
    "factor",
    "roots",
    "pushed",
    "gaps",
    "gap_places",
)
"""Arrays that a metric reads and fills, in the order of the table of addresses."""
INTEGERS = ("points", "levels", "middle", "gaps")
"""Those that are numbers themselves."""


def node_width(count: int) -> int:
    """Numbers in a vector that holds those of a node: a power of two, 2 at least."""
    return 1 << max(count - 1, 1).bit_length()


def pyramid_tables(tape: Tape, *, is_coupled: bool) -> dict[str, np.ndarray]:
    """Return the tables of a tape with chains; points without a neuron stand beside every level.

    Parameters
    ----------
    tape : Tape
    is_coupled : bool
        Whether gains couple chains; else only their diagonals are read.

    Returns
    -------
    dict of str to array
        ``places`` are (neuron, stage) there, -1 where nothing is.
    """
    sizes = np.diff(tape.grid_starts)
    starts = np.concatenate([[0], np.cumsum(sizes + 2)])
    level = np.repeat(np.arange(len(sizes)), sizes)
    point = starts[level] + 1 + np.arange(len(level)) - tape.grid_starts[level]
    chains = len(tape.chains)
    shape = (int(starts[-1]), *(tape.grids.shape[1:] if is_coupled else (chains,)))
    gains = np.zeros(shape)
    gains[point] = tape.grids if is_coupled else np.einsum("aii->ai", tape.grids)
    wide = np.zeros((*shape[:-1], node_width(chains)))
    wide[..., :chains] = gains
    position = np.arange(len(tape.hats))
    neuron = tape.chains[:, position & 1].T
    stage = np.broadcast_to((position >> 1)[:, None], neuron.shape)
    alive = tape.rates[neuron, stage] != 0
    return {
        "places": np.where(alive[..., None], np.stack([neuron, stage], axis=-1), -1),
        "points": np.array(len(position)),
        "hats": tape.hats + 1,
        "shares": tape.shares,
        "levels": np.array(len(sizes)),
        "starts": starts,
        "gains": wide,
        "nodes": np.zeros(int(starts[-1]) + int(sizes[-1]) // 2 + 2),  # nothing is coarser: zeros
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class TwoEnds:
    """M^{-1} of a stiffness, factored from either end of the row to its middle.

    K is what a cell says to itself, lower triangular, and A what the cell before says to it. From
    the right everything is the mirror image: the cells come in the opposite order, and so do the
    neurons in a cell. A cell is thus tied to the next one in the same way on either side, and one
    code serves both. A row of even length has a cell more, without neurons: the identity.

    Attributes
    ----------
    tape : Tape
        With a stiffness.
    """

    tape: Tape

    @cached_property
    def neurons(self) -> np.ndarray:
        """(m,): which it couples, at any stage; in this order from the left."""
        return np.unique(self.tape.coupled[:-1, 0])

    @cached_property
    def factor(self) -> tuple[np.ndarray, np.ndarray]:
        """K and A of every cell, from the left to the right end, (2h + 1, m, m) each."""
        tape, size = self.tape, len(self.neurons)
        starts, stages = tape.coupled[:, 2], tape.rates.shape[1]
        values, ends = tape.factor.copy(), starts[1:] - 1
        values[ends] = 1 / values[ends]
        row, column = np.repeat(np.arange(len(ends)), np.diff(starts)), tape.factor_columns
        number, stage = np.searchsorted(self.neurons, tape.coupled[:-1, 0]), tape.coupled[:-1, 1]
        own, last = np.zeros((2, stages | 1, size, size))
        own[:, np.arange(size), np.arange(size)] = 1.0
        for table, apart in ((own, 0), (last, 1)):
            chosen = stage[row] - stage[column] == apart
            i, j = row[chosen], column[chosen]
            table[stage[i], number[i], number[j]] = values[chosen]
        return own, last

    @cached_property
    def ahead(self) -> np.ndarray:
        """(m, m) booleans: where A may have numbers, on either side.

        Those that are tied to the cell before hear of the first there that is tied to them, and
        of all that come later: within a cell every neuron hears of all before it.
        """
        own, last = ((table != 0).any(axis=0) for table in self.factor)
        tied = last @ own.T
        tied |= tied.T[::-1, ::-1]
        return np.outer(tied.any(axis=1), np.logical_or.accumulate(tied.any(axis=0)))

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """K and A from either side, (h + 1, 2, m, m) each.

        From the left as the tape has them. From the right K is turned, cell by cell, so that M^{-1}
        stays the same to rounding: what a cell says to the one on its left it then no longer says.
        """
        (own, last), size = self.factor, len(self.neurons)
        middle = len(own) // 2
        within, before = np.stack([own, own], axis=1), np.stack([last, np.zeros_like(last)], axis=1)
        mirrored, rest = np.flip(own), np.flip(own[-1])
        for t, to in enumerate(np.flip(last)[:middle]):
            turn, factor = np.linalg.qr(np.hstack([rest, to]).T, mode="complete")
            turned = mirrored[t + 1] @ turn[size:]
            within[t, 1], before[t + 1, 1] = factor[:size].T, turned[:, :size]
            rest = turned[:, size:]
        both = np.stack([np.flip(rest), rest]).transpose(0, 2, 1)
        _, factors = np.linalg.qr(both)
        within[middle] = factors.transpose(0, 2, 1)
        return within[: middle + 1], before[: middle + 1]


def stiffness_tables(tape: Tape) -> dict[str, np.ndarray]:
    """Return the tables of a tape with a stiffness: those of both neighbours, side by side.

    Parameters
    ----------
    tape : Tape

    Returns
    -------
    dict of str to array
        ``places`` (h + 1, 2) are (neuron, stage) where the cells begin, -1 for the one that is not
        there, and ``gap_places`` those of neurons that are not; ``factor`` (h + 1, entries, 2) has
        -A, then K^{-1} row by row; ``middle`` is h.
    """
    ends = TwoEnds(tape=tape)
    within, before = ends.sides()
    lower = np.tri(within.shape[-1], dtype=bool)
    parts = -before[..., ends.ahead], np.linalg.inv(within)[..., lower]
    factor = np.concatenate(parts, axis=-1).transpose(0, 2, 1)
    middle = len(factor) - 1
    stage = np.stack([np.arange(middle + 1), np.arange(2 * middle, middle - 1, -1)], axis=1)
    neuron = np.where(stage < tape.rates.shape[1], 0, -1)
    number, gap = np.nonzero(tape.rates[ends.neurons] == 0)
    return {
        "places": np.stack([neuron, stage], axis=-1),
        "middle": np.array(middle),
        "factor": factor,
        "gaps": np.array(len(gap)),
        "gap_places": np.stack([ends.neurons[number], gap], axis=-1),
    }


# ---- what the generated code of a network depends on: its wiring, in the order of computation

LONGEST = 20_000
"""Blocks and connections of a cell beyond which compiling it takes longer than it saves."""
WRITTEN_OUT = 128
"""Neurons under a pyramid up to which it is written out, where a lane is a sample."""


WRITERS = Path(__file__).parent
"""Folder of the modules that write the code of a cell."""


class Axis(enum.Enum):
    """What a lane of the vectors is; the value is the sentence that a user reads."""

    STAGES = "a lane is a stage: one network"
    SAMPLES = "a lane is a sample: one network as often as there are lanes, on inputs of its own"
    VARIANTS = "a lane is a sample: as many networks of one wiring, with numbers of their own"

    @property
    def lanes(self) -> int:
        """How many: two registers are not too many where nothing is shuffled."""
        return 4 if self is Axis.STAGES else 8


def refusal(tape: Tape) -> str | None:
    """Why code is not generated for a network, in words; None where it is.

    Parameters
    ----------
    tape : Tape
    """
    far = np.abs(tape.sources[:, 1]).max(initial=0)
    if far > 1:
        return f"a connection reaches over {far} stages, and generated cells read neighbours only"
    if len(tape.blocks) + len(tape.sources) > LONGEST:
        return (
            f"a cell has {len(tape.blocks)} blocks and {len(tape.sources)} connections, "
            f"together more than {LONGEST}: compiling it would take longer than it saves"
        )
    try:
        _traced_functions(tape)
    except NetworkError as error:
        return str(error)
    return None


def _traced_functions(tape: Tape) -> list[tuple[str, Tree, Tree]]:
    """Return the function blocks whose code is generated from their formulas, with trees."""
    used = {int(code) for kind, _, code, _ in tape.blocks if kind == FUNCTION}
    blocks = [FUNCTIONS[code] for code in sorted(used)]
    return [(block.name, *block.trees) for block in blocks if block.name not in WRITTEN]


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A wiring, sorted.

    Attributes
    ----------
    tape : Tape
        Of which only the wiring counts.
    axis : Axis
    """

    tape: Tape
    axis: Axis

    @property
    def neurons(self) -> int:
        """P."""
        return len(self.tape.drives)

    @cached_property
    def one(self) -> int:
        """The node of the constant one; inputs stand before it, blocks after it."""
        return len(self.tape.values) - len(self.tape.blocks) - 1

    @property
    def shared(self) -> tuple[int, ...]:
        """Neurons that all cells share."""
        return tuple(self.tape.shared.tolist())

    @property
    def inputs(self) -> int:
        """How many there are."""
        return self.one - self.neurons

    @cached_property
    def unit(self) -> np.ndarray:
        """(E,): 1 or -1 where a weight is that in every stage, else 0.

        Where every sample has its own, none is: networks of one wiring have one code.
        """
        if self.axis is Axis.VARIANTS:
            return np.zeros(len(self.tape.weights), int)
        ones, minus = (np.all(self.tape.weights == sign, axis=1) for sign in (1.0, -1.0))
        return ones.astype(int) - minus.astype(int)

    @cached_property
    def weighted(self) -> dict[int, int]:
        """Row in the table of weights, by connection."""
        return {int(edge): row for row, edge in enumerate(np.flatnonzero(self.unit == 0))}

    @cached_property
    def guarded(self) -> dict[int, int]:
        """Row in the table of sides, by block, of the functions that are not defined everywhere."""
        limited = [
            step
            for step, (kind, _, code, _) in enumerate(self.tape.blocks)
            if kind == FUNCTION and FUNCTIONS[code].is_limited
        ]
        return {step: row for row, step in enumerate(limited)}

    @cached_property
    def railed(self) -> tuple[int, ...]:
        """Neurons that have a rail."""
        return tuple(np.flatnonzero(np.isfinite(self.tape.limits).any(axis=1)).tolist())

    @property
    def clamped(self) -> tuple[int, ...]:
        """Neurons among them that the metric couples to others."""
        return tuple(row for row in self.railed if row in self.tape.reached)

    @cached_property
    def early(self) -> frozenset[int]:
        """Nodes that are said in a phase before whoever reads them.

        Circular functions of samples: those of a whole row follow one another while each waits for
        its digits, which in one piece with the rest of a cell they would not.
        """
        if self.axis is Axis.STAGES:
            return frozenset()
        return frozenset(
            node
            for kind, node, code, _ in self.tape.blocks.tolist()
            if kind == FUNCTION and FUNCTIONS[code].name in CIRCULAR
        )

    @cached_property
    def _first(self) -> set[int]:
        """Blocks that early ones depend on, and these: no other has a part in the first phase."""
        needed = set(self.early)
        for kind, node, a, b in self.tape.blocks.tolist()[::-1]:
            if node in needed:
                needed |= {source for source, _ in self._read_by(kind, a, b)}
        return needed

    @cached_property
    def phase(self) -> dict[int, int]:
        """Of every node."""
        phase = dict.fromkeys(range(self.one + 1), 0)
        for kind, node, a, b in self.tape.blocks.tolist():
            reads = self._read_by(kind, a, b)
            phase[node] = self._after(reads, phase, is_first=node in self._first)
        return phase

    @cached_property
    def drive_phase(self) -> list[int]:
        """Of every neuron's drive."""
        return [
            self._after(self._read_by(SUM, first, last), self.phase, is_first=False)
            for first, last in self.tape.drives.tolist()
        ]

    def _after(self, reads: list[list[int]], phase: dict[int, int], *, is_first: bool) -> int:
        """When all that is read is there."""
        waits = [phase[s] + (s in self.early or (o != 0 and s > self.one)) for s, o in reads]
        return max([*waits, int(bool(self.early) and not is_first)])

    @property
    def phases(self) -> int:
        """How many."""
        return 1 + max([*self.drive_phase, *self.phase.values()])

    @cached_property
    def stored(self) -> dict[int, int]:
        """Row in the table of work, by block, of what a neighbour or a later phase reads."""
        reads = [
            (node_read, offset, self.phase[node])
            for kind, node, a, b in self.tape.blocks.tolist()
            for node_read, offset in self._read_by(kind, a, b)
        ]
        for row, (first, last) in enumerate(self.tape.drives.tolist()):
            reads += [(*read, self.drive_phase[row]) for read in self._read_by(SUM, first, last)]
        kept = {
            node
            for node, offset, at in reads
            if node > self.one and (offset != 0 or self.phase[node] != at)
        }
        return {node: row for row, node in enumerate(sorted(kept))}

    def _read_by(self, kind: int, a: int, b: int) -> list[list[int]]:
        """(node, offset) of all that a block reads."""
        if kind == SUM:
            return self.tape.sources[a:b].tolist()
        return [[a, 0], [b, 0]] if kind == PRODUCT else [[b, 0]]

    # ---- the metric --------------------------------------------------------------------------

    @property
    def chains(self) -> int:
        """C under a pyramid, 0 where there is none."""
        return len(self.tape.chains)

    @cached_property
    def is_coupled(self) -> bool:
        """Whether the gains of a pyramid couple chains."""
        return bool((self.tape.grids * (1 - np.eye(self.chains))).any())

    @cached_property
    def straight(self) -> tuple[list, ...]:
        """Starts of levels, hats, shares and places of a pyramid that is written out, else nothing.

        See `pyramid_tables`; these are wiring then.
        """
        if self.axis is Axis.STAGES or not 0 < self.chains * len(self.tape.hats) <= WRITTEN_OUT:
            return ()
        tables = pyramid_tables(self.tape, is_coupled=self.is_coupled)
        return tuple(tables[name].tolist() for name in ("starts", "hats", "shares", "places"))

    @property
    def gain_columns(self) -> int:
        """Numbers of a row of the table of gains."""
        return node_width(self.chains)

    @property
    def has_stiffness(self) -> bool:
        """Whether a stiffness couples neighbours."""
        return len(self.tape.coupled) > 1

    @property
    def has_roots(self) -> bool:
        """Whether a stiffness between given time constants serves samples that have others."""
        return self.axis is Axis.VARIANTS and self.has_stiffness

    @property
    def has_metric(self) -> bool:
        """Whether drives are spread at all."""
        return bool(self.chains) or self.has_stiffness

    @cached_property
    def stiffness(self) -> tuple[list, ...]:
        """Neurons that a stiffness couples, and where one cell tells the next; else nothing.

        See `TwoEnds`.
        """
        if not self.has_stiffness:
            return ()
        ends = TwoEnds(tape=self.tape)
        return ends.neurons.tolist(), np.argwhere(ends.ahead).tolist()

    def cell_identity(self) -> tuple:
        """All that the code of a cell depends on, as plain numbers."""
        tape = self.tape
        arrays = (tape.blocks, tape.drives, tape.sources, self.unit, tape.roles)
        return (
            [(block.name, *block.domain, block.has_pole) for block in FUNCTIONS],
            _traced_functions(tape),
            (SUM, PRODUCT, FUNCTION, STATE, PRIMAL, POSITION, DUAL, FLOOR, SMALLEST_POSITION),
            self.axis.name,
            self.axis.lanes,
            self.one,
            self.railed,
            self.shared,
            *(array.tolist() for array in arrays),
        )

    def identity(self) -> tuple:
        """All that the code depends on, as plain numbers, to tell one wiring from another."""
        metric = self.chains, self.is_coupled, self.straight, self.stiffness
        return *self.cell_identity(), self.clamped, *metric

    def serves(self, tape: Tape) -> bool:
        """Whether the code is the same for another tape of the same network.

        Parameters
        ----------
        tape : Tape
        """
        own, other = self.tape, Plan(tape=tape, axis=self.axis)
        return (
            tape.blocks is own.blocks
            and np.array_equal(self.unit, other.unit)
            and len(tape.chains) == len(own.chains)
            and (not self.chains or self.is_coupled == other.is_coupled)
            and np.array_equal(tape.coupled, own.coupled)
            and np.array_equal(tape.factor_columns, own.factor_columns)
            and np.array_equal(tape.factor == 0, own.factor == 0)
            and self.straight == other.straight
        )

    @cached_property
    def key(self) -> str:
        """Of the code."""
        return key_of(self.identity(), WRITERS)
