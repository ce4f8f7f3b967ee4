"""Figures of metrics and yield over settings, of distributions and predictions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ann_dc.report.statistics import Findings, Prediction
from ann_dc.report.study_columns import (
    Band,
    Column,
    Combination,
    band,
    combinations,
    is_clustered,
)
from ann_dc.report.study_page.figure import (
    BLUE,
    COLOURS,
    GREEN,
    GREY,
    INK,
    RED,
    Figure,
    axis,
    drawn,
    limit_lines,
    listed,
    percent,
    plain_axis,
    reported,
    shown,
)
from ann_dc.study.records import OUTCOME

CELLS = 60
"""Largest number of different setting values with one row or column each in a map."""
LINES = len(COLOURS)
"""Largest number of combinations of other settings with one line and colour each."""
SYMBOLS = ("circle", "x", "diamond", "square", "triangle-up")
"""Markers of outcomes if colours show combinations of settings."""
STRIP = 8
"""Cases per text value up to which no box is drawn."""
FILLED = 0.6
"""Fraction of the cells of a map that must contain cases."""


def over_numbers(found: Findings, metric: Column, setting: Column) -> Figure | None:
    """Plot a metric over a numeric setting: cases, medians, bands of 5 to 95 %.

    Every combination of the other settings has a line in its colour, up to `LINES`; with more, no
    lines are drawn. A line has a gap at cases that form two clusters. Return None without cases.
    """
    known = np.flatnonzero(metric.finite & setting.finite)
    if not len(known):
        return None
    values, limit = metric.as_numbers[known], found.limit_of(metric)
    some = drawn(known, keep=known[[np.argmin(values), np.argmax(values)]])
    others = [one for one in found.varied if one is not setting]
    parts = combinations(others, known, LINES)
    lines, more = _lines(setting, metric, parts)
    labelled = parts if parts is not None and len(parts) > 1 else None
    layout = {
        "xaxis": axis(setting), "yaxis": axis(metric), "shapes": limit_lines(limit, "y"),
    }  # fmt: skip
    return Figure(
        title=f"{metric.name} over {setting.name}",
        says=reported(len(known), len(some), *more, limit=limit),
        traces=[*_dots(found, setting, metric, some, labelled), *lines],
        layout=layout,
    )


def _lines(
    setting: Column, metric: Column, parts: list[Combination] | None
) -> tuple[list[dict[str, Any]], list[str]]:
    """Return lines for all combinations of the other settings, and caption texts."""
    if parts is None:
        return [], ["No lines: too many combinations of other settings"]
    lines, said = [], {}
    for part, colour in zip(parts, COLOURS if len(parts) > 1 else (INK,)):
        x, y = setting.at(part.rows), metric.at(part.rows)
        quantiles = band(x, y)
        if quantiles is not None:
            lines += _band(quantiles, part.label, colour)
            said["Line: median; band: 5 to 95 %"] = None
            if quantiles.clustered.any():
                said["No median if points form two clusters"] = None
        elif part.is_whole and len(part.rows) == len(x.distinct):
            order = np.argsort(x.values)
            lines.append(_line(x.values[order], y.values[order], part.label, colour))
    return lines, [*said]


def _line(x: np.ndarray, y: np.ndarray, label: str, colour: str) -> dict[str, Any]:
    return {
        "type": "scatter", "mode": "lines", "x": listed(x), "y": listed(y), "hoverinfo": "skip",
        "name": shown(label), "showlegend": bool(label),
        "line": {"color": colour, "width": 1.5},
    }  # fmt: skip


def _band(found: Band, label: str, colour: str) -> list[dict[str, Any]]:
    x, edge = listed(found.at), {"type": "scatter", "mode": "lines", "line": {"width": 0}}
    hidden = {**edge, "x": x, "hoverinfo": "skip", "showlegend": False}
    return [
        {**hidden, "y": listed(found.quantiles[0])},
        {**hidden, "y": listed(found.quantiles[4]), "fill": "tonexty", "fillcolor": f"{colour}22"},
        {
            "type": "scatter", "mode": "lines+markers", "name": shown(label or "median"), "x": x,
            "y": listed(np.where(found.clustered, np.nan, found.quantiles[2])),
            "line": {"color": colour, "width": 2},
            "marker": {"color": colour, "size": 5}, "showlegend": bool(label),
            "customdata": [int(count) for count in found.counts],
            "hovertemplate": "%{x}<br>median %{y}<br>%{customdata} points<extra></extra>",
        },
    ]  # fmt: skip


def _dots(
    found: Findings,
    setting: Column,
    metric: Column,
    rows: np.ndarray,
    parts: list[Combination] | None = None,
) -> list[dict[str, Any]]:
    """Return the cases: a colour per outcome, or a colour per part and a symbol per outcome."""
    traces = []
    for place, (name, of_it) in enumerate(_by_outcome(found, rows)):
        symbol = SYMBOLS[min(place, len(SYMBOLS) - 1)]
        if parts is None:
            colour = COLOURS[place] if place < len(COLOURS) else GREY
            traces.append(_points(found, setting, metric, of_it, (name, colour, "circle")))
            continue
        for part, colour in zip(parts, COLOURS):
            drawn_of_it = np.intersect1d(of_it, part.rows)
            trace = _points(found, setting, metric, drawn_of_it, (name, colour, symbol))
            traces.append({**trace, "showlegend": False})
        marker = {"color": GREY, "symbol": symbol, "size": 7}
        legend = {"type": "scatter", "mode": "markers", "x": [None], "y": [None], "marker": marker}
        traces.append({**legend, "name": shown(name[:40])})
    return traces


def _by_outcome(found: Findings, rows: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Return names of outcomes and their cases: settled, then the most frequent outcomes."""
    outcome = found.columns.get(OUTCOME)
    codes = np.zeros(len(rows), int)
    names: Sequence[str] = ("points",)
    if outcome is not None and outcome.codes is not None:
        codes, names = outcome.codes[rows], outcome.words
    counts = np.bincount(codes)
    order = [(names[kind] != "settled", -counts[kind], kind) for kind in np.flatnonzero(counts)]
    return [(names[kind], rows[codes == kind]) for *_, kind in sorted(order)]


def _points(
    found: Findings, setting: Column, metric: Column, rows: np.ndarray, look: tuple[str, str, str]
) -> dict[str, Any]:
    name, colour, symbol = look
    dense = len(rows) > 300
    return {
        "type": "scatter", "mode": "markers", "name": shown(name[:40]),
        "x": _at(setting, rows), "y": _at(metric, rows),
        "customdata": [int(point) for point in found.points[rows]],
        "hovertemplate": "%{x}<br>%{y}<br>point %{customdata}<extra></extra>",
        "marker": {
            "color": colour, "symbol": symbol, "size": 4 if dense else 7,
            "opacity": 0.4 if dense else 0.8,
        },
    }  # fmt: skip


def _at(column: Column, rows: np.ndarray) -> list[Any]:
    if column.numbers is not None:
        return listed(column.numbers[rows])
    return [shown(column.words[code]) for code in column.places[rows]]


def over_words(found: Findings, metric: Column, setting: Column) -> Figure | None:
    """Plot a metric by the values of a text setting, as boxes or single cases.

    Cases that form two clusters have no box, because its median would lie between the clusters.
    Return None without cases.
    """
    by_word = band(setting, metric)
    if by_word is None:
        return None
    limit = found.limit_of(metric)
    layout = {"xaxis": axis(setting), "yaxis": axis(metric), "shapes": limit_lines(limit, "y")}
    count, title = int(metric.finite.sum()), f"{metric.name} by {setting.name}"
    if by_word.counts.max() <= STRIP or by_word.clustered.any():
        rows = drawn(np.flatnonzero(metric.finite))
        dots = _dots(found, setting, metric, rows)
        says = reported(count, len(rows), limit=limit)
        return Figure(title=title, says=says, traces=dots, layout=layout)
    low, first, middle, third, high = (listed(row) for row in by_word.quantiles)
    trace = {
        "type": "box", "x": [shown(setting.words[code]) for code in by_word.at],
        "q1": first, "median": middle, "q3": third, "lowerfence": low, "upperfence": high,
        "fillcolor": "#0072b233", "line": {"color": BLUE}, "name": "",
    }  # fmt: skip
    says = reported(count, count, "Box: 25, 50 and 75 %; whiskers: 5 and 95 %", limit=limit)
    return Figure(title=title, says=says, traces=[trace], layout=layout)


def over_two(found: Findings, metric: Column, across: Column, up: Column) -> Figure | None:
    """Plot the median of a metric over two numeric settings as a map.

    A cell whose cases form two clusters is a gap. Return None for a map with too many gaps, or if a
    text setting varies, because medians would mix its values.
    """
    import pandas

    if any(one.numbers is None for one in found.varied):
        return None
    known = metric.finite & across.finite & up.finite
    count = int(known.sum())
    (x, column), (y, line) = (_cells(setting, known, count) for setting in (across, up))
    shape = (len(y) - 1, len(x) - 1)
    cells = pandas.Series(metric.as_numbers[known]).groupby([line, column])
    medians = cells.median().loc[~cells.apply(lambda part: is_clustered(metric.scaled(part)))]
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
    """Return map cell edges along a setting, and the cell of every known record."""
    values, distinct = map(setting.scaled, (setting.as_numbers[known], setting.distinct))
    if len(distinct) <= CELLS:
        inner = (distinct[1:] + distinct[:-1]) / 2
        first, last = 2 * distinct[0] - inner[0], 2 * distinct[-1] - inner[-1]
        edges = np.array([first, *inner, last])
    else:
        number = int(np.clip(np.sqrt(count / 8), 4, 25))
        edges = np.linspace(values.min(), values.max(), number + 1)
    cells = np.searchsorted(edges[1:-1], values, side="right")
    return np.exp(edges) if setting.is_wide else edges, cells


def yield_over(found: Findings, setting: Column) -> Figure | None:
    """Plot the yield with its interval over a numeric setting; None for too few cases."""
    group = setting.groups
    if group is None:
        return None
    rows = [np.flatnonzero(group == number) for number in range(group.max() + 1)]
    shares = [found.yield_among(of_it) for of_it in rows]
    at = [np.median(setting.as_numbers[of_it]) for of_it in rows]
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


BARS = 40


def distribution(found: Findings, metric: Column) -> Figure:
    """Plot the histogram and empirical distribution of a metric, with its limit."""
    values, limit = np.sort(metric.values), found.limit_of(metric)
    scaled = np.log10(values) if metric.is_wide else values
    bars = int(np.clip(np.sqrt(len(values)), 5, BARS))
    counts, edges = np.histogram(scaled, bars)
    edges = 10**edges if metric.is_wide else edges
    ranks = np.unique(np.linspace(0, len(values) - 1, 400).astype(int))
    traces = [
        _bars(edges, counts / len(values)),
        {
            "type": "scatter", "mode": "lines", "name": "cumulative fraction",
            "x": listed(values[ranks]), "y": listed((ranks + 1) / len(values)), "yaxis": "y2",
            "line": {"color": "#111", "width": 2, "shape": "hv"},
            "hovertemplate": "%{y:.2%} up to %{x}<extra></extra>",
        },
    ]  # fmt: skip
    middle = np.quantile(values, (0.05, 0.5, 0.95))
    ends = "5 % {:.4g}, median {:.4g}, 95 % {:.4g}".format(*middle)
    layout = {
        "xaxis": axis(metric),
        "yaxis": plain_axis("fraction of points", rangemode="tozero", tickformat=".1~%"),
        "yaxis2": plain_axis(
            "cumulative fraction", overlaying="y", side="right", range=[0, 1.02], showgrid=False,
            tickmode="linear", dtick=0.2, tickformat=".0%",
        ),
        "shapes": limit_lines(limit, "x"),
    }  # fmt: skip
    says = reported(len(values), len(values), ends, limit=limit)
    return Figure(title=f"Distribution of {metric.name}", says=says, traces=traces, layout=layout)


def _bars(edges: np.ndarray, shares: np.ndarray) -> dict[str, Any]:
    """Return histogram bars as an outline, which is also correct on logarithmic axes."""
    x = np.repeat(edges, 2)
    y = np.concatenate([[0], np.repeat(shares, 2), [0]])
    return {
        "type": "scatter", "mode": "lines", "name": "fraction of points", "x": listed(x, 7),
        "y": listed(y), "fill": "tozeroy", "fillcolor": "#0072b255",
        "line": {"color": BLUE, "width": 1}, "hovertemplate": "%{y:.2%} near %{x}<extra></extra>",
    }  # fmt: skip


def beside(found: Findings, pair: Prediction) -> Figure:
    """Plot predictions over measurements, with the line of equality."""
    measured, predicted = pair
    x, y = measured.as_numbers, predicted.as_numbers
    known = np.flatnonzero(measured.finite & predicted.finite)
    some = drawn(known)
    both = np.concatenate([x[known], y[known]])
    ends, off = [both.min(), both.max()], pair.errors
    traces = [
        {
            "type": "scatter", "mode": "markers", "name": "points", "showlegend": False,
            "x": listed(x[some]), "y": listed(y[some]),
            "customdata": [int(point) for point in found.points[some]],
            "hovertemplate": "%{x}, predicted %{y}<br>point %{customdata}<extra></extra>",
            "marker": {"color": BLUE, "size": 4, "opacity": 0.45},
        },
        {
            "type": "scatter", "mode": "lines", "name": "equal", "x": listed(ends),
            "y": listed(ends), "line": {"color": RED, "width": 1.5}, "hoverinfo": "skip",
        },
    ]  # fmt: skip
    kind = {"type": "log" if measured.is_wide and predicted.is_wide else "linear"}
    median, high = np.quantile(off, (0.5, 0.95)) if len(off) else (np.nan, np.nan)
    return Figure(
        title=f"{predicted.name} against {measured.name}",
        says=reported(
            len(known), len(some),
            f"Errors of the prediction: median {percent(median)}, 95 % below {percent(high)}",
        ),
        traces=traces,
        layout={"xaxis": axis(measured) | kind, "yaxis": axis(predicted) | kind},
    )  # fmt: skip
