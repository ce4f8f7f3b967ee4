"""Vector code for a step of an explicit pair in every lane at once.

A step is tried, accepted or refused, and recorded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from ann_dc.backends.batched.memory import DONE, OWN, RUNS, STEP, TIME, Memory, numbers_of
from ann_dc.backends.batched.vectors import Vector
from ann_dc.backends.integration.integrator import (
    FINEST,
    LEAST,
    MOST,
    SAFETY,
    SHORTEST,
    SHRINK,
)
from ann_dc.backends.integration.tableaus import Rows
from ann_dc.evaluation.codegen.code import code, key_of
from ann_dc.evaluation.codegen.step_code import UNROLLED
from ann_dc.evaluation.codegen.writer import Function, Module

REFUSED, WORST, AT, BEGAN, UNTIL = range(OWN, OWN + 5)
"""Memory rows: refusal of the last step; larger residual; time of the inputs; last and next
breakpoint of the inputs.
"""
ROWS = OWN + 5
BEFORE = 1
"""Row of slopes that is free at the end of a step; receives the states before the step if the
residual of a lane falls below the tolerance.
"""
NUMBERS = "until", "first", "tolerance", "settled", "most_steps", "rtol", "atol", "live"
"""Constants in the order read by the code: see `Ends` and `LaneEnds`; the last is n of a sample."""


def continuous_code(rows: Rows, lanes: int, *, is_driven: bool) -> int:
    """Return the address of ``attempt``.

    ``attempt(rhs, residuals, keep, table, x, ahead, slopes, memory, found, numbers, drive, driven;
    ghost, stride, n)`` tries a step of every lane and accepts it in lanes with a small error. It
    returns bits: W for the lanes that need a check, W for those that left a domain, W for those
    accepted.

    The tableau ``rows`` is written into the code, and ``lanes`` is the vector width W. With
    ``is_driven``, inputs are set before every evaluation by ``drive`` of `segments`, and steps end
    at breakpoints.
    """
    identity = rows.starts.tolist(), rows.which.tolist(), rows.weights.tolist(), rows.exponent
    control = SAFETY, LEAST, MOST, SHRINK, FINEST, SHORTEST
    key = key_of((*identity, *control, lanes, is_driven), Path(__file__).parent)
    return code(key, lambda: _text(rows, lanes, is_driven), ("attempt",))["attempt"]


def _text(rows: Rows, lanes: int, is_driven: bool) -> str:
    module = Module()
    _Attempt(module, rows, lanes, is_driven).write()
    return module.text()


class _Attempt:
    """Writer of ``attempt``."""

    def __init__(self, module: Module, rows: Rows, lanes: int, is_driven: bool) -> None:
        names = "rhs", "residuals", "keep", "table", "x", "ahead", "slopes", "memory", "found"
        names, sizes = (*names, "numbers", "drive", "driven"), ("ghost", "stride", "n")
        f = self.f = Function(module, "attempt", names + sizes, width=lanes, numbers=sizes)
        self.exponent, self.is_driven = rows.exponent, is_driven
        self.terms = [
            list(zip(rows.which[a:b].tolist(), rows.weights[a:b].tolist()))
            for a, b in zip(rows.starts, rows.starts[1:])
        ]
        *self.stages, self.first, self.second = self.terms
        self.memory, self.numbers = Memory(f), numbers_of(f, NUMBERS)
        self.library = self.memory.library
        self.x, self.ahead = f.address("%x", "%ghost"), f.address("%ahead", "%ghost")
        self.slopes = [
            f.address("%slopes", f.integer("mul", "%stride", number))
            for number in range(len(self.stages) + 1)
        ]

    def write(self) -> None:
        """Write the complete function."""
        f, memory, library = self.f, self.memory, self.library
        wanted = memory[STEP]
        h = memory[STEP] = library.minimum(wanted, self._until() - memory[TIME])
        outside = "0"
        for stage in range(len(self.stages)):
            self._combine(stage, h)
            if stage == len(self.stages) - 1:
                f.do("call i64 %keep(ptr %table, ptr %ahead, ptr %ahead)")
            if self.is_driven:
                self._drive(stage, h)
            places = f"ptr %table, ptr %ahead, ptr {self.slopes[stage + 1]}"
            outside = f.integer("or", outside, f.value(f"call i64 %rhs({places})"))
        sizes = self._squares()
        f.do("call i64 %residuals(ptr %table, ptr %ahead, ptr %found)")
        accepted = self._judge(h, sizes, library.mask(outside))
        if self.is_driven:  # a step that a breakpoint has cut does not limit the next one
            is_cut = accepted & (h < wanted)
            memory[STEP] = library.where(
                is_cut, library.maximum(memory[STEP], wanted), memory[STEP]
            )
        over = f.bits((self._enter(accepted, h) | self._too_short(accepted)).name)
        self._accept(accepted)
        for part, bits in enumerate((outside, f.bits(accepted.name)), 1):
            over = f.integer("or", over, f.integer("shl", bits, part * f.width))
        f.done(over)

    # ---- time --------------------------------------------------------------------------------

    def _until(self) -> Vector:
        """Return the times that no step passes."""
        return self.memory[UNTIL] if self.is_driven else self.numbers["until"]

    def _ended(self, h: Vector) -> Vector:
        """Return the times at the ends of the steps."""
        began, until = self.memory[TIME], self._until()
        return self.library.where(h.equals(until - began), until, began + h)

    def _drive(self, stage: int, h: Vector) -> None:
        """Set the inputs to the times of a stage."""
        share = math.fsum(weight for _, weight in self.stages[stage])
        is_last = stage == len(self.stages) - 1
        self.memory[AT] = self._ended(h) if is_last else self.memory[TIME] + share * h
        self.f.do("call i64 %drive(ptr %driven, ptr %ahead, ptr %memory)")

    # ---- states ------------------------------------------------------------------------------

    def _places(self) -> Iterable[list[str]]:
        """Loop over blocks and yield the places of the vectors of each block."""
        f = self.f
        with f.loop(f.integer("sdiv", "%n", UNROLLED)) as block:
            first = f.integer("mul", block, UNROLLED)
            yield [f.integer("add", first, i * f.width) for i in range(UNROLLED // f.width)]

    def _sum(self, terms: list[tuple[int, float]], slopes: dict[int, str], total: str = "") -> str:
        """Return the weighted sum of slopes, added to a total."""
        f = self.f
        for number, weight in terms:
            if number not in slopes:
                continue
            slope, weight = slopes[number], f.constant(weight)
            total = f.fma(weight, slope, total) if total else f.op("fmul", weight, slope)
        return total or f.constant(0.0)

    def _combine(self, stage: int, h: Vector) -> None:
        """Write the state of a stage and, with the last one, the partial error estimates.

        The estimates replace the second and third slopes, which are not read any more.
        """
        f, terms = self.f, self.stages[stage]
        is_last = stage == len(self.stages) - 1
        estimates = (self.first, self.second) if is_last else ()
        known = {number for row in (terms, *estimates) for number, _ in row} - {len(self.stages)}
        for places in self._places():
            for place in places:
                slopes = {i: f.load(f.address(self.slopes[i], place)) for i in sorted(known)}
                x = f.load(f.address(self.x, place))
                moved = f.fma(h.name, self._sum(terms, slopes), x)
                f.store(moved, f.address(self.ahead, place))
                for row, estimate in enumerate(estimates, 1):
                    if estimate:
                        total = self._sum(estimate, slopes)
                        f.store(total, f.address(self.slopes[row], place))

    def _squares(self) -> list[Vector]:
        r"""Return sums of squares of both estimates over rtol max(\|x\|, \|ahead\|) + atol."""
        f, library, sums = self.f, self.library, [self.f.slot(), self.f.slot()]
        given = self.numbers["rtol"]
        share = library.minimum(SHRINK * (self.memory[WORST] / given), 1.0)
        share = library.maximum(share, FINEST / given)
        rtol, atol = ((share * self.numbers[name]).name for name in ("rtol", "atol"))
        last = len(self.stages)
        for places in self._places():
            scales = []
            for place in places:
                x, ahead = (f.load(f.address(base, place)) for base in (self.x, self.ahead))
                largest = f.larger(f.call("fabs", x), f.call("fabs", ahead))
                scales.append(f.fma(rtol, largest, atol))
            for place, inverse in zip(places, self._inverted(scales)):
                slope = {last: f.load(f.address(self.slopes[last], place))}
                for row, (estimate, total) in enumerate(zip((self.first, self.second), sums), 1):
                    if estimate:
                        so_far = f.load(f.address(self.slopes[row], place))
                        relative = f.op("fmul", self._sum(estimate, slope, so_far), inverse)
                        f.store(f.fma(relative, relative, f.load(total)), total)
        return [library.load(total) for total in sums]

    def _inverted(self, values: list[str]) -> list[str]:
        """Return the reciprocals, with one division per two values.

        Divisions take as long as all remaining operations.
        """
        f = self.f
        if len(values) % 2:
            return [f.op("fdiv", f.constant(1.0), value) for value in values]
        inverses = []
        for a, b in zip(values[::2], values[1::2]):
            both = f.op("fdiv", f.constant(1.0), f.op("fmul", a, b))
            inverses += [f.op("fmul", b, both), f.op("fmul", a, both)]
        return inverses

    def _accept(self, accepted: Vector) -> None:
        """Accept the states and slopes of these lanes."""
        f = self.f
        pairs = (self.x, self.ahead), (self.slopes[0], self.slopes[-1])
        for places in self._places():
            for place in places:
                for old, new in pairs:
                    at, there = f.address(old, place), f.address(new, place)
                    f.store(f.select(accepted.name, f.load(there), f.load(at)), at)

    # ---- lanes -------------------------------------------------------------------------------

    def _judge(self, h: Vector, sizes: list[Vector], outside: Vector) -> Vector:
        """Return the accepted lanes and set all next steps: see `integrator.next_step`."""
        memory, library = self.memory, self.library
        first, second = sizes
        both = library.fma(0.01, second, first) * self.numbers["live"]
        size = library.abs(h) * first / library.sqrt(both)
        size = library.where(first.equals(0.0), 0.0, size)
        size = library.where(outside, math.inf, size)
        good = size < 1.0
        factor = SAFETY * library.power(size, self.exponent)
        longer = library.minimum(factor, MOST)
        limited = library.minimum(longer, 1.0)
        longer = library.where(memory[REFUSED] > 0.0, limited, longer)
        memory[STEP] = h * library.where(good, longer, library.maximum(factor, LEAST))
        memory[REFUSED] = library.where(good, 0.0, 1.0)
        return good & (memory[RUNS] > 0.0)

    def _enter(self, accepted: Vector, h: Vector) -> Vector:
        """Enter time, steps and residuals of the lanes; return those to check.

        The states before a step are stored if the residual falls below the tolerance, to locate the
        exit.
        """
        f, memory, numbers = self.f, self.memory, self.numbers
        began, until = memory[TIME], self._until()
        time = memory.enter(TIME, accepted, self._ended(h))
        memory.enter(DONE, accepted, memory[DONE] + 1.0)
        worst, size, falls = memory.note(accepted, numbers["tolerance"], began)
        memory.enter(WORST, accepted, worst)

        def keep() -> list[str]:
            for places in self._places():
                for place in places:
                    before = f.load(f.address(self.x, place))
                    f.store(before, f.address(self.slopes[BEFORE], place))
            return []

        f.either(f.any_of(falls.name), keep, [])
        over = memory.is_over(accepted, worst, size, numbers["settled"], numbers["most_steps"])
        return over | (accepted & (time >= until)) | falls

    def _too_short(self, accepted: Vector) -> Vector:
        """Return the lanes whose next step is too short."""
        memory = self.memory
        most = self.library.maximum(memory[TIME], self.numbers["first"])
        is_long = memory[STEP] > SHORTEST * most
        return (memory[RUNS] > 0.0) & ~(is_long | accepted)
