"""Wiring on which the generated code depends, in the order of computation.

A block that another cell reads must be complete in all cells first. Blocks are therefore sorted
into *phases*. Within a phase all values stay in registers. Values that a later phase or a neighbour
reads are stored. Numbers (weights other than 1 and -1, rates, gains, inputs, N) are data and not
part of a plan.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.code import key_of
from ann_dc.evaluation.codegen.elementary import CIRCULAR
from ann_dc.evaluation.rules import DUAL, FLOOR, POSITION, PRIMAL, SMALLEST_POSITION, STATE
from ann_dc.evaluation.tape import FUNCTION, PRODUCT, SUM, Tape
from ann_dc.network.functions import FUNCTIONS, Tree

# ---- numbers that the code of a preconditioner reads: hats and gains, or factors of a stiffness

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
"""Arrays that a preconditioner reads and fills, in the order of the table of addresses."""
INTEGERS = ("points", "levels", "middle", "gaps")
"""Fields that are integers themselves."""


def node_width(count: int) -> int:
    """Return the vector width for a node: a power of two, at least 2."""
    return 1 << max(count - 1, 1).bit_length()


def pyramid_tables(tape: Tape, *, is_coupled: bool) -> dict[str, np.ndarray]:
    """Return the tables of a tape with chains, with empty points around every level.

    Without ``is_coupled`` only the diagonals of the gains are used. ``places`` contains (neuron,
    stage), or -1 if there is none.
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

    K couples a cell to itself (lower triangular), A to the cell before. From the right, the order
    of the cells and of the neurons in a cell is reversed. The coupling of a cell to the next is
    then equal on both sides, and one code serves both. A row of even length has an additional cell
    without neurons, the identity. The tape must have a stiffness.
    """

    tape: Tape

    @cached_property
    def neurons(self) -> np.ndarray:
        """Coupled neurons (m,) at any stage, in order from the left."""
        return np.unique(self.tape.coupled[:-1, 0])

    @cached_property
    def factor(self) -> tuple[np.ndarray, np.ndarray]:
        """K and A of every cell from left to right, (2h + 1, m, m) each."""
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
        """Mask (m, m) of the possible nonzeros of A, on either side.

        Rows tied to the cell before depend on the first neuron there that is tied to them, and on
        all later neurons. Within a cell, every neuron depends on all neurons before it.
        """
        own, last = ((table != 0).any(axis=0) for table in self.factor)
        tied = last @ own.T
        tied |= tied.T[::-1, ::-1]
        return np.outer(tied.any(axis=1), np.logical_or.accumulate(tied.any(axis=0)))

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Return K and A from either side, (h + 1, 2, m, m) each.

        The left side is that of the tape. On the right side K is rotated cell by cell, so that
        M^{-1} is unchanged to rounding and the coupling of a cell to its left neighbour vanishes.
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
    """Return the tables of a tape with a stiffness, both sides next to each other.

    ``places`` (h + 1, 2) contains (neuron, stage) of the first neuron of each cell, -1 for the
    missing cell; ``gap_places`` those of missing neurons. ``factor`` (h + 1, entries, 2) contains
    -A, then K^{-1} row by row. ``middle`` is h.
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
"""Blocks and connections of a cell beyond which compilation takes longer than it saves."""
LONGEST_JACOBIAN = 5_000
"""Derivatives in a cell beyond which loops compute them: up to 1 ms of compilation for each."""
WRITTEN_OUT = 128
"""Largest number of neurons under a pyramid that is written out, if a lane is a sample."""


WRITERS = Path(__file__).parent
"""Folders of the modules that write the code of a cell."""


class Axis(enum.Enum):
    """Meaning of a vector lane; the value is the description for users."""

    STAGES = "one lane per stage: one network"
    SAMPLES = "one lane per sample: one network with inputs per lane"
    VARIANTS = "one lane per sample: networks of equal wiring with numbers per lane"

    @property
    def lanes(self) -> int:
        """Number of lanes; without shuffles, two registers per vector are efficient."""
        return 4 if self is Axis.STAGES else 8


def refusal(tape: Tape) -> str | None:
    """Return the reason for which code is not generated for a network, or None."""
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
    """Return the function blocks of a tape with their trees, from which code is generated."""
    used = {int(code) for kind, _, code, _ in tape.blocks if kind == FUNCTION}
    return [(block.name, *block.trees) for block in (FUNCTIONS[code] for code in sorted(used))]


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Sorted wiring of a network; only the wiring of the tape is used."""

    tape: Tape
    axis: Axis

    @property
    def neurons(self) -> int:
        """Number of neurons P."""
        return len(self.tape.drives)

    @cached_property
    def far(self) -> int:
        """Largest number of stages over which a connection reaches, at least 1."""
        return int(np.abs(self.tape.sources[:, 1]).max(initial=1))

    @property
    def ghosts(self) -> int:
        """Number of ghost chunks at either end of a row."""
        return -(-self.far // self.axis.lanes) if self.axis is Axis.STAGES else self.far

    @cached_property
    def one(self) -> int:
        """Node of the constant one, after the inputs and before the blocks."""
        return len(self.tape.values) - len(self.tape.blocks) - 1

    @property
    def shared(self) -> tuple[int, ...]:
        """Neurons shared by all cells."""
        return tuple(self.tape.shared.tolist())

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return self.one - self.neurons

    @cached_property
    def unit(self) -> np.ndarray:
        """Weights (E,) equal to 1 or -1 in every stage, 0 for all others.

        All are 0 if every sample has different weights: networks of one wiring have one code.
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
        """Row in the table of sides, by block, of the functions with a limited domain."""
        limited = [
            step
            for step, (kind, _, code, _) in enumerate(self.tape.blocks)
            if kind == FUNCTION and FUNCTIONS[code].is_limited
        ]
        return {step: row for row, step in enumerate(limited)}

    @cached_property
    def with_limits(self) -> tuple[int, ...]:
        """Neurons with a saturation limit."""
        return tuple(np.flatnonzero(np.isfinite(self.tape.limits).any(axis=1)).tolist())

    @property
    def clamped(self) -> tuple[int, ...]:
        """Neurons with a saturation limit that the preconditioner couples to others."""
        return tuple(row for row in self.with_limits if row in self.tape.reached)

    @cached_property
    def early(self) -> frozenset[int]:
        """Nodes computed one phase before they are read.

        These are the circular functions of samples. Computed for a whole row, each function
        overlaps the latency of the others; within the rest of a cell it would not.
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
        """Early blocks and their dependencies, the only blocks of the first phase."""
        needed = set(self.early)
        for kind, node, a, b in self.tape.blocks.tolist()[::-1]:
            if node in needed:
                needed |= {source for source, _ in self._read_by(kind, a, b)}
        return needed

    @cached_property
    def phase(self) -> dict[int, int]:
        """Phase of every node."""
        phase = dict.fromkeys(range(self.one + 1), 0)
        for kind, node, a, b in self.tape.blocks.tolist():
            reads = self._read_by(kind, a, b)
            phase[node] = self._after(reads, phase, is_first=node in self._first)
        return phase

    @cached_property
    def drive_phase(self) -> list[int]:
        """Phase of the net input of every neuron."""
        return [
            self._after(self._read_by(SUM, first, last), self.phase, is_first=False)
            for first, last in self.tape.drives.tolist()
        ]

    def _after(self, reads: list[list[int]], phase: dict[int, int], *, is_first: bool) -> int:
        """Return the phase in which all reads are available."""
        waits = [phase[s] + (s in self.early or (o != 0 and s > self.one)) for s, o in reads]
        return max([*waits, int(bool(self.early) and not is_first)])

    @property
    def phases(self) -> int:
        """Number of phases."""
        return 1 + max([*self.drive_phase, *self.phase.values()])

    @cached_property
    def stored(self) -> dict[int, int]:
        """Row in the table of work of each block read by a neighbour or a later phase."""
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
        """Return (node, offset) of all reads of a block."""
        if kind == SUM:
            return self.tape.sources[a:b].tolist()
        return [[a, 0], [b, 0]] if kind == PRODUCT else [[b, 0]]

    # ---- the preconditioner ----------------------------------------------------------------------

    @property
    def chains(self) -> int:
        """Number of chains C under a pyramid, 0 without a pyramid."""
        return len(self.tape.chains)

    @cached_property
    def is_coupled(self) -> bool:
        """True if the gains of a pyramid couple chains."""
        return bool((self.tape.grids * (1 - np.eye(self.chains))).any())

    @cached_property
    def straight(self) -> tuple[list, ...]:
        """Level starts, hats, interpolation weights and places of a written-out pyramid.

        Empty for any other preconditioner. For a written-out pyramid the `pyramid_tables` are
        wiring.
        """
        if self.axis is Axis.STAGES or not 0 < self.chains * len(self.tape.hats) <= WRITTEN_OUT:
            return ()
        tables = pyramid_tables(self.tape, is_coupled=self.is_coupled)
        return tuple(tables[name].tolist() for name in ("starts", "hats", "shares", "places"))

    @property
    def gain_columns(self) -> int:
        """Numbers in a row of the table of gains."""
        return node_width(self.chains)

    @property
    def has_stiffness(self) -> bool:
        """True if a stiffness couples neighbours."""
        return len(self.tape.coupled) > 1

    @property
    def has_roots(self) -> bool:
        """True if samples have other time constants than the stiffness was made for."""
        return self.axis is Axis.VARIANTS and self.has_stiffness

    @property
    def has_preconditioner(self) -> bool:
        """True if the preconditioner is not diagonal."""
        return bool(self.chains) or self.has_stiffness

    @cached_property
    def stiffness(self) -> tuple[list, ...]:
        """Neurons coupled by a stiffness and the nonzeros of `TwoEnds.ahead`; else empty."""
        if not self.has_stiffness:
            return ()
        ends = TwoEnds(tape=self.tape)
        return ends.neurons.tolist(), np.argwhere(ends.ahead).tolist()

    def cell_identity(self) -> tuple:
        """Return all data on which the code of a cell depends, as plain numbers."""
        tape = self.tape
        arrays = (tape.blocks, tape.drives, tape.sources, self.unit, tape.roles)
        return (
            [(block.name, *block.domain, block.has_pole) for block in FUNCTIONS],
            _traced_functions(tape),
            (SUM, PRODUCT, FUNCTION, STATE, PRIMAL, POSITION, DUAL, FLOOR, SMALLEST_POSITION),
            self.axis.name,
            self.axis.lanes,
            self.one,
            self.with_limits,
            self.shared,
            *(array.tolist() for array in arrays),
        )

    def identity(self) -> tuple:
        """Return all data on which the code depends, as plain numbers."""
        preconditioner = self.chains, self.is_coupled, self.straight, self.stiffness
        return *self.cell_identity(), self.clamped, *preconditioner

    def serves(self, tape: Tape) -> bool:
        """Return True if the code also serves another tape of the same network."""
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
        """Key of the code."""
        return key_of(self.identity(), WRITERS)
