"""Memory of the lanes, shared by vector code and compiled loops.

Every row contains one number per lane.
"""

from __future__ import annotations

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
    """Memory rows as read and written by the code; ``base`` is their address."""

    def __init__(self, f: Function, base: str = "%memory") -> None:
        self.f, self.base = f, base

    def _at(self, row: int) -> str:
        return self.f.address(self.base, row * self.f.width)

    def __getitem__(self, row: int) -> str:
        return self.f.load(self._at(row))

    def __setitem__(self, row: int, value: str) -> None:
        self.f.store(value, self._at(row))

    def enter(self, row: int, chosen: str, value: str) -> str:
        """Write a value in chosen lanes; return the resulting row."""
        self[row] = found = self.f.select(chosen, value, self[row])
        return found

    def note(self, chosen: str, found: str) -> tuple[str, str]:
        """Store the residuals at an address in chosen lanes.

        Returns the larger residual and the largest state.
        """
        f, width = self.f, self.f.width
        both = f.load(found), f.load(f.address(found, width))
        for row, residual in zip((CONSTRAINT, STATIONARITY), both):
            self.enter(row, chosen, residual)
        return f.larger(*both), f.load(f.address(found, 2 * width))

    def is_over(self, chosen: str, worst: str, size: str, settled: str, most: str) -> str:
        """Return the chosen lanes that loops must check, since they are very likely done."""
        f = self.f
        self.enter(BEST, chosen, f.smaller(worst, self[BEST]))
        signs = (
            f.compare("olt", worst, settled),
            f.compare("uge", worst, f.constant(float("inf"))),
            f.compare("uge", size, self[LARGEST]),
            f.compare("oge", self[DONE], most),
            f.compare("oge", self[DONE], self[TURN]),
        )
        return f.logical("and", chosen, f.any_mask(*signs))
