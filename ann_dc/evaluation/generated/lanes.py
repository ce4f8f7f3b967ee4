"""The numbers of a network as generated code reads them, and the way there and back.

A table holds (chunks, rows, lanes) numbers; see `cell_code` for what a chunk is. Tables that are
read as neighbours see them have a ghost chunk at either end.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.cell_code import FIELDS, INTEGERS, NAMES, cell_code
from ann_dc.evaluation.generated.metric_tables import pyramid_tables, stiffness_tables
from ann_dc.evaluation.generated.plan import Axis, Plan
from ann_dc.evaluation.tape import Tape
from ann_dc.evaluation.vector_code.code import code, is_there, key_of
from ann_dc.evaluation.vector_code.memory import lined_up


class Entry(NamedTuple):
    """A network as an integrator of generated code takes it: addresses and sizes."""

    rhs: int
    """Address of ``rhs``."""
    residuals: int
    """Address of ``residuals``."""
    cell: int
    """Address of ``cell``."""
    metric: int
    """Address of ``metric``."""
    rails: int
    """Address of ``rails``."""
    table: np.ndarray
    """Addresses and integers of all tables."""
    found: np.ndarray
    """(3 lanes,): what ``residuals`` gives; of a single network the first three."""
    ghost: int
    """Numbers of a ghost chunk of a state."""
    size: int
    """Numbers of a state without ghosts."""
    live: int
    """n, the neurons among them that move."""


class Lanes:
    """Tables of one network, or of as many samples as there are lanes (one a thread).

    Parameters
    ----------
    tape : Tape
    axis : Axis

    Attributes
    ----------
    plan : Plan
        Whose code reads them.
    tables : dict of str to array
        By their names in ``FIELDS``.
    """

    def __init__(self, tape: Tape, axis: Axis) -> None:
        self.tape, self.plan = tape, Plan(tape=tape, axis=axis)
        self.lanes, self.neurons = axis.lanes, self.plan.neurons
        self.stages = tape.rates.shape[1]
        self.chunks = -(-self.stages // self.lanes) if axis is Axis.STAGES else self.stages
        self.size = self.chunks * self.neurons * self.lanes
        self.spare = -(-self.size // 64) * 64 + 64
        """Numbers of a table of moves: a reserve for what nobody looks at, and whole blocks."""
        self.tables = self._tables()

    @cached_property
    def key(self) -> str:
        """Of the code."""
        return key_of(self.plan.identity(), Path(__file__).parent)

    @property
    def is_compiled(self) -> bool:
        """Whether the code is there already."""
        return is_there(self.key)

    @cached_property
    def entry(self) -> Entry:
        """Addresses for an integrator; compiles the code where it is not there."""
        found = self._code
        table = [
            int(self.tables[name].item()) if name in INTEGERS else self.tables[name].ctypes.data
            for name in FIELDS
        ]
        return Entry(
            rhs=found["rhs"],
            residuals=found["residuals"],
            cell=found["cell"],
            metric=found["metric"],
            rails=found["rails"],
            table=np.array(table, np.int64),
            found=lined_up(np.zeros(3 * self.lanes)),
            ghost=self.neurons * self.lanes,
            size=self.size,
            live=len(self.tape.places),
        )

    @cached_property
    def _code(self) -> dict[str, int]:
        return code(self.key, lambda: cell_code(self.plan), NAMES)

    def beside(self) -> Lanes:
        """The same with tables of its own, for another thread."""
        other = copy(self)
        other.__dict__.pop("entry", None)
        other.tables = {name: lined_up(table) for name, table in self.tables.items()}
        return other

    # ---- tables ------------------------------------------------------------------------------

    def _tables(self) -> dict[str, np.ndarray]:
        tape, plan = self.tape, self.plan
        tables = {
            "first": np.array(0),
            "chunks": np.array(self.chunks),
            "inputs": self.ghosted(tape.values[plan.neurons : plan.one]),
            "work": self.ghosted(tape.values[list(plan.stored)]),
            "weights": self._numbers(tape.weights[list(plan.weighted)]),
            "rates": self._numbers(tape.rates),
            "drives": np.zeros(self.spare),
            "sides": self._inner(np.zeros((len(plan.guarded), self.stages))),
            "alive": self._inner(np.ones((1, self.stages))),
            "limits": np.ascontiguousarray(tape.limits),
        }
        tables |= {name: np.zeros(1) for name in FIELDS if name not in tables}
        metric: dict[str, np.ndarray] = {}
        if plan.chains:
            metric = pyramid_tables(tape, is_coupled=plan.is_coupled)
        elif plan.has_stiffness:
            metric = stiffness_tables(tape)
        if metric:
            metric["places"] = self._addresses(metric["places"])
            width = metric["places"].shape[-1] * self.lanes * 2 + 8
            metric["nodes"] = np.zeros(len(metric["nodes"]) * width)
        return {name: lined_up(table) for name, table in (tables | metric).items()}

    def _addresses(self, places: np.ndarray) -> np.ndarray:
        """Where (..., 2) neurons at stages lie in a table without ghosts; -1 in the reserve."""
        neuron, stage = places[..., 0], places[..., 1]
        chunk, lane = stage, 0
        if self.plan.axis is Axis.STAGES:
            chunk, lane = stage // self.lanes, stage % self.lanes
        at = (chunk * self.neurons + neuron) * self.lanes + lane
        return np.where(neuron < 0, self.spare - 64, at).astype(np.int64)

    def _inner(self, rows: np.ndarray) -> np.ndarray:
        """(R, N) as a table without ghosts."""
        if self.plan.axis is Axis.SAMPLES:
            return np.repeat(rows.T[:, :, None], self.lanes, axis=2)
        table = np.zeros((len(rows), self.chunks * self.lanes))
        table[:, : self.stages] = rows
        table = table.reshape(len(rows), self.chunks, self.lanes)
        return np.ascontiguousarray(table.transpose(1, 0, 2))

    def _numbers(self, rows: np.ndarray) -> np.ndarray:
        """(R, N) weights or rates: the same for all samples."""
        return np.ascontiguousarray(rows.T) if self.plan.axis is Axis.SAMPLES else self._inner(rows)

    def ghosted(self, rows: np.ndarray) -> np.ndarray:
        """(R, N + 2) as a table with ghosts."""
        if self.plan.axis is Axis.SAMPLES:
            return np.repeat(np.ascontiguousarray(rows.T)[:, :, None], self.lanes, axis=2)
        table = np.zeros((self.chunks + 2, len(rows), self.lanes))
        table[1:-1] = self._inner(rows[:, 1:-1])
        table[0, :, -1] = rows[:, 0]
        return table

    # ---- states ------------------------------------------------------------------------------

    @cached_property
    def components(self) -> np.ndarray:
        """(n,) integers: where the components of a state vector lie in a table without ghosts."""
        return self._addresses(self.tape.places)

    def state(self, x: np.ndarray) -> np.ndarray:
        """A state vector (n,) as a table with ghosts, flat; pins and ends are those of the tape."""
        values = self.tape.values[: self.neurons].copy()
        values[self.tape.places[:, 0], self.tape.places[:, 1] + 1] = x
        return self.ghosted(values).ravel()

    def watch(self, guard: DomainGuard) -> None:
        """From now on reciprocals keep these sides of their poles."""
        self.tables["sides"][:] = self._inner(guard.signs[list(self.plan.guarded)])
