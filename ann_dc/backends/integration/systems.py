"""What is integrated: a tape that loops interpret, or generated code, behind a few functions.

Compiled loops choose by the type of the record, when they are compiled. In Python these functions
do nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from ann_dc.evaluation import loops
from ann_dc.evaluation.domains import DomainGuard
from ann_dc.evaluation.generated.lanes import Lanes
from ann_dc.evaluation.generated.plan import Axis
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.loops import Workspace
from ann_dc.evaluation.tape import Tape
from ann_dc.evaluation.vector_code.calls import call
from ann_dc.evaluation.vector_code.step_code import UNROLLED, step_code

_OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}


class Interpreted(NamedTuple):
    """A tape, whose states are vectors (n,)."""

    tape: Tape
    """What is evaluated."""
    work: Workspace
    """Where."""
    guard: DomainGuard
    """Domains of the function blocks."""
    ghost: int
    """None: 0."""
    size: int
    """n."""
    live: int
    """n."""


class Generated(NamedTuple):
    """Generated code, whose states are tables with a ghost chunk at either end, flat."""

    rhs: int
    """Address of ``rhs``."""
    residuals: int
    """Address of ``residuals``."""
    keep: int
    """Address of ``keep``; 0 where no neuron has a rail."""
    combine: int
    """Address of ``combine``."""
    error: int
    """Address of ``error``."""
    table: np.ndarray
    """Addresses of all tables."""
    found: np.ndarray
    """(3 lanes,): what is given back."""
    ghost: int
    """Numbers of a ghost chunk."""
    size: int
    """Numbers of a state without ghosts."""
    live: int
    """n, the neurons among them that move."""
    padded: int
    """Numbers of a state in whole blocks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Integrand:
    """A system with the way from a state vector and back; it has to live as long as that runs.

    Attributes
    ----------
    system : Interpreted or Generated
    state : callable
        A state vector (n,) as the system has it.
    chosen : (n,) array of int
        Where the state vector lies in it, without ghosts.
    length : int
        Numbers of a slope.
    owner : object
        What has the memory that compiled code knows by address.
    """

    system: Interpreted | Generated
    state: Callable[[np.ndarray], np.ndarray]
    chosen: np.ndarray
    length: int
    owner: object


def interpreted(compiled: InterpretedEvaluator, guard: DomainGuard) -> Integrand:
    """Loops over a tape, within the domains of its function blocks."""
    size = len(compiled.tape.places)
    system = Interpreted(compiled.tape, compiled.work, guard, ghost=0, size=size, live=size)
    chosen = np.arange(size)
    return Integrand(system=system, state=np.copy, chosen=chosen, length=size, owner=compiled)


def generated(lanes: Lanes, guard: DomainGuard) -> Integrand:
    """The code of a network, within the domains of its function blocks."""
    entry, steps = lanes.entry, step_code(lanes.lanes, is_shared=lanes.plan.axis is Axis.STAGES)
    lanes.watch(guard)
    system = Generated(
        rhs=entry.rhs,
        residuals=entry.residuals,
        keep=entry.keep if lanes.plan.railed else 0,
        combine=steps["combine"],
        error=steps["error"],
        table=entry.table,
        found=entry.found,
        ghost=entry.ghost,
        size=entry.size,
        live=entry.live,
        padded=-(-entry.size // UNROLLED) * UNROLLED,
    )
    reserve = np.zeros(UNROLLED)
    return Integrand(
        system=system,
        state=lambda x: np.concatenate([lanes.state(x), reserve]),
        chosen=lanes.components,
        length=lanes.spare,
        owner=lanes,
    )


def _only_compiled(system: Any) -> Any:
    raise NotImplementedError(f"{type(system).__name__}: compiled loops call this")


def slope(system: Any, x: np.ndarray, out: np.ndarray) -> bool:
    """dx/ds of a state into ``out``; False where a function block is outside its domain."""
    return _only_compiled(system)


def residuals(system: Any, x: np.ndarray) -> tuple[float, float, float]:
    """Both, and the largest magnitude, of the state at which the slope was last asked for."""
    return _only_compiled(system)


def kept(system: Any, x: np.ndarray) -> None:
    """A state back to the rails that a step went past."""
    return _only_compiled(system)


def combined(system: Any, rows: Any, stage: int, course: Any, h: float) -> None:
    """The state ahead: x plus h times the weighted slopes of a stage."""
    return _only_compiled(system)


def squares(system: Any, rows: Any, course: Any, rtol: float, atol: float) -> tuple[float, float]:
    """Sums of the squares of both error estimates, each over the tolerance there."""
    return _only_compiled(system)


def _is_generated(system: Any) -> bool:
    return getattr(system, "instance_class", None) is Generated


@overload(slope, jit_options=_OPTIONS)
def _slope(system, x, out):
    if _is_generated(system):

        def generated(system, x, out):
            addresses = (system.table.ctypes.data, x.ctypes.data, out.ctypes.data)
            return call(system.rhs, addresses, ()) == 0

        return generated

    def interpreted(system, x, out):
        loops.rhs(system.tape, system.work, x, out)
        return loops.first_outside(system.tape, system.work, system.guard)[0] < 0

    return interpreted


@overload(residuals, jit_options=_OPTIONS)
def _residuals(system, x):
    if _is_generated(system):

        def generated(system, x):
            found = system.found
            addresses = (system.table.ctypes.data, x.ctypes.data, found.ctypes.data)
            call(system.residuals, addresses, ())
            return found[0], found[1], found[2]

        return generated

    def interpreted(system, x):
        largest = 0.0
        for i in range(x.shape[0]):
            largest = max(largest, abs(x[i]))
        constraint, stationarity = loops.residuals(system.tape, system.work)
        return constraint, stationarity, largest

    return interpreted


@overload(kept, jit_options=_OPTIONS)
def _kept(system, x):
    if _is_generated(system):

        def generated(system, x):
            if system.keep != 0:
                call(system.keep, (system.table.ctypes.data, x.ctypes.data, x.ctypes.data), ())

        return generated

    def interpreted(system, x):
        loops.keep_within_rails(system.tape, x)

    return interpreted


@overload(combined, jit_options=_OPTIONS)
def _combined(system, rows, stage, course, h):
    if _is_generated(system):

        def generated(system, rows, stage, course, h):
            first, last = rows.starts[stage], rows.starts[stage + 1]
            course.scales[0] = h
            addresses = (
                course.ahead.ctypes.data + 8 * system.ghost,
                course.x.ctypes.data + 8 * system.ghost,
                course.slopes.ctypes.data,
                rows.weights.ctypes.data + 8 * first,
                course.offsets.ctypes.data + 8 * first,
                course.scales.ctypes.data,
            )
            call(system.combine, addresses, (last - first, system.padded))

        return generated

    def interpreted(system, rows, stage, course, h):
        x, ahead, slopes = course.x, course.ahead, course.slopes
        for i in range(x.shape[0]):
            ahead[i] = x[i]
        for j in range(rows.starts[stage], rows.starts[stage + 1]):
            share, slope_j = h * rows.weights[j], slopes[rows.which[j]]
            for i in range(x.shape[0]):
                ahead[i] += share * slope_j[i]

    return interpreted


@overload(squares, jit_options=_OPTIONS)
def _squares(system, rows, course, rtol, atol):
    if _is_generated(system):

        def generated(system, rows, course, rtol, atol):
            stages = rows.starts.shape[0] - 3
            first, middle, last = rows.starts[stages], rows.starts[stages + 1], rows.starts[-1]
            course.scales[0], course.scales[1] = rtol, atol
            addresses = (
                course.x.ctypes.data + 8 * system.ghost,
                course.ahead.ctypes.data + 8 * system.ghost,
                course.slopes.ctypes.data,
                rows.weights.ctypes.data + 8 * first,
                course.offsets.ctypes.data + 8 * first,
                course.scales.ctypes.data,
                system.found.ctypes.data,
            )
            call(system.error, addresses, (middle - first, last - first, system.padded))
            return system.found[0], system.found[1]

        return generated

    def interpreted(system, rows, course, rtol, atol):
        x, ahead, slopes = course.x, course.ahead, course.slopes
        stages = rows.starts.shape[0] - 3
        middle = rows.starts[stages + 1]
        first_sum = second_sum = 0.0
        for i in range(x.shape[0]):
            first = second = 0.0
            for j in range(rows.starts[stages], middle):
                first += rows.weights[j] * slopes[rows.which[j], i]
            for j in range(middle, rows.starts[-1]):
                second += rows.weights[j] * slopes[rows.which[j], i]
            scale = atol + rtol * max(abs(x[i]), abs(ahead[i]))
            first_sum += (first / scale) ** 2
            second_sum += (second / scale) ** 2
        return first_sum, second_sum

    return interpreted
