"""Figures of what a metric depends on: one setting, its words, two settings; and of the yield."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ann_dc.report.findings import (
    Band,
    Column,
    Findings,
    Limit,
    band,
    boxes,
    groups,
    within,
    yield_of,
)
from ann_dc.report.study_page.figure import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    Figure,
    axis,
    drawn,
    limit_lines,
    listed,
    plain_axis,
    shown,
    told,
)
from ann_dc.study.keeping.rows import OUTCOME

CELLS = 60
"""Different values of a setting that a map has a row or a column each for."""
STRIP = 8
"""Points a word up to which there is no box."""
FILLED = 0.6
"""Share of its cells that a map needs points in."""


def over_numbers(
    found: Findings, metric: Column, setting: Column, limit: Limit | None
) -> Figure | None:
    """A metric over a setting of numbers: points, median, band of 5 to 95 %; None without points.

    Parameters
    ----------
    found : Findings
    metric, setting : Column
    limit : Limit or None
        What the spec says of the metric.
    """
    known = np.flatnonzero(metric.finite & setting.finite)
    if not len(known):
        return None
    assert metric.numbers is not None
    assert setting.numbers is not None
    extremes = known[[np.argmin(metric.numbers[known]), np.argmax(metric.numbers[known])]]
    some = drawn(known, keep=extremes)
    groups_of_it = band(setting, metric)
    lines, more = [], []
    if groups_of_it is not None:
        lines = _band(groups_of_it)
        more = ["Line: median; band: 5 to 95 %"]
    elif len(found.varied) == 1 and len(known) == len(np.unique(setting.numbers[known])):
        some = some[np.argsort(setting.numbers[some])]
        lines = [_line(setting.numbers[some], metric.numbers[some])]
    layout = {
        "xaxis": axis(setting), "yaxis": axis(metric), "shapes": limit_lines(limit, "y"),
    }  # fmt: skip
    dots = _dots(found, setting, metric, some)
    return Figure(
        title=f"{metric.name} over {setting.name}",
        says=told(len(known), len(some), *more, *_dashed(limit)),
        traces=[*dots, *lines],
        layout=layout,
    )


def _dashed(limit: Limit | None) -> list[str]:
    return [] if limit is None else [f"Dashed: the spec, {limit}"]


def _line(x: np.ndarray, y: np.ndarray) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "lines", "x": listed(x), "y": listed(y), "hoverinfo": "skip",
        "showlegend": False, "line": {"color": BLUE, "width": 1},
    }  # fmt: skip


def _band(found: Band) -> list[dict[str, Any]]:
    x, edge = listed(found.at), {"type": "scatter", "mode": "lines", "line": {"width": 0}}
    hidden = {**edge, "x": x, "hoverinfo": "skip", "showlegend": False}
    return [
        {**hidden, "y": listed(found.quantiles[0])},
        {**hidden, "y": listed(found.quantiles[4]), "fill": "tonexty", "fillcolor": "#0000001f"},
        {
            "type": "scatter", "mode": "lines+markers", "name": "median", "x": x,
            "y": listed(found.quantiles[2]), "line": {"color": "#111", "width": 2},
            "marker": {"color": "#111", "size": 5}, "showlegend": False,
            "customdata": [int(count) for count in found.counts],
            "hovertemplate": "%{x}<br>median %{y}<br>%{customdata} points<extra></extra>",
        },
    ]  # fmt: skip


def _dots(
    found: Findings, setting: Column, metric: Column, rows: np.ndarray
) -> list[dict[str, Any]]:
    """Points, by outcome: the most frequent ones each in a colour."""
    outcome = found.columns.get(OUTCOME)
    codes = np.zeros(len(rows), int)
    names: Sequence[str] = ("points",)
    if outcome is not None and outcome.codes is not None:
        codes, names = outcome.codes[rows], outcome.words
    kinds = np.argsort(-np.bincount(codes), kind="stable")
    colours = (BLUE, RED, GREEN, ORANGE, VIOLET)
    traces = []
    for place, kind in enumerate(kinds[np.bincount(codes)[kinds] > 0]):
        colour = colours[place] if place < len(colours) else GREY
        of_it = rows[codes == kind]
        traces.append(_points(found, setting, metric, of_it, (names[kind], colour)))
    return traces


def _points(
    found: Findings, setting: Column, metric: Column, rows: np.ndarray, look: tuple[str, str]
) -> dict[str, Any]:
    name, colour = look
    dense = len(rows) > 300
    return {
        "type": "scatter", "mode": "markers", "name": shown(name[:40]),
        "x": _at(setting, rows), "y": _at(metric, rows),
        "customdata": [int(point) for point in found.points[rows]],
        "hovertemplate": "%{x}<br>%{y}<br>point %{customdata}<extra></extra>",
        "marker": {"color": colour, "size": 4 if dense else 7, "opacity": 0.4 if dense else 0.8},
    }  # fmt: skip


def _at(column: Column, rows: np.ndarray) -> list[Any]:
    if column.numbers is not None:
        return listed(column.numbers[rows])
    assert column.codes is not None
    return [shown(column.words[code]) for code in column.codes[rows]]


def over_words(found: Findings, metric: Column, setting: Column, limit: Limit | None) -> Figure:
    """A metric by the words of a setting: boxes of many points, or the points themselves.

    Parameters
    ----------
    found : Findings
    metric, setting : Column
    limit : Limit or None
        What the spec says of the metric.
    """
    groups_of_it = boxes(setting, metric)
    layout = {"xaxis": axis(setting), "yaxis": axis(metric), "shapes": limit_lines(limit, "y")}
    count, title = int(metric.finite.sum()), f"{metric.name} by {setting.name}"
    if groups_of_it.counts.max() <= STRIP:
        rows = np.flatnonzero(metric.finite)
        dots = _dots(found, setting, metric, rows)
        says = told(count, count, *_dashed(limit))
        return Figure(title=title, says=says, traces=dots, layout=layout)
    low, first, middle, third, high = (listed(row) for row in groups_of_it.quantiles)
    trace = {
        "type": "box", "x": [shown(setting.words[code]) for code in groups_of_it.at],
        "q1": first, "median": middle, "q3": third, "lowerfence": low, "upperfence": high,
        "fillcolor": "#0072b233", "line": {"color": BLUE}, "name": "",
    }  # fmt: skip
    says = told(count, count, "Box: 25, 50 and 75 %; whiskers: 5 and 95 %", *_dashed(limit))
    return Figure(title=title, says=says, traces=[trace], layout=layout)


def over_two(metric: Column, across: Column, up: Column) -> Figure | None:
    """The median of a metric over two settings of numbers, as a map; None where it has gaps.

    Parameters
    ----------
    metric, across, up : Column
    """
    import pandas

    known = metric.finite & across.finite & up.finite
    count = int(known.sum())
    (x, column), (y, line) = (_cells(setting, known, count) for setting in (across, up))
    shape = (len(y) - 1, len(x) - 1)
    assert metric.numbers is not None
    medians = pandas.Series(metric.numbers[known]).groupby([line, column]).median()
    if len(medians) < FILLED * shape[0] * shape[1]:
        return None
    values = np.full(shape, np.nan)
    values[tuple(np.array(medians.index.tolist()).T)] = medians
    bar: dict[str, Any] = {"title": {**axis(metric)["title"], "side": "right"}}
    hover = [[f"median {value:.4g}" for value in row] for row in values]
    if metric.is_wide:
        values = np.log10(values)
        ends = np.arange(np.floor(np.nanmin(values)), np.nanmax(values) + 1)
        bar |= {"tickvals": listed(ends), "ticktext": [f"10<sup>{end:.0f}</sup>" for end in ends]}
    trace = {
        "type": "heatmap", "x": listed(x), "y": listed(y), "z": [listed(row) for row in values],
        "colorscale": "Viridis", "colorbar": bar, "text": hover,
        "hovertemplate": "%{x}<br>%{y}<br>%{text}<extra></extra>",
    }  # fmt: skip
    return Figure(
        title=f"{metric.name} over {across.name} and {up.name}",
        says=f"Median of {count:,} points in {shape[1]} x {shape[0]} cells.",
        traces=[trace],
        layout={"xaxis": axis(across), "yaxis": axis(up)},
    )


def _cells(setting: Column, known: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges of the cells of a map along a setting, and the cell of every known row."""
    assert setting.numbers is not None
    there, back = (np.log, np.exp) if setting.is_wide else (np.array, np.array)
    values, distinct = there(setting.numbers[known]), there(setting.distinct)
    if len(distinct) <= CELLS:
        inner = (distinct[1:] + distinct[:-1]) / 2
        first, last = 2 * distinct[0] - inner[0], 2 * distinct[-1] - inner[-1]
        edges = np.array([first, *inner, last])
    else:
        number = int(np.clip(np.sqrt(count / 8), 4, 25))
        edges = np.linspace(values.min(), values.max(), number + 1)
    return back(edges), np.searchsorted(edges[1:-1], values, side="right")


def yield_over(found: Findings, setting: Column) -> Figure | None:
    """The share within the spec over a setting, with its interval; None for too few points.

    Parameters
    ----------
    found : Findings
    setting : Column
        Of numbers.
    """
    group = groups(setting)
    if group is None:
        return None
    good = within(found)
    rows = [np.flatnonzero(group == number) for number in range(group.max() + 1)]
    shares = [yield_of(good[of_it]) for of_it in rows]
    assert setting.numbers is not None
    at = [np.median(setting.numbers[of_it]) for of_it in rows]
    value = np.array([one.share for one in shares])
    low, high = np.array([one.interval for one in shares]).T
    trace = {
        "type": "scatter", "mode": "lines+markers", "x": listed(at), "y": listed(value),
        "error_y": {"type": "data", "symmetric": False, "array": listed(high - value),
                    "arrayminus": listed(value - low), "thickness": 1.2},
        "marker": {"color": GREEN, "size": 7}, "line": {"color": GREEN},
        "customdata": [one.count for one in shares],
        "hovertemplate": "%{x}<br>%{y:.2%} of %{customdata}<extra></extra>",
    }  # fmt: skip
    share = plain_axis("within the spec", tickformat=".0%", range=[-0.03, 1.03])
    return Figure(
        title=f"Yield over {setting.name}",
        says=f"{int((group >= 0).sum()):,} points. Bars: Clopper-Pearson intervals at 95 %.",
        traces=[trace],
        layout={"xaxis": axis(setting), "yaxis": share},
    )
