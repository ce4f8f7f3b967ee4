"""Vector code of a recurrent step for its lanes: checks and step lengths."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

from ann_dc.backends.batched.memory import DONE, OWN, RUNS, STEP, TIME, Memory, numbers_of
from ann_dc.backends.batched.step_control import StepLengths, StepState, next_step, turn_of
from ann_dc.backends.batched.vectors import Vector
from ann_dc.evaluation.codegen.code import code, key_of
from ann_dc.evaluation.codegen.step_code import UNROLLED
from ann_dc.evaluation.codegen.writer import Function, Module

STATE = STEP, *range(OWN, OWN + 9)
"""Memory rows of the fields of `StepState`."""
STRAYED, SIZE, ENERGY = range(OWN + 9, OWN + 12)
"""Memory rows: left domain; largest state at the last headway check; energy of the step before."""
ROWS = OWN + 12
NUMBERS = ("tolerance", "settled", "most_steps", *StepLengths._fields)
"""Constants in the order read by the code: see `Ends` and `StepLengths`."""


@cache
def recurrence_code(lanes: int) -> dict[str, int]:
    r"""Return the addresses of the functions that a recurrence applies to its lanes.

    ``look(memory, found, numbers; due, outside)`` enters the residuals of the due lanes and returns
    those that need a check, as bits.

    ``go_on(x, drives, derivatives, before, memory, numbers; n, outside)`` computes ``x += h m``
    with the step of every lane. It then sets ``h`` of the next step from the energy
    sqrt(sum \|d m\|) and the angle to the derivatives before, which are replaced: see
    `next_step`. ``lanes`` is the vector width.
    """
    key = key_of(("recurrence", lanes), Path(__file__).parent)
    return code(key, lambda: _text(lanes), ("look", "go_on"))


def _text(lanes: int) -> str:
    module = Module()
    _check(module, lanes)
    _go_on(module, lanes)
    return module.text()


def _check(module: Module, lanes: int) -> None:
    names = "memory", "found", "numbers", "due", "outside"
    f = Function(module, "look", names, width=lanes, numbers=names[-2:])
    memory, numbers = Memory(f), numbers_of(f, NUMBERS)
    library = memory.library
    due = library.mask("%due") & (memory[RUNS] > 0.0)
    worst, size, _ = memory.note(due, numbers["tolerance"], memory[TIME])
    strayed = library.mask("%outside") | (memory[STRAYED] > 0.0)
    over = memory.is_over(due, worst, size, numbers["settled"], numbers["most_steps"])
    f.done(f.bits((over | (due & strayed)).name))


def _go_on(module: Module, lanes: int) -> None:
    names = "x", "drives", "derivatives", "before", "memory", "numbers", "n", "outside"
    f = Function(module, "go_on", names, width=lanes, numbers=names[-2:])
    memory, numbers = Memory(f), numbers_of(f, NUMBERS)
    library, step = memory.library, memory[STEP]
    power, along = _moved(f, step, UNROLLED // lanes)
    strayed = library.mask("%outside")
    memory.enter(STRAYED, strayed, 1.0)
    energy = library.sqrt(library.where(strayed, math.inf, power))
    energy = library.where(energy < math.inf, energy, math.inf)
    memory[TIME] = memory[TIME] + step
    memory[DONE] = memory[DONE] + 1.0
    turn = turn_of(library, along, energy * memory[ENERGY])
    memory[ENERGY] = energy
    lengths = StepLengths(*(numbers[name] for name in StepLengths._fields))  # type: ignore[arg-type]
    state = StepState(*(memory[row] for row in STATE))
    for row, value in zip(STATE, next_step(library, lengths, state, energy, turn)[0]):
        memory[row] = value
    f.done()


def _moved(f: Function, step: Vector, count: int) -> tuple[Vector, Vector]:
    r"""Take the step and return sum \|d m\| and sum d m of the derivatives before, per lane.

    ``count`` is the number of vectors in a block; loops take two blocks at a time.
    """
    sums = [(f.slot(), f.slot()) for _ in range(2 * count)]
    with f.loop(f.integer("sdiv", "%n", 2 * UNROLLED)) as block:
        _some_steps(f, step.name, f.integer("mul", block, 2 * UNROLLED), sums)
    with f.loop(f.integer("srem", f.integer("sdiv", "%n", UNROLLED), 2)) as _:
        _some_steps(f, step.name, f.integer("sub", "%n", UNROLLED), sums[:count])
    total = along = f.constant(0.0)
    for power, product in sums:
        total = f.op("fadd", total, f.load(power))
        along = f.op("fadd", along, f.load(product))
    return Vector(f, total), Vector(f, along)


def _some_steps(f: Function, step: str, first: str, sums: list[tuple[str, str]]) -> None:
    """Step as many vectors as pairs of sums, since independent sums wait less."""
    for i, (total, along) in enumerate(sums):
        at = f.integer("add", first, i * f.width)
        drive, derivative = f.load(f.address("%drives", at)), f.load(f.address("%derivatives", at))
        x = f.address("%x", at)
        f.store(f.fma(step, derivative, f.load(x)), x)
        power = f.call("fabs", f.op("fmul", drive, derivative))
        f.store(f.op("fadd", f.load(total), power), total)
        before = f.address("%before", at)
        f.store(f.fma(drive, f.load(before), f.load(along)), along)
        f.store(derivative, before)
