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
from ann_dc.evaluation import row_code
from ann_dc.evaluation.generated.metric_tables import TwoEnds, node_width, pyramid_tables
from ann_dc.evaluation.rules import FLOOR, SMALLEST_POSITION
from ann_dc.evaluation.tape import (
    DUAL,
    FUNCTION,
    POSITION,
    PRIMAL,
    PRODUCT,
    STATE,
    SUM,
    Tape,
)
from ann_dc.evaluation.vector_code.code import key_of
from ann_dc.evaluation.vector_code.elementary import CIRCULAR, WRITTEN
from ann_dc.network.functions import FUNCTIONS, Tree

LONGEST = 20_000
"""Blocks and connections of a cell beyond which compiling it takes longer than it saves."""
WRITTEN_OUT = 128
"""Neurons under a pyramid up to which it is written out, where a lane is a sample."""


WRITERS = Path(__file__).parent, Path(row_code.__file__ or "").parent
"""Folders of the modules that write the code of a cell."""


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
        return key_of(self.identity(), *WRITERS)
