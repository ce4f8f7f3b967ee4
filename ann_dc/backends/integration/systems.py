"""Systems to integrate: functions at addresses, generated or interpreting a tape."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.np.numpy_support import carray

from ann_dc.errors import NetworkError
from ann_dc.evaluation import loops
from ann_dc.evaluation.calls import (
    WIDTH,
    call,
    cube,
    entries,
    floats,
    integer_matrix,
    integer_vector,
    integers,
    matrix,
    vector,
)
from ann_dc.evaluation.codegen.evaluator import FastEvaluator, GeneratedEvaluator
from ann_dc.evaluation.codegen.lanes import Lanes
from ann_dc.evaluation.codegen.plan import Axis, refusal
from ann_dc.evaluation.codegen.step_code import UNROLLED, step_code
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.formulas import called_by_address, inlined, inner
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.loops import Workspace
from ann_dc.evaluation.tape import Tape


class System(NamedTuple):
    """Functions at addresses, with flat states that have a ghost chunk at either end.

    The ghosts of a vector (n,) have no numbers.
    """

    rhs: int  # address of ``rhs``
    residuals: int  # address of ``residuals``
    keep: int  # address of ``keep``; 0 if no neuron has a saturation limit
    combine: int  # address of ``combine``
    error: int  # address of ``error``
    table: np.ndarray  # addresses of all tables
    found: np.ndarray  # returned values, at least (3,)
    ghost: int  # size of a ghost chunk
    size: int  # size of a state without ghosts
    live: int  # number n of neurons that move
    padded: int  # size of a state in whole blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class Integrand:
    """System with conversions from and to state vectors; lives as long as the system runs.

    ``state`` returns a state vector (n,) in the layout of the system, ``chosen`` (n,) are its
    indices there without ghosts, ``length`` is the size of a slope, and ``owner`` has the memory
    that compiled code addresses.
    """

    system: System
    state: Callable[[np.ndarray], np.ndarray]
    chosen: np.ndarray
    length: int
    owner: object


def interpreted(compiled: InterpretedEvaluator, guard: DomainGuard) -> Integrand:
    """Return the integrand that interprets a tape within its function block domains."""
    size, code = len(compiled.tape.places), _loop_code()
    steps = step_code(Axis.STAGES.lanes, is_shared=True)
    arrays = [_contiguous(array) for array in (*compiled.tape, *compiled.work, *guard)]
    system = System(
        rhs=code["rhs"].address,
        residuals=code["residuals"].address,
        keep=code["keep"].address if np.isfinite(compiled.tape.limits).any() else 0,
        combine=steps["combine"],
        error=steps["error"],
        table=np.array([size, *entries(arrays)], np.int64),
        found=np.zeros(3),
        ghost=0,
        size=size,
        live=size,
        padded=_padded(size),
    )
    reserve = np.zeros(system.padded - size)
    return Integrand(
        system=system,
        state=lambda x: np.concatenate([x, reserve]),
        chosen=np.arange(size),
        length=system.padded,
        owner=(compiled, arrays, code),
    )


def _padded(size: int) -> int:
    """Round up to whole blocks of vector code."""
    return -(-size // UNROLLED) * UNROLLED


def _contiguous(array: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(array, np.int64 if array.dtype.kind in "iu" else np.float64)


def generated(lanes: Lanes, guard: DomainGuard) -> Integrand:
    """Return the integrand in generated code within its function block domains."""
    entry, steps = lanes.entry, step_code(lanes.lanes, is_shared=lanes.plan.axis is Axis.STAGES)
    lanes.watch(guard)
    system = System(
        rhs=entry.rhs,
        residuals=entry.residuals,
        keep=entry.keep if lanes.plan.with_limits else 0,
        combine=steps["combine"],
        error=steps["error"],
        table=entry.table,
        found=entry.found,
        ghost=entry.ghost,
        size=entry.size,
        live=entry.live,
        padded=_padded(entry.size),
    )
    reserve = np.zeros(UNROLLED)
    return Integrand(
        system=system,
        state=lambda x: np.concatenate([lanes.state(x), reserve]),
        chosen=lanes.components,
        length=lanes.spare,
        owner=lanes,
    )


# ---- loops over a tape, as code at addresses -----------------------------------------------------

_COUNT = len((*Tape._fields, *Workspace._fields, *DomainGuard._fields))
(
    _BLOCKS, _DRIVES, _SOURCES, _WEIGHTS, _RATES, _LIMITS, _ROLES, _PLACES, _SHARED, _PINS, _SLOTS,
    _ENTRIES, _SLOT_START, _CHAINS, _GRIDS, _GRID_STARTS, _HATS, _SHARES, _COUPLED, _FACTOR,
    _FACTOR_COLUMNS, _STIFF, _REACHED,
    _VALUES, _ARRIVED, _DERIVATIVES, _NODES, _ARRIVING, _CLAMP,
    _DOMAINS, _SIGNS,
) = range(1, 1 + WIDTH * _COUNT, WIDTH)  # fmt: skip


@inner
def _tape(table):
    return Tape(
        integer_matrix(table, _BLOCKS), integer_matrix(table, _DRIVES),
        integer_matrix(table, _SOURCES), matrix(table, _WEIGHTS), matrix(table, _RATES),
        matrix(table, _LIMITS), integer_vector(table, _ROLES), integer_matrix(table, _PLACES),
        integer_vector(table, _SHARED), matrix(table, _PINS), integer_matrix(table, _SLOTS),
        integer_matrix(table, _ENTRIES), matrix(table, _SLOT_START), integer_matrix(table, _CHAINS),
        cube(table, _GRIDS), integer_vector(table, _GRID_STARTS), integer_vector(table, _HATS),
        vector(table, _SHARES), integer_matrix(table, _COUPLED), vector(table, _FACTOR),
        integer_vector(table, _FACTOR_COLUMNS), matrix(table, _STIFF),
        integer_vector(table, _REACHED),
    )  # fmt: skip


@inner
def _workspace(table):
    return Workspace(
        matrix(table, _VALUES), matrix(table, _ARRIVED), matrix(table, _DERIVATIVES),
        matrix(table, _NODES), matrix(table, _ARRIVING), integer_vector(table, _CLAMP),
    )  # fmt: skip


@inner
def _opened(table):
    return carray(integers(table), (1 + WIDTH * _COUNT,))


def _rhs(table, x, out):
    table = _opened(table)
    tape, work, size = _tape(table), _workspace(table), (table[0],)
    loops.rhs(tape, work, carray(floats(x), size), carray(floats(out), size))
    guard = DomainGuard(matrix(table, _DOMAINS), matrix(table, _SIGNS))
    return 1 if loops.first_outside(tape, work, guard)[0] >= 0 else 0


def _residuals(table, x, out):
    table, largest = _opened(table), 0.0
    state, found = carray(floats(x), (table[0],)), carray(floats(out), (3,))
    for i in range(state.shape[0]):
        largest = max(largest, abs(state[i]))
    found[0], found[1] = loops.residuals(_tape(table), _workspace(table))
    found[2] = largest
    return 0


def _keep(table, x, out):
    table = _opened(table)
    loops.clip_to_limits(_tape(table), carray(floats(out), (table[0],)))
    return 0


@cache
def _loop_code() -> dict[str, Any]:
    """Return the shared loops of generated code for any tape, with their ``address``."""
    signature = types.int64(types.int64, types.int64, types.int64)
    functions = {"rhs": _rhs, "residuals": _residuals, "keep": _keep}
    return {name: called_by_address(code, signature) for name, code in functions.items()}


# ---- as compiled loops call it -------------------------------------------------------------------


@inlined
def slope(system, x, out):
    """Write dx/ds of a state; return False if a function block is outside its domain."""
    addresses = (system.table.ctypes.data, x.ctypes.data, out.ctypes.data)
    return call(system.rhs, addresses, ()) == 0


@inlined
def residuals(system, x):
    """Return both residuals and the largest magnitude of the state of the last slope."""
    found = system.found
    addresses = (system.table.ctypes.data, x.ctypes.data, found.ctypes.data)
    call(system.residuals, addresses, ())
    return found[0], found[1], found[2]


@inlined
def kept(system, x):
    """Clip a state to the saturation limits that a step exceeded."""
    if system.keep != 0:
        call(system.keep, (system.table.ctypes.data, x.ctypes.data, x.ctypes.data), ())


@inlined
def _states(system, course):
    """Return the addresses of the state and of the trial state, past their ghosts."""
    ghost = 8 * system.ghost
    return course.x.ctypes.data + ghost, course.ahead.ctypes.data + ghost


@inlined
def _terms(rows, first, course):
    """Return addresses of slopes, weights, offsets from a row on, and scales."""
    offset = 8 * first
    return (
        course.slopes.ctypes.data,
        rows.weights.ctypes.data + offset,
        course.offsets.ctypes.data + offset,
        course.scales.ctypes.data,
    )


@inlined
def combined(system, rows, stage, course, h):
    """Write the trial state: x plus h times the weighted slopes of a stage."""
    first, last = rows.starts[stage], rows.starts[stage + 1]
    course.scales[0] = h
    x, ahead = _states(system, course)
    call(system.combine, (ahead, x, *_terms(rows, first, course)), (last - first, system.padded))


@inlined
def squares(system, rows, course, rtol, atol):
    """Return sums of squares of both error estimates, each relative to the tolerance."""
    stages = rows.starts.shape[0] - 3
    first, middle, last = rows.starts[stages], rows.starts[stages + 1], rows.starts[-1]
    course.scales[0], course.scales[1] = rtol, atol
    found = system.found.ctypes.data
    addresses = (*_states(system, course), *_terms(rows, first, course), found)
    call(system.error, addresses, (middle - first, last - first, system.padded))
    return system.found[0], system.found[1]


class Cells(enum.Enum):
    """Evaluation of cells; the value is the sentence shown to the user.

    Generated code is five to twenty times as fast. Its generation takes a tenth of a second, once
    per wiring: the code is cached on disk and independent of N, gains and inputs. Both evaluations
    agree to rounding.
    """

    WHERE_POSSIBLE = "generated if the wiring supports it, else interpreted"
    INTERPRETED = "interpreted: no code is compiled for a network"
    GENERATED = "generated: straight-line code for the wiring"

    def integrand(self, evaluator: FastEvaluator, guard: DomainGuard) -> Integrand:
        """Return the integrand for a compiled integrator.

        Raises `NetworkError` if code is requested for a wiring without code generation.
        """
        if self is Cells.GENERATED and (why := refusal(evaluator.tape)):
            raise NetworkError(f"cells: no code is generated for this network: {why}")
        if isinstance(evaluator, GeneratedEvaluator):
            if self is not Cells.INTERPRETED:
                return generated(evaluator.lanes, guard)
            evaluator = InterpretedEvaluator(evaluator.network, evaluator.tape)
        return interpreted(evaluator, guard)
