"""A network as loops over its tape evaluate it, compiled once for all networks."""

from __future__ import annotations

from collections.abc import Callable
from typing import final

import numpy as np

from ann_dc.evaluation import loops
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import Bounds, DomainGuard
from ann_dc.evaluation.lane_clamps import LaneClamps, clamp_code
from ann_dc.evaluation.pivots import clamped_moves
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network


@final
class InterpretedEvaluator(Evaluator):
    """Loops over a tape, with their workspaces (so: one a thread).

    They take any wiring; `fast_evaluator` gives generated code where there is such.

    Parameters
    ----------
    network : Network
    tape : Tape, optional
        Replaces the network's own by one with other numbers (a trial of other gains).

    Attributes
    ----------
    work : Workspace
        Arrays that every call overwrites.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> x = network.start_state
    >>> bool(np.allclose(InterpretedEvaluator(network).rhs(x), evaluator(network).rhs(x)))
    True
    """

    def __init__(self, network: Network, tape: Tape | None = None) -> None:
        super().__init__(network, tape or evaluator(network).tape)
        self.renumber(self.tape)
        self._slots = np.zeros(self.tape.slot_start.shape)
        self._data = np.zeros(len(self.tape.entries))

    def renumber(self, tape: Tape) -> None:
        """From now on with other numbers.

        Parameters
        ----------
        tape : Tape
            Of the same network.
        """
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
        """From now on some inputs have other values.

        Parameters
        ----------
        rows : (inputs,) array of int
            Which, as rows of ``node_index``.
        values : (inputs, N) array
            In network units.
        """
        self.work.values[rows, 1:-1] = values

    # ---- the contract ------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values (nodes, N + 2) of every node."""
        loops.evaluate(self.tape, self.work, x)
        return self.work.values.copy()

    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (neurons, N)."""
        loops.evaluate(self.tape, self.work, x)
        return self.work.drives.copy()

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (n,)."""
        out = np.empty(len(x))
        work = self.work
        arrays = work.values, self._planes, work.nodes, work.clamp
        loops.rhs_of_arrays(self.tape, x, *arrays, out)
        return out

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Relative (constraint, stationarity) residuals."""
        loops.evaluate(self.tape, self.work, x)
        return loops.residuals(self.tape, self.work)

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of d drive / dx (nnz,); zero at a rail."""
        loops.drive_jacobian(self.tape, self.work, x, self._slots, self._data)
        resting = self.resting(x, self.work.drives)
        return np.where(resting[self.tape.entries[:, 0]], 0, self._data)

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """(block, stage) of the first function block outside its domain, or (-1, -1)."""
        loops.evaluate(self.tape, self.work, x)
        return loops.first_outside(self.tape, self.work, guard)

    # ---- what loops can do besides -----------------------------------------------------------

    def move(self, drive: np.ndarray) -> np.ndarray:
        """M drive, both (n,)."""
        out = np.empty(len(drive))
        loops.apply_metric(self.tape, self.work, drive, out)
        return out

    def clamped(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """`move` while some neurons are held."""
        return clamped_moves(self.tape, held) or self.move

    def recur(
        self, x: np.ndarray, step: float, bounds: Bounds, *, count: int, tolerance: float
    ) -> tuple[int, float, int]:
        """Forward Euler steps on ``x`` in place; see `loops.recur`.

        Parameters
        ----------
        x : (n,) array
            The state, overwritten.
        step : float
            In units of network time.
        bounds : Bounds
        count : int
            Largest number of steps.
        tolerance : float
            Largest relative residual of a settled state.

        Returns
        -------
        steps : int
        residual : float
        outcome : int
            `RAN`, `SETTLED` or `LOST`.
        """
        return loops.recur(self.tape, self.work, x, step, bounds, count, tolerance)
