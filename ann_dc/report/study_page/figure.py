"""Figure of the page: plotly.js data and captions.

A figure is plain data. Names and texts of a store are escaped on input, because plotly interprets
some HTML in every text.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from ann_dc.report.statistics import Limit
from ann_dc.report.study_columns import Column

BLUE, RED, GREEN, ORANGE, VIOLET, GREY = (
    "#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#777777",
)  # fmt: skip
"""Colours that remain distinct for colour-blind readers (Okabe and Ito)."""
COLOURS = (BLUE, RED, GREEN, ORANGE, VIOLET)
"""Colours of settings or outcomes, in this order."""
INK = "#111111"
DRAWN = 2000
"""Largest number of drawn cases; counts and fits use all cases."""
HEIGHT = 360
LONG = 30
"""Title length in characters from which the unit has a separate line."""

_AXIS = {
    "showline": True, "mirror": True, "linecolor": "#888", "ticks": "outside", "tickcolor": "#888",
    "gridcolor": "#e8e8e8", "zeroline": False, "automargin": True,
}  # fmt: skip
_LAYOUT = {
    "autosize": True, "height": HEIGHT, "paper_bgcolor": "#fff", "plot_bgcolor": "#fff",
    "font": {"family": "system-ui, sans-serif", "size": 12, "color": "#222"},
    "margin": {"l": 62, "r": 18, "t": 36, "b": 52}, "hovermode": "closest",
    "legend": {
        "orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "traceorder": "normal",
        "itemsizing": "constant",
    },
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Figure:
    """One figure: a description with the number of cases, and traces of plotly.js."""

    title: str
    says: str
    traces: list[dict[str, Any]]
    layout: dict[str, Any] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """Return the input of plotly.js."""
        single = sum(trace.get("showlegend", True) for trace in self.traces) < 2
        return {"data": self.traces, "layout": {**_LAYOUT, "showlegend": not single, **self.layout}}


def shown(text: object) -> str:
    """Return a text escaped for plotly.js."""
    return escape(str(text), quote=False)


def axis(column: Column, **others: Any) -> dict[str, Any]:
    """Return the axis of a column (linear, logarithmic or text) with further options."""
    found = plain_axis(_title(column), **others)
    if column.numbers is None:
        return {**found, "type": "category"}
    if not column.is_wide:
        return found
    step = int(np.ceil(np.log10(column.spans) / 8))
    minor = {"ticks": "outside", "ticklen": 3} if step == 1 else {}
    return {**found, "type": "log", "dtick": step, "exponentformat": "power", "minor": minor}


def _title(column: Column) -> str:
    """Return name and unit, on two lines if they are long."""
    if len(column.label) <= LONG or not column.unit:
        return shown(column.label)
    return f"{shown(column.name)}<br>[{shown(column.unit)}]"


def plain_axis(title: str, **others: Any) -> dict[str, Any]:
    """Return an axis that does not belong to a column; the title is plotly.js text."""
    return {**_AXIS, "title": {"text": title, "font": {"size": 12}}, **others}


def drawn(rows: np.ndarray, *, keep: np.ndarray | None = None) -> np.ndarray:
    """Return the records to draw: all, or a reproducible random subset.

    Records in `keep` are always drawn.
    """
    if len(rows) <= DRAWN:
        return rows
    some = np.random.default_rng(0).choice(rows, DRAWN, replace=False)
    return np.union1d(some, rows[:0] if keep is None else keep)


def listed(values: Any, digits: int = 5) -> list[Any]:
    """Return numbers with few digits as JSON data."""
    found = [float(f"{value:.{digits}g}") for value in np.asarray(values, float)]
    return [value if np.isfinite(value) else None for value in found]


def limit_lines(limit: Limit | None, across: str) -> list[dict[str, Any]]:
    """Return dashed lines at the limits of a metric; `across` is its axis, x or y."""
    other = "y" if across == "x" else "x"
    dashes = {"color": RED, "width": 1.5, "dash": "dash"}
    return [
        {
            "type": "line", f"{across}0": end, f"{across}1": end,
            f"{other}0": 0, f"{other}1": 1, f"{other}ref": "paper", "line": dashes,
        }
        for end in (() if limit is None else limit.ends)
    ]  # fmt: skip


def reported(count: int, drawn_of_it: int, *more: str, limit: Limit | None = None) -> str:
    """Return the caption text of the number of cases, with further sentences and the limit."""
    few = f", {drawn_of_it:,} of them drawn" if drawn_of_it < count else ""
    dashed = [] if limit is None else [f"Dashed: the spec, {limit}"]
    return ". ".join([f"{count:,} points{few}", *more, *dashed]) + "."


def percent(share: float, digits: int = 1) -> str:
    """Return a fraction in percent, with `digits` decimals."""
    return f"{100 * share:.{digits}f} %"
