"""A measured figure, and how it is shown. Every bench has ``figures()``, which yields them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One row of the table of measured figures.

    Attributes
    ----------
    name : str
        What was measured, on what.
    value : str
        The figure, with its unit.
    remark : str
        What it is to be read beside.
    good : bool
        Whether it meets its bar; True where there is none.
    """

    name: str
    value: str
    remark: str = ""
    good: bool = True

    def __str__(self) -> str:
        missed = "" if self.good else "  MISSES ITS BAR"
        return f"{self.name:58} {self.value:>18}  {self.remark}{missed}".rstrip()


def show(figures: Iterable[Figure]) -> int:
    """Print each figure when it is there; exit code 1 if one misses its bar."""
    good = True
    for figure in figures:
        print(figure, flush=True)
        good &= figure.good
    return int(not good)
