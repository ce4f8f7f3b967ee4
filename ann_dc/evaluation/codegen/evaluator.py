"""Evaluator with generated code, one state at a time, for use in loops."""

from __future__ import annotations

import ctypes
import threading
from collections.abc import Callable
from functools import cached_property, partial
from typing import final
from weakref import WeakKeyDictionary

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.codegen.cell_code import JACOBIAN_NAMES
from ann_dc.evaluation.codegen.iterations import grown, recur
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import LONGEST_JACOBIAN, Axis, Plan, refusal
from ann_dc.evaluation.contract import Evaluator
from ann_dc.evaluation.domains import Bounds, DomainGuard
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.pivots import clamped_derivative
from ann_dc.evaluation.reference import evaluator, node_values, outside_of
from ann_dc.evaluation.tape import Tape
from ann_dc.network.network import Network

# ---- A network as generated code evaluates it, a state at a time: what integrators call in loops

_of_thread = threading.local()


def _lanes_of(network: Network) -> Lanes:
    """Return the tables of a network, cached per network and thread."""
    kept = _of_thread.__dict__.setdefault("lanes", WeakKeyDictionary())
    if network not in kept:
        kept[network] = _lanes(network, evaluator(network).tape)
    return kept[network]


_plans: WeakKeyDictionary[Network, list[Plan]] = WeakKeyDictionary()


def _lanes(network: Network, tape: Tape) -> Lanes:
    """Return the tables of a tape; a wiring is planned once."""
    plans = _plans.setdefault(network, [])
    plan = next((plan for plan in plans if plan.serves(tape)), None)
    lanes = Lanes(tape, Axis.STAGES, plan)
    if plan is None:
        plans.append(lanes.plan)
    return lanes


@final
class GeneratedEvaluator(Evaluator):
    """Evaluator with straight-line vector code of the cell for the current processor.

    The values of all nodes are not needed in loops and come from array operations. The derivatives
    of a large cell come from loops over the tape, since their code compiles too slowly. Within a
    thread, evaluators of the network's tape use common tables. Use one evaluator per thread. An
    optional tape replaces the network's tape by other numbers. Every call overwrites the work
    arrays of ``lanes``, the numbers of the network as the code reads them. Raises `NetworkError`
    with the reason if no code is generated for the wiring.

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
        self._take(_lanes_of(network) if own else _lanes(network, self.tape))

    def _take(self, lanes: Lanes) -> None:
        self.lanes, self._state = lanes, lanes.state(np.zeros(self.network.size))
        self._calls: dict[str, Callable[[], int]] = {}
        self._pace()

    def _pace(self) -> None:
        self._rates = self.tape.rates[self.tape.places[:, 0], self.tape.places[:, 1]]

    def renumber(self, tape: Tape) -> None:
        """Replace the tape by another tape of the same network."""
        is_trial, self.tape = self.tape is not evaluator(self.network).tape, tape
        vars(self).pop("_loops", None)
        if is_trial and self.lanes.renumber(tape):
            self._pace()
        else:
            self._take(_lanes(self.network, tape))

    # ---- the contract ------------------------------------------------------------------------

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (nodes, N + 2) of all nodes."""
        with np.errstate(all="ignore"):
            return node_values(self.tape, np.asarray(x, float))

    def drives(self, x: np.ndarray) -> np.ndarray:
        """Return the net inputs (neurons, N)."""
        self._evaluate(x)
        lanes = self.lanes
        inner = lanes.tables["drives"][: lanes.size]
        inner = inner.reshape(lanes.chunks, lanes.neurons, lanes.lanes).transpose(1, 0, 2)
        return inner.reshape(lanes.neurons, -1)[:, : lanes.stages].copy()

    def rhs(self, x: np.ndarray) -> np.ndarray:
        """Return dx/ds (n,)."""
        self._evaluate(x)
        return self.lanes.derivatives[self.lanes.components]

    def derivative(self, drive: np.ndarray) -> np.ndarray:
        """Multiply net inputs (n,) by M."""
        lanes, places = self.lanes, self.lanes.components
        drives = lanes.tables["drives"]
        drives[:] = 0.0
        drives[places] = drive
        lanes.derivatives[places] = drive * self._rates
        if lanes.plan.has_preconditioner:
            self._call("preconditioner")
        return lanes.derivatives[places]

    def residuals(self, x: np.ndarray) -> tuple[float, float]:
        """Return the relative (constraint, stationarity) residuals."""
        self._evaluate(x)
        self._call("residuals")
        found = self.lanes.entry.found
        return float(found[0]), float(found[1])

    def jacobian_entries(self, x: np.ndarray) -> np.ndarray:
        """Return the entries (nnz,) of d drive / dx; zero at a saturation limit."""
        if len(self.tape.slots) > LONGEST_JACOBIAN:
            return self._loops.jacobian_entries(x)
        self._state[self.lanes.inner] = x
        self._call("cell")
        self._call("jacobian")
        entries = self.lanes.jacobian.found[self.lanes.jacobian.chosen]
        if self.has_limits:
            entries[self.saturated(x, self.drives(x))[self.tape.entries[:, 0]]] = 0.0
        return entries

    @cached_property
    def _loops(self) -> InterpretedEvaluator:
        return InterpretedEvaluator(self.network, self.tape)

    def outside(self, x: np.ndarray, guard: DomainGuard) -> tuple[int, int]:
        """Return (block, stage) of the first block outside its domain, or (-1, -1)."""
        self.lanes.watch(guard)
        if not self._evaluate(x):
            return -1, -1
        return outside_of(self.tape, self.values(x), guard)

    def _evaluate(self, x: np.ndarray) -> int:
        """Compute net inputs and derivatives; return nonzero outside a domain."""
        self._state[self.lanes.inner] = x
        return self._call("rhs")

    def _call(self, name: str) -> int:
        """Call a function of the code with its tables."""
        if name not in self._calls:
            self._calls[name] = self._bound(name)
        return self._calls[name]()

    def _bound(self, name: str) -> Callable[[], int]:
        lanes = self.lanes
        if name in JACOBIAN_NAMES:
            entry, out = (
                lanes.jacobian,
                lanes.derivatives if name == "cell" else lanes.jacobian.found,
            )
        else:
            entry, out = (
                lanes.entry,
                lanes.entry.found if name == "residuals" else lanes.derivatives,
            )
        arrays = (entry.table, out) if name == "preconditioner" else (entry.table, self._state, out)
        function = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * len(arrays))
        return partial(function(getattr(entry, name)), *(array.ctypes.data for array in arrays))

    # ---- what generated code can do besides --------------------------------------------------

    def clamped(self, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return `derivative` with some neurons held."""
        return clamped_derivative(self.tape, held) or self.derivative

    def fastest_rate(self, x: np.ndarray, iterations: int = 20) -> float:
        """Estimate the spectral radius of d rhs / dx; see `Evaluator.fastest_rate`."""
        if np.isin(self.tape.places[~self.free(x), 0], self.tape.reached).any():
            return super().fastest_rate(x, iterations)
        lanes, values = self.lanes, self.jacobian_entries(x)
        preconditioner = lanes.entry.preconditioner if lanes.plan.has_preconditioner else 0
        return grown(
            np.array([preconditioner, lanes.entry.table.ctypes.data]),
            lanes.components,
            self._rates,
            self.tape.entries,
            values,
            np.random.default_rng(0).standard_normal(len(x)),
            (lanes.tables["drives"], lanes.derivatives),
            iterations,
        )

    def recur(
        self, x: np.ndarray, step: float, bounds: Bounds, *, count: int, tolerance: float
    ) -> tuple[int, float, int]:
        """Run forward Euler steps on ``x`` in place; see `InterpretedEvaluator.recur`."""
        lanes = self.lanes
        entry, places = lanes.entry, lanes.components
        lanes.watch(bounds.guard)
        limits = np.tile([np.inf, -np.inf, np.inf], (lanes.size, 1))
        limits[places] = np.column_stack([bounds.slew, bounds.box])
        state = lanes.state(x)
        code = np.array([entry.rhs, entry.residuals, entry.table.ctypes.data, entry.ghost])
        done, last, outcome = recur(
            code, state, lanes.derivatives, entry.found, limits, step, count, tolerance
        )
        x[:] = state[entry.ghost + places]
        return done, last, outcome


# ---- the quickest evaluator that there is for a network

FastEvaluator = GeneratedEvaluator | InterpretedEvaluator
"""Result of `fast_evaluator`."""


def fast_evaluator(network: Network, tape: Tape | None = None) -> FastEvaluator:
    """Return an evaluator with generated code if supported, else with loops.

    An optional tape replaces the network's tape by other numbers.

    Examples
    --------
    >>> from ann_dc import plants, synthesize
    >>> type(fast_evaluator(synthesize(plants.double_integrator(N=5)))).__name__
    'GeneratedEvaluator'
    """
    tape = tape or evaluator(network).tape
    return (InterpretedEvaluator if refusal(tape) else GeneratedEvaluator)(network, tape)
