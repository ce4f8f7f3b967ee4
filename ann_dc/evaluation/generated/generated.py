"""A network as generated code evaluates it, a state at a time: what integrators call in loops."""

from __future__ import annotations

import ctypes
from typing import final

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.lanes import Lanes
from ann_dc.evaluation.generated.plan import Axis, refusal
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network

_RHS = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * 3)
_METRIC = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 2)


@final
class GeneratedEvaluator(Evaluator):
    """Straight-line vector code for the cell of a network, made for this processor.

    What it does not generate, values of every node and derivatives, the compiled loops say.

    Parameters
    ----------
    network : Network
    tape : Tape, optional
        Replaces the network's own by one with other numbers.

    Attributes
    ----------
    lanes : Lanes
        The network's numbers as the code reads them; every call overwrites its work.

    Raises
    ------
    NetworkError
        If code is not generated for such a wiring; the message says why.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> from ann_dc.evaluation import evaluator
    >>> network = synthesize(plants.double_integrator(N=5))
    >>> x = network.start_state
    >>> bool(np.allclose(GeneratedEvaluator(network).rhs(x), evaluator(network).rhs(x)))
    True
    """

    def __init__(self, network: Network, tape: Tape | None = None) -> None:
        self.loops = CompiledEvaluator(network, tape)
        super().__init__(network, self.loops.tape)
        if why := refusal(self.tape):
            raise NetworkError(f"no code is generated for this network: {why}")
        self.lanes = Lanes(self.tape, Axis.STAGES)
        self._out = np.zeros(self.lanes.spare)

    def _evaluate(self, x: np.ndarray) -> tuple[np.ndarray, int]:
        """A state as the code takes it, and whether a block is outside its domain."""
        state, entry = self.lanes.state(x), self.lanes.entry
        return state, _RHS(entry.rhs)(*_data(entry.table, state, self._out))

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values (nodes, N + 2) of every node."""
        return self.loops.values(x)

    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (neurons, N)."""
        self._evaluate(x)
        return self._rows(self.lanes.tables["drives"])

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (n,)."""
        self._evaluate(x)
        return self._out[self.lanes.components]

    def move(self, drive: np.ndarray) -> np.ndarray:
        """M drive, both (n,)."""
        drives, rates = self.lanes.tables["drives"], self.tape.rates
        drives[:] = 0.0
        drives[self.lanes.components] = drive
        self._out[self.lanes.components] = drive * rates[tuple(self.tape.places.T)]
        if self.lanes.plan.has_metric:
            _METRIC(self.lanes.entry.metric)(*_data(self.lanes.entry.table, self._out))
        return self._out[self.lanes.components]

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Relative (constraint, stationarity) residuals."""
        state, _ = self._evaluate(x)
        entry = self.lanes.entry
        _RHS(entry.residuals)(*_data(entry.table, state, entry.found))
        return float(entry.found[0]), float(entry.found[1])

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of d drive / dx (nnz,); zero at a rail."""
        return self.loops.jacobian_entries(x)

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """(block, stage) of the first function block outside its domain, or (-1, -1)."""
        self.lanes.watch(guard)
        if not self._evaluate(x)[1]:
            return -1, -1
        return self.loops.outside(x, guard)

    def _rows(self, table: np.ndarray) -> np.ndarray:
        lanes = self.lanes
        inner = table[: lanes.size].reshape(lanes.chunks, lanes.neurons, lanes.lanes)
        return inner.transpose(1, 0, 2).reshape(lanes.neurons, -1)[:, : lanes.stages].copy()


def _data(*arrays: np.ndarray) -> list[int]:
    return [array.ctypes.data for array in arrays]
