"""Cell as straight-line vector code: one function for dx/ds, one for residuals.

Every table consists of *chunks*: one per group of stages if a lane is a stage, one per stage if a
lane is a sample. States, inputs and stored blocks have ghost chunks at either end of the row, for
the values of neighbours beyond the end. A neighbour is one lane further if a lane is a stage, and
one chunk further if a lane is a sample. The two cases differ in nothing else.

Generated code for d drive / dx: straight-line operations of a tape.

The code reads the blocks that the cell has stored, so that blocks read by a neighbour are
available. Slots that belong to no entry and that no other cell reads stay in registers. The
preconditioner is not included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ann_dc.evaluation.codegen.buses import Buses
from ann_dc.evaluation.codegen.code import key_of
from ann_dc.evaluation.codegen.elementary import function_of, slope_of
from ann_dc.evaluation.codegen.plan import (
    FIELDS as PRECONDITIONER_FIELDS,
    INTEGERS as PRECONDITIONER_INTEGERS,
    WRITERS,
    Axis,
    Plan,
)
from ann_dc.evaluation.codegen.preconditioner_code import add_preconditioner
from ann_dc.evaluation.codegen.residual_code import add_residuals
from ann_dc.evaluation.codegen.writer import Function, Module
from ann_dc.evaluation.tape import BY_VALUE, BY_WEIGHT, PRODUCT, SUM
from ann_dc.network.functions import FUNCTIONS

FIELDS = (
    "first",
    "chunks",
    "last",
    "inputs",
    "work",
    "weights",
    "rates",
    "drives",
    "sides",
    "alive",
    "limits",
    "walls",
    "clamp",
    "clamps",
    *PRECONDITIONER_FIELDS,
)
"""Arrays that the code reads and fills, in the order of the table of addresses; see `Lanes`."""
INTEGERS = ("first", "chunks", "last", *PRECONDITIONER_INTEGERS)
"""Fields that are integers themselves."""
GIVEN = (*INTEGERS, "clamp")
"""Fields that are not addresses of tables: integers, and the called function."""
_GHOSTED = ("x", "inputs", "work", "slots")
"""Fields with ghost chunks at either end."""
NAMES = "rhs", "cell", "preconditioner", "projection", "residuals", "keep"
"""Functions of a piece of code."""


def cell_code(plan: Plan) -> str:
    """Return the code of a wiring in LLVM's language.

    ``i64 rhs(table, x, out)`` computes dx/ds and returns one bit per lane: 1 if a function block
    left its domain (0 or 1 for a single network). ``residuals(table, x, out)`` then computes the
    two residuals and the largest state.

    The parts of ``rhs`` are separate functions. ``i64 cell(table, x, out)`` computes the
    derivatives that every net input causes alone, for the chunks that the table names.
    ``preconditioner(table, out)`` adds the coupling. ``projection(table, x, out)`` projects the
    derivatives on the saturation limits and cuts the net inputs of coupled neurons, which ``cell``
    does not cut. ``keep(table, x, x)`` clips states that a step took past a limit.
    """
    module = Module()
    _CellWriter(plan, module, "cell").write_cell()
    add_preconditioner(module, plan, _fields)
    _CellWriter(plan, module, "projection").write_projection()
    _CellWriter(plan, module, "keep").write_keep()
    _whole(plan, module)
    roles, is_row = plan.tape.roles.tolist(), plan.axis is Axis.STAGES
    widths = {"width": plan.axis.lanes, "ghosts": plan.ghosts}
    add_residuals(module, roles, _fields, **widths, is_row=is_row)
    return module.text()


def _whole(plan: Plan, module: Module) -> None:
    """Write ``rhs``."""
    f = Function(module, "rhs", ("table", "x", "out"), width=plan.axis.lanes)
    outside = f.value("call i64 @cell(ptr %table, ptr %x, ptr %out)")
    if plan.has_preconditioner:
        f.do("call i64 @preconditioner(ptr %table, ptr %out)")
    if plan.clamped:
        f.do("call i64 @projection(ptr %table, ptr %x, ptr %out)")
    f.done(outside)


def _fields(f: Function) -> dict[str, str]:
    """Load the table of addresses."""
    return {
        name: f.field("%table", row, "i64" if name in INTEGERS else "ptr")
        for row, name in enumerate(FIELDS)
    }


class _CellWriter:
    """Writer of a cell function, for example ``cell`` or ``rails``.

    Functions that read the values of a cell derive from it. The function ``name`` is added to the
    module.
    """

    def __init__(self, plan: Plan, module: Module, name: str) -> None:
        self.plan, self.tape = plan, plan.tape
        self.is_row = plan.axis is Axis.STAGES
        self.is_wide = plan.axis is not Axis.SAMPLES  # whether weights and rates have one a lane
        self.f = Function(module, name, ("table", "x", "out"), width=plan.axis.lanes)
        self.base = _fields(self.f) | {"x": "%x", "out": "%out"}
        self.buses = Buses(
            self.f, plan.shared, plan.neurons * plan.ghosts, self.base,
            is_row=self.is_row, is_wide=self.is_wide,
        )  # fmt: skip
        self.rows = {
            "x": plan.neurons,
            "out": plan.neurons,
            "drives": plan.neurons,
            "rates": plan.neurons,
            "inputs": plan.inputs,
            "work": len(plan.stored),
            "weights": len(plan.weighted),
            "sides": len(plan.guarded),
            "alive": 1,
            "walls": 2 * len(plan.clamped),
        }
        self.at: dict[str, str] = {}
        self.known: dict[tuple[int, int], str] = {}
        self.circular: dict[str, tuple[str, str]] = {}
        self.outside, self.cut = "", set[int]()

    def write_cell(self, *, is_cut: bool = True) -> None:
        """Write net inputs and the derivative that each causes alone.

        With ``is_cut``, net inputs are cut at saturation limits unless the preconditioner couples
        the neuron.
        """
        f, plan = self.f, self.plan
        self.cut = set(plan.with_limits) - set(plan.clamped) if is_cut else set()
        self.outside = f.slot()
        self.buses.begin()
        for phase in range(plan.phases):
            with f.loop(self.base["chunks"], self.base["first"]) as chunk:
                self.begin(chunk)
                self._phase(phase)
        self.buses.end(self._at_limits)
        found = f.compare("une", f.load(self.outside), f.constant(0.0))
        if self.is_row:
            f.done(f.value(f"zext i1 {f.any_of(found)} to i64"))
        else:
            f.done(f.bits(found))

    def write_projection(self) -> None:
        """Write the projection on limits: calls a clamp if a coupled neuron saturates."""
        f, clamped = self.f, self.plan.clamped
        if clamped:
            found = f.slot()
            with f.loop(self.base["chunks"]) as chunk:
                self.begin(chunk)
                for number, row in enumerate(clamped):
                    low, high = (self.number("walls", 2 * number + side) for side in (0, 1))
                    state, seen = self.value(row), f.load(found)
                    low, high = f.compare("ole", state, low), f.compare("oge", state, high)
                    at_limit = f.logical("or", low, high)
                    f.store(f.select(at_limit, f.constant(1.0), seen), found)
            is_any = f.any_of(f.compare("une", f.load(found), f.constant(0.0)))
            f.either(is_any, self._clamp, [])
        f.done()

    def _clamp(self) -> list[str]:
        clamp, clamps = self.base["clamp"], self.base["clamps"]
        self.f.do(f"call i64 {clamp}(ptr {clamps}, ptr %x, ptr %out)")
        return []

    def write_keep(self) -> None:
        """Write the clipping of live neurons to their saturation limits."""
        if self.plan.with_limits:
            with self.f.loop(self.base["chunks"]) as chunk:
                self.begin(chunk)
                for row in self.plan.with_limits:
                    self.f.store(self._kept(row), self.row("x", row))
        self.f.done()

    def _kept(self, row: int) -> str:
        f, state = self.f, self.value(row)
        kept = f.larger(self._limit(row, 0), f.smaller(self._limit(row, 1), state))
        is_live = f.compare("une", self.number("rates", row), f.constant(0.0))
        return f.select(is_live, kept, state)

    # ---- tables ------------------------------------------------------------------------------

    def begin(self, chunk: str) -> None:
        """Set all table addresses to a chunk of the row."""
        f = self.f
        self.known, self.circular, self.at = {}, {}, {}
        ghosted = f.integer("add", chunk, self.plan.ghosts)
        for name, rows in self.rows.items():
            if rows == 0 or (name == "alive" and not self.is_row):
                continue
            place = ghosted if name in _GHOSTED else chunk
            size = rows * self._width(name)
            self.at[name] = f.address(self.base[name], f.integer("mul", place, size))

    def _width(self, name: str) -> int:
        return self.f.width if self.is_wide or name not in ("weights", "rates", "walls") else 1

    def row(self, name: str, row: int, chunks_on: int = 0) -> str:
        """Return the address of a row at the current chunk, or at another chunk."""
        rows = row + chunks_on * self.rows[name]
        return self.f.address(self.at[name], rows * self._width(name))

    def number(self, name: str, row: int) -> str:
        """Load a weight, a rate or a saturation limit."""
        f = self.f
        if self.is_wide:
            return f.load(self.row(name, row))
        return f.spread(f.load(self.row(name, row), 1))

    def _limit(self, row: int, side: int) -> str:
        f = self.f
        return f.spread(f.load(f.address(self.base["limits"], 2 * row + side), 1))

    # ---- values ------------------------------------------------------------------------------

    def value(self, node: int, offset: int = 0) -> str:
        """Return the value of a node at the current stages or at those of a neighbour."""
        f, plan = self.f, self.plan
        if node == plan.one:
            return f.constant(1.0)
        if node in self.buses.values:
            return self.buses.values[node]
        if (node, offset) in self.known:
            return self.known[node, offset]
        if node < plan.one:
            name, row = ("x", node) if node < plan.neurons else ("inputs", node - plan.neurons)
        else:
            name, row = "work", plan.stored[node]
        found = self.known[node, offset] = self.at_neighbour(name, row, offset)
        return found

    def at_neighbour(self, name: str, row: int, offset: int) -> str:
        """Load a row of a ghosted table at the current stages or at those of a neighbour."""
        f, w = self.f, self.f.width
        chunks, lanes = divmod(offset, w) if self.is_row else (offset, 0)
        there = f.load(self.row(name, row, chunks))
        if lanes == 0:
            return there
        return f.shuffle(there, f.load(self.row(name, row, chunks + 1)), range(lanes, lanes + w))

    def _arriving(self, first: int, last: int) -> str:
        """Write the sum of some connections."""
        f, plan, total = self.f, self.plan, None
        for edge in sorted(range(first, last), key=lambda e: plan.unit[e] != 1):
            source, offset = self.tape.sources[edge].tolist()
            v, unit = self.value(source, offset), plan.unit[edge]
            if unit == 1:
                total = v if total is None else f.op("fadd", total, v)
            elif unit == -1:
                total = f.op("fneg", v) if total is None else f.op("fsub", total, v)
            else:
                weight = self.number("weights", plan.weighted[edge])
                total = f.op("fmul", weight, v) if total is None else f.fma(weight, v, total)
        return total or f.constant(0.0)

    def _phase(self, phase: int) -> None:
        """Write all blocks and net inputs of a phase."""
        plan = self.plan
        for step, node in enumerate(self.tape.blocks[:, 1].tolist()):
            if plan.phase[node] == phase:
                found = self.known[node, 0] = self.block(step)
                if node in plan.stored:
                    found = self.where_alive(found) if self.is_row else found
                    self.f.store(found, self.row("work", plan.stored[node]))
        for row, at in enumerate(plan.drive_phase):
            if at == phase:
                self._drive(row)

    def block(self, step: int) -> str:
        """Write the value of a block."""
        kind, _, a, b = self.tape.blocks[step].tolist()
        if kind == SUM:
            return self._arriving(a, b)
        if kind == PRODUCT:
            return self.f.op("fmul", self.value(a), self.value(b))
        if step in self.plan.guarded:
            self.watch(step, a, self.value(b))
        return function_of(self.f, a, self.value(b), self.circular)

    def where_alive(self, value: str) -> str:
        """Select zero beyond the end of the row."""
        alive = self.f.compare("une", self.f.load(self.row("alive", 0)), self.f.constant(0.0))
        return self.f.select(alive, value, self.f.constant(0.0))

    def watch(self, step: int, code: int, argument: str) -> None:
        """Record the lanes in which a function block is outside its domain."""
        f, (low, high) = self.f, FUNCTIONS[code].domain
        side, zero = f.load(self.row("sides", self.plan.guarded[step])), f.constant(0.0)
        inside = f.logical(
            "or",
            f.compare("oeq", side, zero),
            f.compare("ogt", f.op("fmul", argument, side), zero),
        )
        inside = f.logical("and", inside, f.compare("ogt", argument, f.constant(low)))
        inside = f.logical("and", inside, f.compare("olt", argument, f.constant(high)))
        bad = f.select(inside, zero, f.constant(1.0))
        if self.is_row:
            bad = self.where_alive(bad)
        f.store(f.call("maxnum", f.load(self.outside), bad), self.outside)

    def _drive(self, row: int) -> None:
        """Write the net input of a neuron and its derivative without the coupling."""
        f = self.f
        rate = self.number("rates", row)
        drive = self._arriving(*self.tape.drives[row].tolist())
        if row in self.plan.shared:
            self.buses.add(row, self.where_alive(drive) if self.is_row else drive)
            drive = f.constant(0.0)
        drive = f.select(f.compare("oeq", rate, f.constant(0.0)), f.constant(0.0), drive)
        drive = self._at_limits(row, drive)
        f.store(drive, self.row("drives", row))
        f.store(f.op("fmul", rate, drive), self.row("out", row))

    def _at_limits(self, row: int, derivative: str) -> str:
        """Cut a net input that leads past the limit of an uncoupled neuron."""
        if row not in self.cut:
            return derivative
        f, state, zero = self.f, self.value(row), self.f.constant(0.0)
        down = f.logical(
            "and", f.compare("ole", state, self._limit(row, 0)), f.compare("olt", derivative, zero)
        )
        up = f.logical(
            "and", f.compare("oge", state, self._limit(row, 1)), f.compare("ogt", derivative, zero)
        )
        return f.select(f.logical("or", down, up), zero, derivative)


JACOBIAN_FIELDS = (*FIELDS, "slots")
"""Arrays that the code reads and fills, in the order of the table of addresses."""
JACOBIAN_NAMES = "cell", "jacobian"
"""The functions of a piece of code."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slots:
    """Derivatives of a wiring, sorted like the blocks of a `Plan` of stages."""

    plan: Plan

    @cached_property
    def operations(self) -> list[list[int]]:
        """Target, source, offset, kind and index of the factor of every operation."""
        return self.plan.tape.slots.tolist()

    @cached_property
    def phase(self) -> dict[int, int]:
        """Phase of every computed slot; the slots of the neurons themselves are one."""
        phase: dict[int, int] = {}
        for target, source, offset, *_ in self.operations:
            after = phase.get(source, 0) + (offset != 0 and source >= self.plan.neurons)
            phase[target] = max(phase.get(target, 0), after)
        return phase

    @cached_property
    def stored(self) -> dict[int, int]:
        """Row in the table of slots of each slot read by a neighbour or a later phase."""
        kept = {
            source
            for target, source, offset, *_ in self.operations
            if source in self.phase and (offset != 0 or self.phase[source] != self.phase[target])
        }
        return {slot: row for row, slot in enumerate(sorted(kept))}

    @cached_property
    def used(self) -> dict[int, int]:
        """Row in the returned table, by slot, for slots of an entry."""
        return {slot: row for row, slot in enumerate(np.unique(self.plan.tape.entries[:, 2]))}

    @cached_property
    def key(self) -> str:
        """Key of the code."""
        own = JACOBIAN_NAMES, self.operations, list(map(int, self.used))
        return key_of((*own, *self.plan.cell_identity()), WRITERS)


@lru_cache(maxsize=64)
def slots_of(plan: Plan) -> Slots:
    """Return the sorted derivatives of a plan (cached)."""
    return Slots(plan=plan)


def jacobian_code(slots: Slots) -> str:
    """Return the LLVM text of ``cell`` and ``jacobian``.

    The functions are ``i64 cell(table, x, derivatives)`` and ``jacobian(table, x, out)``. Call
    ``jacobian`` after ``cell``.
    """
    module = Module()
    _CellWriter(slots.plan, module, "cell").write_cell(is_cut=False)  # for its blocks alone
    _JacobianWriter(slots, module).write()
    return module.text()


class _JacobianWriter(_CellWriter):
    """Writer of ``jacobian``; blocks are computed when a factor needs them."""

    def __init__(self, slots: Slots, module: Module) -> None:
        super().__init__(slots.plan, module, "jacobian")
        self.slots, self.entry = slots, dict[int, str]()
        self.step = {node: step for step, node in enumerate(self.tape.blocks[:, 1].tolist())}
        self.base["slots"] = self.f.field("%table", JACOBIAN_FIELDS.index("slots"))
        self.rows |= {"out": len(slots.used), "slots": len(slots.stored)}

    def write(self) -> None:
        for phase in range(1 + max(self.slots.phase.values(), default=0)):
            with self.f.loop(self.base["chunks"]) as chunk:
                self.begin(chunk)
                self.entry = {}
                operations = [
                    operation
                    for operation in self.slots.operations
                    if self.slots.phase[operation[0]] == phase
                ]
                last = {operation[0]: number for number, operation in enumerate(operations)}
                for number, (slot, *rest) in enumerate(operations):
                    self._add(slot, *rest)
                    if last[slot] == number:  # at once: what waits for the end fills the registers
                        self._keep(slot, self.entry[slot])
        self.f.done()

    def watch(self, step: int, code: int, argument: str) -> None:
        """Skip the domain check, which ``cell`` has made."""

    def value(self, node: int, offset: int = 0) -> str:
        """Return a node at the current or neighbouring stages, computed on first use."""
        is_new = (node, offset) not in self.known and node > self.plan.one
        if is_new and offset == 0 and node not in self.plan.stored:
            self.known[node, 0] = self.block(self.step[node])
        return super().value(node, offset)

    def _add(self, target: int, source: int, offset: int, kind: int, index: int) -> None:
        """Write d(target) += factor * d(source)."""
        f, total = self.f, self.entry.get(target)
        share = None if source < self.plan.neurons else self._read(source, offset)
        unit = self.plan.unit[index] if kind == BY_WEIGHT else 0
        if unit and share:
            term = share if unit > 0 else f.op("fneg", share)
        elif unit:
            term = f.constant(float(unit))
        else:
            factor = self._factor(kind, index)
            if share and total:
                self.entry[target] = f.fma(factor, share, total)
                return
            term = f.op("fmul", factor, share) if share else factor
        self.entry[target] = f.op("fadd", total, term) if total else term

    def _factor(self, kind: int, index: int) -> str:
        if kind == BY_WEIGHT:
            return self.number("weights", self.plan.weighted[index])
        if kind == BY_VALUE:
            return self.value(index)
        _, node, code, argument = self.tape.blocks[index].tolist()
        return slope_of(self.f, code, self.value(argument), self.value(node), self.circular)

    def _read(self, slot: int, offset: int) -> str:
        """Return a slot of this phase, of an earlier phase or of a neighbour."""
        if offset == 0 and slot in self.entry:
            return self.entry[slot]
        return self.at_neighbour("slots", self.slots.stored[slot], offset)

    def _keep(self, slot: int, found: str) -> None:
        """Store a slot that others read."""
        if slot in self.slots.stored:
            self.f.store(self.where_alive(found), self.row("slots", self.slots.stored[slot]))
        if slot in self.slots.used:
            self.f.store(found, self.row("out", self.slots.used[slot]))
