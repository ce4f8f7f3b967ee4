"""Memory of the lanes, shared by vector code and compiled loops.

Every row contains one number per lane.
"""

from __future__ import annotations

import math

from ann_dc.backends.batched.vectors import Vector, VectorLibrary
from ann_dc.evaluation.codegen.writer import Function

(RUNS, STEP, TIME, DONE, CONSTRAINT, STATIONARITY, SINCE, SINCE_TIME, LARGEST, TURN, BEST,
 BEST_BEFORE) = range(12)  # fmt: skip
"""Memory rows: presence of a sample; step length; network time; number of steps; two residuals;
step and time since which they stay below the tolerance (-1 before); largest state that is not an
overflow; step of the next headway check; lowest residual of this window and of the last.
"""
OWN = 12
"""First row of those specific to a stepping method."""


class Memory:
    """Memory rows as read and written by the code, at the argument ``memory``."""

    def __init__(self, f: Function) -> None:
        self.f, self.library = f, VectorLibrary(f)

    def _at(self, row: int) -> str:
        return self.f.address("%memory", row * self.f.width)

    def __getitem__(self, row: int) -> Vector:
        return self.library.load(self._at(row))

    def __setitem__(self, row: int, value: Vector) -> None:
        self.f.store(value.name, self._at(row))

    def enter(self, row: int, chosen: Vector, value: Vector | float) -> Vector:
        """Write a value in chosen lanes; return the resulting row."""
        self[row] = found = self.library.where(chosen, value, self[row])
        return found

    def note(
        self, chosen: Vector, tolerance: Vector, begun: Vector
    ) -> tuple[Vector, Vector, Vector]:
        """Enter the residuals in ``found`` in chosen lanes, and since when they are small.

        A residual that falls below the tolerance does so at the time ``begun``. Returns the larger
        residual, the largest state, and a mask of the lanes whose residual has fallen below.
        """
        library, width = self.library, self.f.width
        both = library.load("%found"), library.load(self.f.address("%found", width))
        for row, residual in zip((CONSTRAINT, STATIONARITY), both):
            self.enter(row, chosen, residual)
        worst, since = library.maximum(*both), self[SINCE]
        below, was_below = worst < tolerance, since >= 0.0
        falls = chosen & below & ~was_below
        self.enter(SINCE_TIME, falls, begun)
        since = library.where(was_below, since, self[DONE])
        self.enter(SINCE, chosen, library.where(below, since, -1.0))
        return worst, library.load(self.f.address("%found", 2 * width)), falls

    def is_over(
        self, chosen: Vector, worst: Vector, size: Vector, settled: Vector, most: Vector
    ) -> Vector:
        """Return the chosen lanes that loops must check, since they are very likely done."""
        self.enter(BEST, chosen, self.library.minimum(worst, self[BEST]))
        done = self[DONE]
        is_lost = ~(worst < math.inf) | ~(size < self[LARGEST])
        return chosen & ((worst < settled) | is_lost | (done >= most) | (done >= self[TURN]))


def numbers_of(f: Function, names: tuple[str, ...]) -> dict[str, Vector]:
    """Return the constants at the argument ``numbers`` by name, the same in every lane."""
    return {
        name: Vector(f, f.spread(f.load(f.address("%numbers", i), 1)))
        for i, name in enumerate(names)
    }
