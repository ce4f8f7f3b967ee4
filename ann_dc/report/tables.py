"""Layout of reports: tables, named rows, verdicts and ranges of numbers.

All commands use these elements, which fit into 80 characters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ann_dc.problem.declaration import OptimalControlProblem


def table(*columns: str, dense: bool = False) -> Table:
    """Return an empty table without borders; a dense table fits more columns into a line."""
    shown = Table(box=None, padding=(0, 1 if dense else 2, 0, 0), pad_edge=False)
    shown.title_justify = shown.caption_justify = "left"
    for column in columns:
        shown.add_column(column, overflow="fold")
    return shown


def named_rows(rows: Mapping[str, object], width: int = 0) -> Table:
    """Return a table of names and literal values, without borders.

    ``width`` is the least width of the names, for alignment with another table.
    """
    shown = Table(show_header=False, box=None, padding=(0, 2, 0, 0), pad_edge=False)
    shown.add_column(no_wrap=True, style="bold", min_width=width)
    shown.add_column(overflow="fold")
    for name, value in rows.items():
        shown.add_row(name, value if isinstance(value, Text) else Text(printable(str(value))))
    return shown


def compared_rows(
    sources: Sequence[str], rows: Mapping[str, Sequence[str]], width: int = 0
) -> Table:
    """Return a table of named quantities with a value from every source, and a note."""
    shown = table("", *sources, "")
    shown.columns[0].style, shown.columns[0].min_width = "bold", width
    shown.columns[0].no_wrap = True
    for name, values in rows.items():
        shown.add_row(name, *(printable(value) for value in values))
    return shown


def indented(shown: Table) -> Padding:
    """Return a table that is indented below a headline."""
    return Padding(shown, (0, 0, 0, 2), expand=False)


def headline(name: str, result: str, good: bool) -> Text:
    """Return the name of a problem and its result in one line, in the colour of the result."""
    colour = "green" if good else "red"
    return Text.assemble((f"{printable(name)}: ", "bold"), (result, colour))


def printable(text: str) -> str:
    r"""Return a text with terminal control characters replaced by question marks.

    >>> printable("\x1b[2Jcar")
    '?[2Jcar'
    """
    return "".join(sign if sign.isprintable() or sign == "\n" else "?" for sign in text)


def verdict_text(good: bool, verdict: str) -> Text:
    """Return the verdict in the colour of success or failure."""
    return Text(f"{'yes' if good else 'no'}: {verdict}", "green" if good else "red")


def unit_list(problem: OptimalControlProblem) -> str:
    """Return the quantities with their units of measure; time always has one.

    >>> from ann_dc import plants
    >>> unit_list(plants.double_integrator())
    'x (m), v (m/s), a (m/s^2), time (s)'
    """
    names = [str(s) for s in (*problem.states, *problem.controls, *problem.inputs)]
    units = [*((name, problem.unit(name)) for name in names), ("time", problem.time_unit)]
    units += [("cost", problem.cost_unit)]
    return ", ".join(f"{name} ({unit})" for name, unit in units if unit)


def span(values: Any) -> str:
    """Return one number, or the range of numbers that differ between rows or stages.

    >>> span([1, 2.5, 2]), span(3.0)
    ('(1 .. 2.5)', '3')
    """
    each = [float(value) for value in values] if hasattr(values, "__len__") else [float(values)]
    low, high = f"{min(each):.4g}", f"{max(each):.4g}"
    return low if low == high else f"({low} .. {high})"


def measured(value: float, error: float, most: int = 4) -> str:
    """Return a number with its significant digits; two if its error is unknown.

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
