"""Tables of a network as generated code reads them, with conversions of states.

A table contains (chunks, rows, lanes) numbers; `cell_code` defines a chunk. Tables that neighbours
read have ghost chunks at either end, as many as the farthest connection needs.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.codegen.cell_code import (
    FIELDS,
    GIVEN,
    JACOBIAN_FIELDS,
    JACOBIAN_NAMES,
    NAMES,
    cell_code,
    jacobian_code,
    slots_of,
)
from ann_dc.evaluation.codegen.code import code
from ann_dc.evaluation.codegen.memory import lined_up
from ann_dc.evaluation.codegen.plan import Axis, Plan, pyramid_tables, stiffness_tables
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.lane_clamps import LaneClamps, clamp_code
from ann_dc.evaluation.tape import Tape


class Entry(NamedTuple):
    """Addresses and sizes of a network for an integrator of generated code."""

    rhs: int
    """Address of ``rhs``."""
    residuals: int
    """Address of ``residuals``."""
    cell: int
    """Address of ``cell``."""
    preconditioner: int
    """Address of ``preconditioner``."""
    projection: int
    """Address of ``projection``."""
    keep: int
    """Address of ``keep``."""
    table: np.ndarray
    """Addresses and integers of all tables."""
    found: np.ndarray
    """Results of ``residuals`` (3 lanes,); the first three for a single network."""
    ghost: int
    """Numbers of the ghosts at an end of a state."""
    size: int
    """Numbers of a state without ghosts."""
    live: int
    """Number n of live neurons."""


class _JacobianEntry(NamedTuple):
    """Generated code for d drive / dx of a network."""

    cell: int
    """Address of ``cell``."""
    jacobian: int
    """Address of ``jacobian``, called after ``cell``."""
    table: np.ndarray
    """Addresses and integers of all tables."""
    found: np.ndarray
    """Derivatives, one row per slot."""
    chosen: np.ndarray
    """Places of the entries among the derivatives (nnz,)."""


_NOTHING = np.zeros(1)
"""Table that no code reads."""


class Lanes:
    """Tables of one network, or of one sample per lane; use one object per thread.

    An existing plan that serves the tape may be given. ``tables`` contains the tables by their
    names in ``FIELDS``. ``derivatives`` is the result dx/ds of a single call, in a table without
    ghosts.
    """

    def __init__(self, tape: Tape, axis: Axis, plan: Plan | None = None) -> None:
        self.tape, self.plan = tape, plan or Plan(tape=tape, axis=axis)
        self.lanes, self.neurons = axis.lanes, self.plan.neurons
        self.stages = tape.rates.shape[1]
        self.chunks = -(-self.stages // self.lanes) if axis is Axis.STAGES else self.stages
        self.size = self.chunks * self.neurons * self.lanes
        self.ghost = self.plan.ghosts * self.neurons * self.lanes
        beyond = self.neurons * self.lanes if self.plan.has_stiffness else self.lanes
        self.reserve, room = (-(-n // 64) * 64 for n in (self.size, beyond))
        """Place behind all cells in a table of derivatives, in whole blocks, that no code reads."""
        self.spare = self.reserve + room
        """Numbers of such a table; a stiffness has room for a cell more."""
        self.tables = self._tables()
        self.derivatives = np.zeros(self.spare)
        self._clamps: LaneClamps | None = None

    def renumber(self, tape: Tape) -> bool:
        """Copy the numbers of another tape of the same network.

        Returns True if the same code serves the tape; otherwise nothing is copied.
        """
        if tape.values is not self.tape.values or not self.plan.serves(tape):
            return False
        before, self.tape = self.tape, tape
        if tape.weights is not before.weights:
            self.tables["weights"][...] = self._numbers(tape.weights[list(self.plan.weighted)])
        if tape.rates is not before.rates:
            self.tables["rates"][...] = self._numbers(tape.rates)
        parts = ("rates", "grids", "shares", "factor")
        is_moved = any(getattr(tape, part) is not getattr(before, part) for part in parts)
        if is_moved and "entry" in self.__dict__:
            for name, table in self._preconditioner().items():
                self.tables[name][...] = table
            if self._clamps is not None:
                self._clamps.renumber(tape)
        return True

    @cached_property
    def entry(self) -> Entry:
        """Addresses for an integrator; compiles the code if needed."""
        found = self._code
        self.tables |= self._preconditioner() | self._clamp_tables()
        return Entry(
            rhs=found["rhs"],
            residuals=found["residuals"],
            cell=found["cell"],
            preconditioner=found["preconditioner"],
            projection=found["projection"],
            keep=found["keep"],
            table=self._addresses_of(FIELDS),
            found=lined_up(np.zeros(3 * self.lanes)),
            ghost=self.ghost,
            size=self.size,
            live=len(self.tape.places),
        )

    @cached_property
    def _code(self) -> dict[str, int]:
        return code(self.plan.key, lambda: cell_code(self.plan), NAMES)

    @cached_property
    def jacobian(self) -> _JacobianEntry:
        """Addresses for d drive / dx; compiles the code if needed."""
        slots, (slot, stage) = slots_of(self.plan), self.tape.entries[:, 2:].T
        found = code(slots.key, lambda: jacobian_code(slots), JACOBIAN_NAMES)
        chunks = self.chunks + 2 * self.plan.ghosts
        self.tables["slots"] = np.zeros(chunks * len(slots.stored) * self.lanes)
        rows = np.array([slots.used[s] for s in slot.tolist()], np.int64)
        return _JacobianEntry(
            cell=found["cell"],
            jacobian=found["jacobian"],
            table=self._addresses_of(JACOBIAN_FIELDS),
            found=np.zeros(self.chunks * max(len(slots.used), 1) * self.lanes),
            chosen=self._places(rows, stage, len(slots.used)),
        )

    def _addresses_of(self, fields: tuple[str, ...]) -> np.ndarray:
        """Return the addresses of the named tables, or their numbers."""
        tables = [self.tables.get(name, _NOTHING) for name in fields]
        return np.array(
            [
                int(table.item()) if name in GIVEN else table.ctypes.data
                for name, table in zip(fields, tables)
            ],
            np.int64,
        )

    def beside(self) -> Lanes:
        """Return equal lanes with separate tables, for another thread."""
        other = copy(self)
        for made in ("entry", "jacobian"):
            other.__dict__.pop(made, None)
        other.tables = {name: lined_up(table) for name, table in self.tables.items()}
        other.derivatives = np.zeros(self.spare)
        return other

    # ---- tables ------------------------------------------------------------------------------

    def _tables(self) -> dict[str, np.ndarray]:
        tape, plan = self.tape, self.plan
        tables = {
            "first": np.array(0),
            "chunks": np.array(self.chunks),
            "last": self._places(np.array(0), np.array(self.stages - 1), self.neurons),
            "inputs": self.ghosted(tape.values[plan.neurons : plan.one]),
            "work": self.ghosted(tape.values[list(plan.stored)]),
            "weights": self._numbers(tape.weights[list(plan.weighted)]),
            "rates": self._numbers(tape.rates),
            "drives": np.zeros(self.spare),
            "sides": self._inner(np.zeros((len(plan.guarded), self.stages))),
            "alive": self._inner(np.ones((1, self.stages))),
            "limits": tape.limits,
        }
        if plan.clamped:
            tables["walls"] = self._walls()
        if plan.has_roots:
            tables |= {"roots": np.ones(self.spare), "pushed": np.zeros(self.spare)}
        return {name: lined_up(table) for name, table in tables.items()}

    def _preconditioner(self) -> dict[str, np.ndarray]:
        """Return the tables that only a preconditioner reads."""
        tape, plan = self.tape, self.plan
        if plan.chains:
            preconditioner = pyramid_tables(tape, is_coupled=plan.is_coupled)
            width = plan.chains * self.lanes * 2 + 8
            preconditioner["nodes"] = np.zeros(len(preconditioner["nodes"]) * width)
        elif plan.has_stiffness:
            preconditioner = stiffness_tables(tape)
        else:
            return {}
        for name in preconditioner.keys() & {"places", "gap_places"}:
            preconditioner[name] = self._addresses(preconditioner[name])
        return {name: lined_up(table) for name, table in preconditioner.items()}

    def _clamp_tables(self) -> dict[str, np.ndarray]:
        """Return the clamp tables for coupled neurons at saturation limits."""
        if not self.plan.clamped:
            return {}
        tape, at = self.tape, np.full(self.tape.rates.shape, -1)
        at[tuple(tape.places.T)] = self.components
        tables = self.tables
        given = {name: tables[name].ravel() for name in ("drives", "roots") if name in tables}
        if self.plan.axis is Axis.VARIANTS:
            given["rates_of_lanes"] = self.tables["rates"].ravel()
        state_at = np.where(at < 0, -1, at + self.ghost)
        lanes = 1 if self.plan.axis is Axis.STAGES else self.lanes
        self._clamps = LaneClamps(tape, at, state_at, lanes, given)
        return {"clamps": self._clamps.table, "clamp": np.array(clamp_code().address)}

    def _walls(self) -> np.ndarray:
        """Return the limits of coupled neurons, infinite for omitted neurons."""
        tape, rows = self.tape, list(self.plan.clamped)
        limits = np.where(tape.rates[rows, :, None] > 0, tape.limits[rows, None], [-np.inf, np.inf])
        walls = limits.transpose(0, 2, 1).reshape(-1, self.stages)
        there = self._numbers(np.ones(walls.shape))
        none = np.resize([-np.inf, np.inf], len(walls))[:, None]
        return np.where(there > 0, self._numbers(walls), none)

    def _addresses(self, places: np.ndarray) -> np.ndarray:
        """Return the places of neurons at stages (..., 2) in a table without ghosts.

        Missing neurons have the place -1 in the reserve.
        """
        neuron, stage = places[..., 0], places[..., 1]
        at = self._places(neuron, stage, self.neurons)
        return np.where(neuron < 0, self.reserve, at).astype(np.int64)

    def _places(self, row: np.ndarray, stage: np.ndarray, rows: int) -> np.ndarray:
        """Return the place of a row at a stage in a table with a number of rows."""
        chunk, lane = stage, 0
        if self.plan.axis is Axis.STAGES:
            chunk, lane = stage // self.lanes, stage % self.lanes
        return (chunk * rows + row) * self.lanes + lane

    def _inner(self, rows: np.ndarray) -> np.ndarray:
        """Convert (R, N) to a table without ghosts."""
        if self.plan.axis is not Axis.STAGES:
            return np.repeat(rows.T[:, :, None], self.lanes, axis=2)
        table = np.zeros((len(rows), self.chunks * self.lanes))
        table[:, : self.stages] = rows
        table = table.reshape(len(rows), self.chunks, self.lanes)
        return np.ascontiguousarray(table.transpose(1, 0, 2))

    def _numbers(self, rows: np.ndarray) -> np.ndarray:
        """Convert (R, N) weights or rates; numbers equal for all samples are stored once."""
        if self.plan.axis is Axis.SAMPLES:
            return np.ascontiguousarray(rows.T)[:, :, None]
        return self._inner(rows)

    def ghosted(self, rows: np.ndarray) -> np.ndarray:
        """Convert (R, N + 2) to a table with ghosts."""
        ghosts = self.plan.ghosts
        table = np.zeros((self.chunks + 2 * ghosts, len(rows), self.lanes))
        if self.plan.axis is Axis.STAGES:
            table[ghosts:-ghosts] = self._inner(rows[:, 1:-1])
            table[ghosts - 1, :, -1] = rows[:, 0]
        else:
            self.near(table)[:] = rows.T[:, :, None]
        return table

    def near(self, table: np.ndarray) -> np.ndarray:
        """Return the N + 2 chunks of a table with ghosts that have values; a lane is a sample."""
        return table[self.plan.far - 1 : len(table) - self.plan.far + 1]

    def ghosted_place(self, stage: int, row: int, table: str) -> int:
        """Return the place of a row in a table with ghosts, ``x``, ``inputs`` or ``work``.

        Stages begin at -1, before the first cell. A lane must be a sample.
        """
        rows = self.neurons if table == "x" else self.tables[table].shape[1]
        return ((stage + self.plan.far) * rows + row) * self.lanes

    # ---- states ------------------------------------------------------------------------------

    @cached_property
    def components(self) -> np.ndarray:
        """Places (n,) of the state components in a table without ghosts."""
        return self._addresses(self.tape.places)

    @cached_property
    def inner(self) -> np.ndarray:
        """Places of the state components in a table with ghosts, (n,) or (W, n)."""
        places = self.components + self.ghost
        if self.plan.axis is Axis.STAGES:
            return places
        return places + np.arange(self.lanes)[:, None]

    @cached_property
    def _pinned(self) -> np.ndarray:
        return self.ghosted(self.tape.values[: self.neurons]).ravel()

    def state(self, x: np.ndarray) -> np.ndarray:
        """Convert a state (n,) to a flat table with ghosts, pins and ends of the tape."""
        table = self._pinned.copy()
        table[self.inner] = x
        return table

    def watch(self, guard: DomainGuard) -> None:
        """Set the pole sides that reciprocals must preserve."""
        self.tables["sides"][:] = self._inner(guard.signs[list(self.plan.guarded)])
