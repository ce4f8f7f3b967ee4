"""A measured figure, and how it is shown. Every bench has ``figures()``, which yields them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path


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
    number : float
        The figure alone, for a picture; nan where none is drawn.
    """

    name: str
    value: str
    remark: str = ""
    good: bool = True
    number: float = math.nan

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


def picture(figures: Sequence[Figure], file: str | Path, label: str) -> None:
    """Draw the numbers of figures as bars, one below the other.

    Parameters
    ----------
    figures : sequence of Figure
    file : str or Path
    label : str
        Of the axis, with the unit.
    """
    from ann_dc.plotting.style import BLUE, INK, new_figure, quiet

    drawn = [figure for figure in figures if math.isfinite(figure.number)]
    sheet = new_figure(8.0, 0.8 + 0.24 * len(drawn))
    axes = sheet.subplots()
    rows = range(len(drawn), 0, -1)
    axes.barh(rows, [figure.number for figure in drawn], color=BLUE, height=0.6)
    for row, figure in zip(rows, drawn):
        axes.annotate(
            f"{figure.number:.3g}", (figure.number, row), xytext=(3, 0),
            textcoords="offset points", va="center", fontsize=7, color=INK,
        )  # fmt: skip
    axes.set_yticks(rows, [figure.name for figure in drawn], fontsize=8)
    axes.set_xscale("log")
    axes.set_xlabel(label)
    quiet(axes)
    sheet.savefig(file, dpi=150)
