"""A network's compiled evaluator, with the workspaces that `compiled` needs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ann_dc.evaluation import loops as compiled
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network


class CompiledEvaluator:
    """A tape's compiled evaluator with its workspaces (so: one a thread).

    ``tape`` replaces the network's own by one with other numbers (a trial of other gains).
    """

    def __init__(self, network: Network, tape: Tape | None = None) -> None:
        self.network = network
        self.program = evaluator(network)
        self.tape = tape = tape or self.program.tape
        self._values = tape.values.copy()
        self._drives = np.zeros(tape.rates.shape)
        self._moves = np.zeros(tape.rates.shape)
        self._grid = np.zeros((max(int(tape.levels[-1]), 1), max(len(tape.chains), 1)))
        self._slots = np.zeros(tape.slot_start.shape)
        self._data = np.zeros(len(tape.entries))

    def set_inputs(self, rows: np.ndarray, values: np.ndarray) -> None:
        """From now on the inputs in ``rows`` of ``program.nodes`` have these values (rows, N)."""
        self._values[rows, 1:-1] = values

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (n,)."""
        out = np.empty(len(x))
        compiled.rhs(self.tape, x, self._values, self._drives, self._moves, self._grid, out)
        return out

    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (neurons, N), before its time constant."""
        compiled.evaluate(self.tape, x, self._values, self._drives)
        return self._drives.copy()

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values (nodes, N + 2) of every node."""
        compiled.evaluate(self.tape, x, self._values, self._drives)
        return self._values.copy()

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Relative constraint and stationarity residuals."""
        compiled.evaluate(self.tape, x, self._values, self._drives)
        return compiled.residuals(self.tape, self._values, self._drives)

    def metric(self, drive: np.ndarray) -> np.ndarray:
        """M drive (n,): time constants and coordinators."""
        out = np.empty(len(drive))
        compiled.apply_metric(self.tape, drive, self._drives, self._moves, self._grid, out)
        return out

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of d drive / dx (nnz,), in the order of ``tape.entries``; zero at a rail."""
        compiled.evaluate(self.tape, x, self._values, self._drives)
        compiled.drive_jacobian(self.tape, self._values, self._slots, self._data)
        return np.where(
            self.program.stopped(x, self._drives)[self.tape.entries[:, 0]], 0, self._data
        )

    def drive_jacobian(self, x: np.ndarray) -> Any:
        """d drive / dx as a sparse (n, n) matrix."""
        return self.program.sparse(self.jacobian_entries(x))

    def fastest_rate(self, x: np.ndarray, iterations: int = 20) -> float:
        """Estimate of the spectral radius of d rhs / dx at a state, by power iterations."""
        jacobian = self.drive_jacobian(x)
        v = np.random.default_rng(0).standard_normal(len(x))
        growth = 1.0
        for _ in range(iterations):
            size = float(np.linalg.norm(v))
            if not (np.isfinite(size) and size > 0):
                break
            v = self.metric(np.ascontiguousarray(jacobian @ (v / size)))
            growth = float(np.linalg.norm(v))
        return growth if np.isfinite(growth) and growth > 0 else 1.0

    def domain_guard(self, x: np.ndarray) -> DomainGuard:
        """Watches the domains of all function blocks, from a start on."""
        return DomainGuard.at(self.tape, self.values(x))

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """(block, stage) of the first function block outside its domain, or (-1, -1)."""
        compiled.evaluate(self.tape, x, self._values, self._drives)
        return compiled.first_outside(self.tape, self._values, guard.domains, guard.signs)

    def recur(
        self,
        x: np.ndarray,
        step: float,
        slew: np.ndarray,
        bounds: np.ndarray,
        count: int,
        tolerance: float,
        guard: DomainGuard,
    ) -> tuple[int, float, int]:
        """Forward Euler steps on ``x`` in place; see `compiled.recur`."""
        return compiled.recur(
            self.tape,
            x,
            step,
            slew,
            bounds,
            count,
            tolerance,
            guard.domains,
            guard.signs,
            self._values,
            self._drives,
            self._moves,
            self._grid,
        )
