"""What every lane remembers: rows of as many numbers, for vector code and for compiled loops."""

from __future__ import annotations

from ann_dc.evaluation.codegen.writer import Function

(RUNS, STEP, TIME, DONE, CONSTRAINT, STATIONARITY, SINCE, SINCE_TIME, LARGEST, TURN, BEST,
 BEST_BEFORE) = range(12)  # fmt: skip
"""Whether there is a sample; length of a step; network time; steps done; residuals; since which
step and time they stay below the tolerance (-1 before); largest state that is no overflow; step at
which headway is asked for next; lowest residual of this window and of the last."""
OWN = 12
"""The first row of those that belong to a way to take steps."""


class Memory:
    """The rows, as code under way reads and writes them.

    Parameters
    ----------
    f : Function
    base : str
        Address of the first.
    """

    def __init__(self, f: Function, base: str = "%memory") -> None:
        self.f, self.base = f, base

    def _at(self, row: int) -> str:
        return self.f.address(self.base, row * self.f.width)

    def __getitem__(self, row: int) -> str:
        return self.f.load(self._at(row))

    def __setitem__(self, row: int, value: str) -> None:
        self.f.store(value, self._at(row))

    def enter(self, row: int, chosen: str, value: str) -> str:
        """A value in chosen lanes; the row as it is then."""
        self[row] = found = self.f.select(chosen, value, self[row])
        return found

    def note(self, chosen: str, found: str) -> tuple[str, str]:
        """Residuals at an address, in chosen lanes; the larger one, and the largest state."""
        f, width = self.f, self.f.width
        both = f.load(found), f.load(f.address(found, width))
        for row, residual in zip((CONSTRAINT, STATIONARITY), both):
            self.enter(row, chosen, residual)
        return f.larger(*both), f.load(f.address(found, 2 * width))

    def is_over(self, chosen: str, worst: str, size: str, settled: str, most: str) -> str:
        """Chosen lanes at which loops have to look more closely: very likely they are done."""
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
