"""d drive / dx as straight-line vector code: the operations of a tape, every one a line.

It reads what the cell has left of a state, so that blocks which a neighbour reads are there. What
is no slot of an entry and is read by no other cell stays in registers. No metric is in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ann_dc.evaluation.codegen.cell_code import FIELDS, CellWriter
from ann_dc.evaluation.codegen.code import key_of
from ann_dc.evaluation.codegen.elementary import slope_of
from ann_dc.evaluation.codegen.plan import WRITERS, Plan
from ann_dc.evaluation.codegen.writer import Module
from ann_dc.evaluation.tape import BY_VALUE, BY_WEIGHT

JACOBIAN_FIELDS = (*FIELDS, "slots")
"""What the code reads and fills, in the order of the table of addresses."""
JACOBIAN_NAMES = "cell", "jacobian"
"""The functions of a piece of code."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slots:
    """The derivatives of a wiring, sorted like the blocks of a `Plan`.

    Attributes
    ----------
    plan : Plan
        Of stages.
    """

    plan: Plan

    @cached_property
    def operations(self) -> list[list[int]]:
        """Target, source, offset, kind and index of the factor."""
        return self.plan.tape.slots.tolist()

    @cached_property
    def phase(self) -> dict[int, int]:
        """Of every slot that is computed; those of the neurons themselves are one."""
        phase: dict[int, int] = {}
        for target, source, offset, *_ in self.operations:
            after = phase.get(source, 0) + (offset != 0 and source >= self.plan.neurons)
            phase[target] = max(phase.get(target, 0), after)
        return phase

    @cached_property
    def stored(self) -> dict[int, int]:
        """Row in the table of slots, by slot, of what a neighbour or a later phase reads."""
        kept = {
            source
            for target, source, offset, *_ in self.operations
            if source in self.phase and (offset != 0 or self.phase[source] != self.phase[target])
        }
        return {slot: row for row, slot in enumerate(sorted(kept))}

    @cached_property
    def used(self) -> dict[int, int]:
        """Row in the table that is given back, by slot, of those of an entry."""
        return {slot: row for row, slot in enumerate(np.unique(self.plan.tape.entries[:, 2]))}

    @cached_property
    def key(self) -> str:
        """Of the code."""
        own = JACOBIAN_NAMES, self.operations, list(map(int, self.used))
        return key_of((*own, *self.plan.cell_identity()), WRITERS)


@lru_cache(maxsize=64)
def slots_of(plan: Plan) -> Slots:
    """The derivatives of a plan, sorted once."""
    return Slots(plan=plan)


def jacobian_code(slots: Slots) -> str:
    """``i64 cell(table, x, moves)`` and, after it, ``jacobian(table, x, out)``, as LLVM has it.

    Parameters
    ----------
    slots : Slots

    Returns
    -------
    str
    """
    module = Module()
    CellWriter(slots.plan, module, "cell").write_cell(is_cut=False)  # for its blocks alone
    _JacobianWriter(slots, module).write()
    return module.text()


class _JacobianWriter(CellWriter):
    """Writes ``jacobian``; blocks are computed where a factor asks for them."""

    def __init__(self, slots: Slots, module: Module) -> None:
        super().__init__(slots.plan, module, "jacobian")
        self.slots, self.derivative = slots, dict[int, str]()
        self.step = {node: step for step, node in enumerate(self.tape.blocks[:, 1].tolist())}
        self.base["slots"] = self.f.field("%table", JACOBIAN_FIELDS.index("slots"))
        self.rows |= {"out": len(slots.used), "slots": len(slots.stored)}

    def write(self) -> None:
        """All of it."""
        for phase in range(1 + max(self.slots.phase.values(), default=0)):
            with self.f.loop(self.base["chunks"]) as chunk:
                self.begin(chunk)
                self.derivative = {}
                for operation in self.slots.operations:
                    if self.slots.phase[operation[0]] == phase:
                        self._add(*operation)
                for slot, found in self.derivative.items():
                    self._keep(slot, found)
        self.f.done()

    def watch(self, step: int, code: int, argument: str) -> None:
        """The cell has looked."""

    def value(self, node: int, offset: int = 0) -> str:
        """A node at these stages, or at those of a neighbour; computed where nobody has yet."""
        is_new = (node, offset) not in self.known and node > self.plan.one
        if is_new and offset == 0 and node not in self.plan.stored:
            self.known[node, 0] = self.block(self.step[node])
        return super().value(node, offset)

    def _add(self, target: int, source: int, offset: int, kind: int, index: int) -> None:
        """d(target) += factor * d(source)."""
        f, total = self.f, self.derivative.get(target)
        share = None if source < self.plan.neurons else self._read(source, offset)
        unit = self.plan.unit[index] if kind == BY_WEIGHT else 0
        if unit and share:
            term = share if unit > 0 else f.op("fneg", share)
        elif unit:
            term = f.constant(float(unit))
        else:
            factor = self._factor(kind, index)
            if share and total:
                self.derivative[target] = f.fma(factor, share, total)
                return
            term = f.op("fmul", factor, share) if share else factor
        self.derivative[target] = f.op("fadd", total, term) if total else term

    def _factor(self, kind: int, index: int) -> str:
        if kind == BY_WEIGHT:
            return self.number("weights", self.plan.weighted[index])
        if kind == BY_VALUE:
            return self.value(index)
        _, node, code, argument = self.tape.blocks[index].tolist()
        return slope_of(self.f, code, self.value(argument), self.value(node), self.circular)

    def _read(self, slot: int, offset: int) -> str:
        """A slot of this phase, of an earlier one or of a neighbour."""
        if offset == 0 and slot in self.derivative:
            return self.derivative[slot]
        return self.at_neighbour("slots", self.slots.stored[slot], offset)

    def _keep(self, slot: int, found: str) -> None:
        """What others read."""
        if slot in self.slots.stored:
            self.f.store(self.where_alive(found), self.row("slots", self.slots.stored[slot]))
        if slot in self.slots.used:
            self.f.store(found, self.row("out", self.slots.used[slot]))
