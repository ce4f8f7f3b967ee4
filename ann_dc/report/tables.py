"""The shapes in which results are said: tables, rows with names, verdicts, ranges of numbers.

Every command's report is made of these, so that all look alike and fit into 80 letters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from ann_dc.problem.declaration import OptimalControlProblem


def table(*columns: str, dense: bool = False) -> Table:
    """A table; dense ones have many columns and still fit into 80 letters."""
    shown = Table(box=box.SIMPLE_HEAD, show_edge=False, padding=0) if dense else Table()
    for column in columns:
        shown.add_column(column, overflow="fold")
    return shown


def named_rows(rows: Mapping[str, object]) -> Table:
    """A table of names and what is said of them, letter by letter."""
    shown = Table(show_header=False)
    shown.add_column(no_wrap=True, style="bold")
    shown.add_column(overflow="fold")
    for name, value in rows.items():
        shown.add_row(name, value if isinstance(value, Text) else Text(printable(str(value))))
    return shown


def printable(text: str) -> str:
    r"""A text for the eye: what would move a terminal's cursor is a question mark.

    >>> printable("\x1b[2Jcar")
    '?[2Jcar'
    """
    return "".join(sign if sign.isprintable() or sign == "\n" else "?" for sign in text)


def verdict_text(good: bool, verdict: str) -> Text:
    """Certified or not, and why."""
    return Text(f"{'yes' if good else 'no'}: {verdict}", "green" if good else "red")


def unit_list(problem: OptimalControlProblem) -> str:
    """What has a unit of measure, and which; dt always has.

    >>> from ann_dc import plants
    >>> unit_list(plants.double_integrator())
    'x (m), v (m/s), a (m/s^2), dt (s)'
    """
    names = [str(s) for s in (*problem.states, *problem.controls, *problem.inputs)]
    units = [*((name, problem.unit(name)) for name in names), ("dt", problem.time_unit)]
    units += [("cost", problem.cost_unit)]
    return ", ".join(f"{name} ({unit})" for name, unit in units if unit)


def span(values: Any) -> str:
    """One number, or the range of those that differ from row to row or stage to stage.

    >>> span([1, 2.5, 2]), span(3.0)
    ('(1 .. 2.5)', '3')
    """
    each = [float(value) for value in values] if hasattr(values, "__len__") else [float(values)]
    low, high = f"{min(each):.4g}", f"{max(each):.4g}"
    return low if low == high else f"({low} .. {high})"


def measured(value: float, error: float, most: int = 4) -> str:
    """A number with the digits that it is good for, and two where its error is not known.

    >>> measured(35.7254, 0.085), measured(650.9, 1.4), measured(123.9, 5.5)
    ('35.7', '651', '120')
    >>> measured(35.7254, float("nan")), measured(35.7254, 0.0)
    ('36', '35.73')
    """
    if not math.isfinite(value) or value == 0:
        return f"{value:g}"
    first = math.floor(math.log10(abs(value)))
    last = first - 1
    if math.isfinite(error):
        last = math.ceil(math.log10(error / 2)) if error > 0 else first - most
    last = min(max(last, first - most + 1), first)
    return f"{round(value, -last):.{max(-last, 0)}f}"
