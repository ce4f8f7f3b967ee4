"""Vector code of a recurrent step for its lanes: checks and step lengths."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

from ann_dc.backends.lanes.memory import DONE, OWN, RUNS, SINCE, SINCE_TIME, STEP, TIME, Memory
from ann_dc.evaluation.codegen.code import code, key_of
from ann_dc.evaluation.codegen.step_code import UNROLLED
from ann_dc.evaluation.codegen.writer import Function, Module

ROWS = OWN + 12
(LONGEST, LOWEST, LIMITED, AGE, MARK, WINDOW, STRAYED, SIZE, ENERGY, TURNED, PEAK,
 FLOOR) = range(OWN, ROWS)  # fmt: skip
"""Memory rows: longest step; lowest energy since the last cut; existence of a cut; steps into the
window, lowest energy at its beginning, and its length; left domain; largest state at the last
headway check; energy of the step before; turn of the moves since the last full turn, and highest
energy since then; lowest of these peaks since the last cut.
"""
NAMES = "look", "go_on"
NUMBERS = (
    "tolerance", "settled", "limit", "growth", "cut", "rise", "earned", "progress", "least", "turn",
)  # fmt: skip
"""Constants in the order read by the code: see `Looks` and `StepLengths`."""


@cache
def recurrence_code(lanes: int) -> dict[str, int]:
    r"""Return the addresses of the functions that a recurrence applies to its lanes.

    ``look(memory, found, numbers; due, outside)`` enters the residuals of the due lanes and returns
    those that need a check, as bits.

    ``go_on(x, drives, moves, before, memory, numbers; n, outside)`` computes ``x += h m`` with the
    step of every lane. It then sets ``h`` of the next step from the energy sqrt(sum \|d m\|) and
    the angle to the moves before, which are replaced: see `AdaptiveStep`. ``lanes`` is the vector
    width.
    """
    key = key_of(("recurrence", lanes), Path(__file__).parent)
    return code(key, lambda: _text(lanes), NAMES)


def _text(lanes: int) -> str:
    module = Module()
    _look(module, lanes)
    _go_on(module, lanes)
    return module.text()


def _numbers(f: Function) -> dict[str, str]:
    """Return the constants in every lane."""
    return {name: f.spread(f.load(f.address("%numbers", i), 1)) for i, name in enumerate(NUMBERS)}


def _look(module: Module, lanes: int) -> None:
    names = "memory", "found", "numbers", "due", "outside"
    f = Function(module, "look", names, width=lanes, numbers=names[-2:])
    memory, numbers = Memory(f), _numbers(f)
    due = f.logical("and", f.mask("%due"), _holds(f, memory[RUNS]))
    worst, size = memory.note(due, "%found")
    strayed = f.logical("or", f.mask("%outside"), _holds(f, memory[STRAYED]))
    below = f.compare("olt", worst, numbers["tolerance"])
    begun = f.compare("oge", memory[SINCE], f.constant(0.0))
    enters = f.logical("and", f.logical("and", due, below), f.negated(begun))
    memory.enter(SINCE_TIME, enters, memory[TIME])
    since = f.select(below, f.select(begun, memory[SINCE], memory[DONE]), f.constant(-1.0))
    memory.enter(SINCE, due, since)
    over = memory.is_over(due, worst, size, numbers["settled"], numbers["limit"])
    f.done(f.bits(f.logical("or", over, f.logical("and", due, strayed))))


def _holds(f: Function, number: str) -> str:
    return f.compare("une", number, f.constant(0.0))


def _go_on(module: Module, lanes: int) -> None:
    names = "x", "drives", "moves", "before", "memory", "numbers", "n", "outside"
    f = Function(module, "go_on", names, width=lanes, numbers=names[-2:])
    memory, count = Memory(f), UNROLLED // lanes
    step, sums = memory[STEP], [(f.slot(), f.slot()) for _ in range(2 * count)]
    with f.loop(f.integer("sdiv", "%n", 2 * UNROLLED)) as block:
        _some_steps(f, step, f.integer("mul", block, 2 * UNROLLED), sums)
    with f.loop(f.integer("srem", f.integer("sdiv", "%n", UNROLLED), 2)) as _:
        _some_steps(f, step, f.integer("sub", "%n", UNROLLED), sums[:count])
    total = along = f.constant(0.0)
    for power, product in sums:
        total = f.op("fadd", total, f.load(power))
        along = f.op("fadd", along, f.load(product))
    strayed, most = f.mask("%outside"), f.constant(math.inf)
    memory.enter(STRAYED, strayed, f.constant(1.0))
    energy = f.call("sqrt", f.select(strayed, most, total))
    energy = f.select(f.compare("olt", energy, most), energy, most)
    memory[TIME] = f.op("fadd", memory[TIME], step)
    memory[DONE] = f.op("fadd", memory[DONE], f.constant(1.0))
    turned = f.op("fadd", memory[TURNED], _turn(f, along, f.op("fmul", energy, memory[ENERGY])))
    memory[ENERGY] = energy
    _update(f, memory, _numbers(f), energy, turned)
    f.done()


def _turn(f: Function, along: str, energies: str) -> str:
    """Return sin(angle / 2) between two moves, as `layers.steps.turn_of` does."""
    cosine = f.op("fdiv", along, energies)
    known = f.compare("olt", f.call("fabs", cosine), f.constant(math.inf))
    half = f.op("fmul", f.op("fsub", f.constant(1.0), cosine), f.constant(0.5))
    return f.select(known, f.call("sqrt", f.larger(half, f.constant(0.0))), f.constant(0.0))


def _note_peak(
    f: Function, memory: Memory, energy: str, turned: str, ends: tuple[str, str]
) -> None:
    """Update the peak energy of a turn, ended by a cut or a full turn, and the floor."""
    cut, full = ends
    peak, none = f.larger(energy, memory[PEAK]), f.constant(0.0)
    floor = f.select(full, f.smaller(peak, memory[FLOOR]), memory[FLOOR])
    memory[FLOOR] = f.select(cut, f.constant(math.inf), floor)
    over = f.logical("or", cut, full)
    memory[PEAK], memory[TURNED] = f.select(over, none, peak), f.select(over, none, turned)


def _some_steps(f: Function, step: str, first: str, sums: list[tuple[str, str]]) -> None:
    """Step as many vectors as pairs of sums, since independent sums wait less."""
    for i, (total, along) in enumerate(sums):
        at = f.integer("add", first, i * f.width)
        drive, move = f.load(f.address("%drives", at)), f.load(f.address("%moves", at))
        x = f.address("%x", at)
        f.store(f.fma(step, move, f.load(x)), x)
        power = f.call("fabs", f.op("fmul", drive, move))
        f.store(f.op("fadd", f.load(total), power), total)
        before = f.address("%before", at)
        f.store(f.fma(drive, f.load(before), f.load(along)), along)
        f.store(move, before)


def _update(f: Function, memory: Memory, numbers: dict[str, str], energy: str, turned: str) -> None:
    """Set the next step of every lane, as `StepState.next` does."""
    lowest, limited = memory[LOWEST], _holds(f, memory[LIMITED])
    age = f.op("fadd", memory[AGE], f.constant(1.0))
    over = f.compare("oge", age, memory[WINDOW])
    earned = f.op("fmul", numbers["progress"], memory[MARK])
    idle = f.logical("and", over, f.compare("ogt", lowest, earned))
    rises = f.compare("ogt", energy, f.op("fmul", numbers["rise"], memory[FLOOR]))
    cut = f.logical("or", idle, rises)
    better = f.logical("and", f.compare("olt", energy, lowest), f.negated(cut))
    deserves = f.logical("and", better, limited)

    def by_progress() -> list[str]:
        """Return a power of the progress, by its logarithm."""
        progress = f.call("log", f.op("fdiv", lowest, energy))
        power = f.call("exp", f.op("fmul", numbers["earned"], progress))
        return [f.select(deserves, power, numbers["growth"])]

    (growth,) = f.either(f.any_of(deserves), by_progress, [numbers["growth"]])
    factor = f.select(cut, numbers["cut"], f.select(better, growth, f.constant(1.0)))
    known = memory.enter(LOWEST, f.logical("or", cut, better), energy)
    _note_peak(f, memory, energy, turned, (cut, f.compare("oge", turned, numbers["turn"])))
    step = f.op("fmul", memory[STEP], factor)
    step = f.larger(step, f.op("fmul", numbers["least"], memory[LONGEST]))
    memory[STEP] = f.smaller(step, memory[LONGEST])
    memory.enter(LIMITED, cut, f.constant(1.0))
    turned = f.logical("or", over, cut)
    memory[AGE] = f.select(turned, f.constant(0.0), age)
    memory.enter(MARK, turned, known)
    memory.enter(WINDOW, idle, f.op("fmul", memory[WINDOW], f.constant(1.5)))
