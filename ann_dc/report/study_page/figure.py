"""One figure of the page: what plotly.js is told, and the words around it.

A figure is plain data. Names and words of a store are escaped on their way into it, because
plotly reads a little HTML in every text.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Any

import numpy as np

from ann_dc.report.fractions import Limit
from ann_dc.report.study_columns import Column

BLUE, RED, GREEN, ORANGE, VIOLET, GREY = (
    "#0072b2", "#d55e00", "#009e73", "#e69f00", "#cc79a7", "#777777",
)  # fmt: skip
"""Colours that differ for colour-blind eyes too (Okabe and Ito)."""
DRAWN = 2000
"""Points of a figure that are drawn at most; what is counted and fitted has all of them."""
HEIGHT = 360
LONG = 30
"""Letters of a title from which on the unit has a line of its own."""

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
    """One figure.

    Attributes
    ----------
    title : str
    says : str
        What is drawn, and how many points.
    traces : list of dict
        As plotly.js takes them.
    layout : dict
    """

    title: str
    says: str
    traces: list[dict[str, Any]]
    layout: dict[str, Any] = field(default_factory=dict)

    def content(self) -> dict[str, Any]:
        """What plotly.js is told."""
        single = sum(trace.get("showlegend", True) for trace in self.traces) < 2
        return {"data": self.traces, "layout": {**_LAYOUT, "showlegend": not single, **self.layout}}


def shown(text: object) -> str:
    """A text as plotly.js is told it.

    Parameters
    ----------
    text : object

    Examples
    --------
    >>> shown("<b>x")
    '&lt;b&gt;x'
    """
    return escape(str(text), quote=False)


def axis(column: Column, **others: Any) -> dict[str, Any]:
    """The axis of a column: linear or logarithmic, or of words.

    Parameters
    ----------
    column : Column
    **others : object
        What plotly.js is told beside.
    """
    found = plain_axis(_title(column), **others)
    if column.numbers is None:
        return {**found, "type": "category"}
    if not column.is_wide:
        return found
    step = int(np.ceil(np.log10(column.spans) / 8))
    minor = {"ticks": "outside", "ticklen": 3} if step == 1 else {}
    return {**found, "type": "log", "dtick": step, "exponentformat": "power", "minor": minor}


def _title(column: Column) -> str:
    """Name and unit, on two lines where they are long."""
    if len(column.label) <= LONG or not column.unit:
        return shown(column.label)
    return f"{shown(column.name)}<br>[{shown(column.unit)}]"


def plain_axis(title: str, **others: Any) -> dict[str, Any]:
    """An axis of something that is no column.

    Parameters
    ----------
    title : str
        As plotly.js takes it.
    **others : object
        What plotly.js is told beside.
    """
    return {**_AXIS, "title": {"text": title, "font": {"size": 12}}, **others}


def drawn(rows: np.ndarray, *, keep: np.ndarray | None = None) -> np.ndarray:
    """Rows to draw: all, or a few drawn at random but the same ones every time.

    Parameters
    ----------
    rows : array (m,) of int
    keep : array of int, optional
        Those among them that are drawn in any case.
    """
    if len(rows) <= DRAWN:
        return rows
    some = np.random.default_rng(0).choice(rows, DRAWN, replace=False)
    return np.union1d(some, rows[:0] if keep is None else keep)


def listed(values: Any, digits: int = 5) -> list[Any]:
    """Numbers as JSON takes them, short.

    Parameters
    ----------
    values : array-like
    digits : int
    """
    found = [float(f"{value:.{digits}g}") for value in np.asarray(values, float)]
    return [value if np.isfinite(value) else None for value in found]


def limit_lines(limit: Limit | None, across: str) -> list[dict[str, Any]]:
    """Dashed lines where a spec has its ends.

    Parameters
    ----------
    limit : Limit or None
    across : str
        The axis that has the metric, x or y.
    """
    other = "y" if across == "x" else "x"
    dashes = {"color": RED, "width": 1.5, "dash": "dash"}
    return [
        {
            "type": "line", f"{across}0": end, f"{across}1": end,
            f"{other}0": 0, f"{other}1": 1, f"{other}ref": "paper", "line": dashes,
        }
        for end in (() if limit is None else limit.ends)
    ]  # fmt: skip


def told(count: int, drawn_of_it: int, *more: str) -> str:
    """What a caption says of points.

    Parameters
    ----------
    count, drawn_of_it : int
    *more : str
        Further sentences.
    """
    few = f", {drawn_of_it:,} of them drawn" if drawn_of_it < count else ""
    return ". ".join([f"{count:,} points{few}", *more]) + "."


def limit_of(metric: Column, spec: Sequence[Limit]) -> Limit | None:
    """The item of the spec that is about a metric.

    Parameters
    ----------
    metric : Column
    spec : sequence of Limit
    """
    return next((limit for limit in spec if limit.column is metric), None)
