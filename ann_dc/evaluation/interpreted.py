"""Evaluator that interprets the tape in loops, compiled once for all networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from ann_dc.evaluation import loops
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import Bounds, DomainGuard
from ann_dc.evaluation.lane_clamps import LaneClamps, clamp_code
from ann_dc.evaluation.pivots import clamped_derivative
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import Tape
from ann_dc.network.cell import ONE
from ann_dc.network.network import Network


@final
class InterpretedEvaluator(Evaluator):
    """Evaluator with loops over a tape, for any wiring; use one evaluator per thread.

    Every call overwrites the workspace ``work``. An optional tape replaces the network's tape by
    other numbers (a trial of other gains). `fast_evaluator` returns generated code if available.
    """

    def __init__(self, network: Network, tape: Tape | None = None) -> None:
        super().__init__(network, tape or evaluator(network).tape)
        self.renumber(self.tape)
        self._slots = np.zeros(self.tape.slot_start.shape)
        self._data = np.zeros(len(self.tape.entries))

    def renumber(self, tape: Tape) -> None:
        """Replace the tape by another tape of the same network."""
        shape = tape.rates.shape
        self.tape, self._planes, clamp = tape, np.zeros((3, *shape)), np.zeros(2, np.int64)
        if np.isfinite(tape.limits[tape.reached]).any():
            places = np.full(shape, -1), np.full(shape, -1)
            for table, width, first in zip(places, (shape[1], shape[1] + 2), (0, 1)):
                neuron, stage = tape.places.T
                table[neuron, stage] = neuron * width + stage + first
            self._clamps = LaneClamps(tape, *places, 1, {"drives": self._planes[2].ravel()})
            clamp[:] = clamp_code().address, self._clamps.table.ctypes.data
        self.work = loops.workspace(tape, self._planes, clamp)

    def set_inputs(self, rows: np.ndarray, values: np.ndarray) -> None:
        """Replace the values (inputs, N) of some inputs, in network units.

        The rows (inputs,) are those of `node_index`.
        """
        self.work.values[rows, 1:-1] = values

    def load(self, values: np.ndarray) -> None:
        """Replace all constant values (nodes, N + 2), of `tape.constant_values`."""
        last = self.network.node_index[ONE]
        self.work.values[:last] = values[:last]
        self.work.values[:, 0] = values[:, 0]

    # ---- the contract ------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (nodes, N + 2) of all nodes."""
        loops.evaluate(self.tape, self.work, x)
        return self.work.values.copy()

    def drives(self, x: np.ndarray) -> np.ndarray:
        """Return the net inputs (neurons, N)."""
        loops.evaluate(self.tape, self.work, x)
        return self.work.drives.copy()

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """Return dx/ds (n,)."""
        out = np.empty(len(x))
        work = self.work
        arrays = work.values, self._planes, work.nodes, work.clamp
        loops.rhs_of_arrays(self.tape, x, *arrays, out)
        return out

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Return the relative (constraint, stationarity) residuals."""
        loops.evaluate(self.tape, self.work, x)
        return loops.residuals(self.tape, self.work)

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Return the entries (nnz,) of d drive / dx; zero at a saturation limit."""
        loops.drive_jacobian(self.tape, self.work, x, self._slots, self._data)
        saturated = self.saturated(x, self.work.drives)
        return np.where(saturated[self.tape.entries[:, 0]], 0, self._data)

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """Return (block, stage) of the first block outside its domain, or (-1, -1)."""
        loops.evaluate(self.tape, self.work, x)
        return loops.first_outside(self.tape, self.work, guard)

    # ---- what loops can do besides -----------------------------------------------------------

    def derivative(self, drive: np.ndarray) -> np.ndarray:
        """Multiply net inputs (n,) by M."""
        out = np.empty(len(drive))
        loops.apply_preconditioner(self.tape, self.work, drive, out)
        return out

    def clamped(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return `derivative` with some neurons held."""
        return clamped_derivative(self.tape, held) or self.derivative

    def recur(
        self, x: np.ndarray, step: float, bounds: Bounds, *, count: int, tolerance: float
    ) -> tuple[int, float, int]:
        """Run forward Euler steps on a state (n,) in place; see `loops.recur`.

        At most ``count`` steps of length ``step`` (in network time) are done. A state with a
        relative residual of at most the tolerance is settled. Returns the number of steps, the
        residual, and `RAN`, `SETTLED` or `LOST`.
        """
        return loops.recur(self.tape, self.work, x, step, bounds, count, tolerance)
