"""A network as generated code evaluates it, a state at a time: what integrators call in loops."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from functools import partial
from typing import final
from weakref import WeakKeyDictionary

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.cell_code import JACOBIAN_NAMES
from ann_dc.evaluation.codegen.iterations import grown, recur
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis, Plan, refusal
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import Bounds, DomainGuard
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.pivots import clamped_moves
from ann_dc.evaluation.reference import evaluator, node_values, outside_of
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network

# ---- A network as generated code evaluates it, a state at a time: what integrators call in loops

_of_thread = threading.local()


def lanes_of(network: Network) -> Lanes:
    """A network's own numbers, kept as long as it is, with a work space for every thread.

    Parameters
    ----------
    network : Network
    """
    kept = _of_thread.__dict__.setdefault("lanes", WeakKeyDictionary())
    if network not in kept:
        kept[network] = _lanes(network, evaluator(network).tape)
    return kept[network]


_plans: WeakKeyDictionary[Network, list[Plan]] = WeakKeyDictionary()


def _lanes(network: Network, tape: Tape) -> Lanes:
    """The numbers of a tape of a network, whose wirings are sorted once."""
    plans = _plans.setdefault(network, [])
    plan = next((plan for plan in plans if plan.serves(tape)), None)
    lanes = Lanes(tape, Axis.STAGES, plan)
    if plan is None:
        plans.append(lanes.plan)
    return lanes


@final
class GeneratedEvaluator(Evaluator):
    """Straight-line vector code for the cell of a network, made for this processor.

    Values of every node, which nobody asks for in a loop, come from array operations. Evaluators of
    a network's own numbers share their tables within the thread that made them: one a thread.

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
        super().__init__(network, tape or evaluator(network).tape)
        if why := refusal(self.tape):
            raise NetworkError(f"no code is generated for this network: {why}")
        own = self.tape is evaluator(network).tape
        self._take(lanes_of(network) if own else _lanes(network, self.tape))

    def _take(self, lanes: Lanes) -> None:
        self.lanes, self._state = lanes, lanes.state(np.zeros(self.network.size))
        self._calls: dict[str, Callable[[], int]] = {}
        self._pace()

    def _pace(self) -> None:
        self._rates = self.tape.rates[self.tape.places[:, 0], self.tape.places[:, 1]]

    def renumber(self, tape: Tape) -> None:
        """From now on with other numbers.

        Parameters
        ----------
        tape : Tape
            Of the same network.
        """
        is_trial, self.tape = self.tape is not evaluator(self.network).tape, tape
        if is_trial and self.lanes.renumber(tape):
            self._pace()
        else:
            self._take(_lanes(self.network, tape))

    # ---- the contract ------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> np.ndarray:
        """Values (nodes, N + 2) of every node."""
        with np.errstate(all="ignore"):
            return node_values(self.tape, np.asarray(x, float))

    def drives(self, x: np.ndarray) -> np.ndarray:
        """What arrives at every neuron, (neurons, N)."""
        self._evaluate(x)
        lanes = self.lanes
        inner = lanes.tables["drives"][: lanes.size]
        inner = inner.reshape(lanes.chunks, lanes.neurons, lanes.lanes).transpose(1, 0, 2)
        return inner.reshape(lanes.neurons, -1)[:, : lanes.stages].copy()

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """dx/ds (n,)."""
        self._evaluate(x)
        return self.lanes.moves[self.lanes.components]

    def move(self, drive: np.ndarray) -> np.ndarray:
        """M drive, both (n,)."""
        lanes, places = self.lanes, self.lanes.components
        drives = lanes.tables["drives"]
        drives[:] = 0.0
        drives[places] = drive
        lanes.moves[places] = drive * self._rates
        if lanes.plan.has_metric:
            self._call("metric")
        return lanes.moves[places]

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Relative (constraint, stationarity) residuals."""
        self._evaluate(x)
        self._call("residuals")
        found = self.lanes.entry.found
        return float(found[0]), float(found[1])

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Entries of d drive / dx (nnz,); zero at a rail."""
        self._state[self.lanes.inner] = x
        self._call("cell")
        self._call("jacobian")
        entries = self.lanes.jacobian.found[self.lanes.jacobian.chosen]
        if self.has_rails:
            entries[self.resting(x, self.drives(x))[self.tape.entries[:, 0]]] = 0.0
        return entries

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """(block, stage) of the first function block outside its domain, or (-1, -1)."""
        self.lanes.watch(guard)
        if not self._evaluate(x):
            return -1, -1
        return outside_of(self.tape, self.values(x), guard)

    def _evaluate(self, x: np.ndarray) -> int:
        """Drives and moves of a state, and whether a block is outside its domain."""
        self._state[self.lanes.inner] = x
        return self._call("rhs")

    def _call(self, name: str) -> int:
        """A function of the code, on the tables that it always has here."""
        if name not in self._calls:
            self._calls[name] = self._bound(name)
        return self._calls[name]()

    def _bound(self, name: str) -> Callable[[], int]:
        lanes = self.lanes
        if name in JACOBIAN_NAMES:
            entry, out = lanes.jacobian, lanes.moves if name == "cell" else lanes.jacobian.found
        else:
            entry, out = lanes.entry, lanes.entry.found if name == "residuals" else lanes.moves
        arrays = (entry.table, out) if name == "metric" else (entry.table, self._state, out)
        function = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * len(arrays))
        return partial(function(getattr(entry, name)), *(array.ctypes.data for array in arrays))

    # ---- what generated code can do besides --------------------------------------------------

    def clamped(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """`move` while some neurons are held."""
        return clamped_moves(self.tape, held) or self.move

    def fastest_rate(self, x: np.ndarray, iterations: int = 20) -> float:
        """Estimate of the spectral radius of d rhs / dx; see `Evaluator.fastest_rate`."""
        if np.isin(self.tape.places[~self.free(x), 0], self.tape.reached).any():
            return super().fastest_rate(x, iterations)
        lanes, values = self.lanes, self.jacobian_entries(x)
        metric = lanes.entry.metric if lanes.plan.has_metric else 0
        return grown(
            np.array([metric, lanes.entry.table.ctypes.data]),
            lanes.components,
            self._rates,
            self.tape.entries,
            values,
            np.random.default_rng(0).standard_normal(len(x)),
            (lanes.tables["drives"], lanes.moves),
            iterations,
        )

    def recur(
        self, x: np.ndarray, step: float, bounds: Bounds, *, count: int, tolerance: float
    ) -> tuple[int, float, int]:
        """Forward Euler steps on ``x`` in place; see `InterpretedEvaluator.recur`."""
        lanes = self.lanes
        entry, places = lanes.entry, lanes.components
        lanes.watch(bounds.guard)
        limits = np.tile([np.inf, -np.inf, np.inf], (lanes.size, 1))
        limits[places] = np.column_stack([bounds.slew, bounds.box])
        state = lanes.state(x)
        code = np.array([entry.rhs, entry.residuals, entry.table.ctypes.data, entry.ghost])
        done, last, outcome = recur(
            code, state, lanes.moves, entry.found, limits, step, count, tolerance
        )
        x[:] = state[entry.ghost + places]
        return done, last, outcome


# ---- the quickest evaluator that there is for a network

FastEvaluator = GeneratedEvaluator | InterpretedEvaluator
"""Result of `fast_evaluator`."""


def fast_evaluator(network: Network, tape: Tape | None = None) -> FastEvaluator:
    """Generated code where the wiring is one for which it is, else loops over a tape.

    Parameters
    ----------
    network : Network
    tape : Tape, optional
        Replaces the network's own by one with other numbers.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> type(fast_evaluator(synthesize(plants.double_integrator(N=5)))).__name__
    'GeneratedEvaluator'
    """
    tape = tape or evaluator(network).tape
    return (InterpretedEvaluator if refusal(tape) else GeneratedEvaluator)(network, tape)
