"""Figures of metric distributions, predictions and trajectories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import Column
from ann_dc.report.study_page.figure import (
    BLUE,
    GREY,
    RED,
    Figure,
    axis,
    drawn,
    limit_lines,
    listed,
    percent,
    plain_axis,
    shown,
    told,
)
from ann_dc.report.study_results import Prediction

BARS = 40
SAMPLES = 300
"""Number of drawn samples of a trajectory."""
TIME, RESIDUALS = "time", "residuals"


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
            "type": "scatter", "mode": "lines", "name": "share up to here",
            "x": listed(values[ranks]), "y": listed((ranks + 1) / len(values)), "yaxis": "y2",
            "line": {"color": "#111", "width": 2, "shape": "hv"},
            "hovertemplate": "%{y:.2%} up to %{x}<extra></extra>",
        },
    ]  # fmt: skip
    middle = np.quantile(values, (0.05, 0.5, 0.95))
    ends = "5 % {:.4g}, median {:.4g}, 95 % {:.4g}".format(*middle)
    layout = {
        "xaxis": axis(metric),
        "yaxis": plain_axis("share of points", rangemode="tozero", tickformat=".1~%"),
        "yaxis2": plain_axis(
            "share up to here", overlaying="y", side="right", range=[0, 1.02], showgrid=False,
            tickmode="linear", dtick=0.2, tickformat=".0%",
        ),
        "shapes": limit_lines(limit, "x"),
    }  # fmt: skip
    says = told(len(values), len(values), ends, limit=limit)
    return Figure(title=f"How {metric.name} spreads", says=says, traces=traces, layout=layout)


def _bars(edges: np.ndarray, shares: np.ndarray) -> dict[str, Any]:
    """Return histogram bars as an outline, which is also correct on logarithmic axes."""
    x = np.repeat(edges, 2)
    y = np.concatenate([[0], np.repeat(shares, 2), [0]])
    return {
        "type": "scatter", "mode": "lines", "name": "share of points", "x": listed(x, 7),
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
        title=f"{predicted.name} beside {measured.name}",
        says=told(
            len(known), len(some),
            f"Errors of the prediction: median {percent(median)}, 95 % below {percent(high)}",
        ),
        traces=traces,
        layout={"xaxis": axis(measured) | kind, "yaxis": axis(predicted) | kind},
    )  # fmt: skip


class Curve(NamedTuple):
    """Trajectory of one case; times and values have shape (m,)."""

    point: int
    times: np.ndarray
    values: np.ndarray


def over_time(kept: Mapping[int, Mapping[str, np.ndarray]]) -> list[Figure]:
    """Plot trajectories of cases, one figure per quantity: residual and scalars.

    The arrays have shape (m,) or (m, k). Times are named ``time``, or ``x_time`` if they belong to
    ``x`` alone. Of residuals with columns the largest is drawn.
    """
    curves: dict[str, list[Curve]] = {}
    for point, arrays in kept.items():
        for name, values in arrays.items():
            times = arrays.get(_times_of(name, arrays))
            line = np.max(values, axis=1) if name == RESIDUALS and values.ndim == 2 else values
            if times is not None and not name.endswith(TIME) and _fits(line, times):
                curves.setdefault(name, []).append(Curve(point, times, line))
    return [_over_time(name, curves[name]) for name in sorted(curves, key=RESIDUALS.__ne__)]


def _times_of(name: str, arrays: Mapping[str, np.ndarray]) -> str:
    own = [other for other in arrays if other.endswith(f"_{TIME}")]
    return next((other for other in own if name.startswith(other.removesuffix(f"_{TIME}"))), TIME)


def _fits(values: np.ndarray, times: np.ndarray) -> bool:
    is_number = values.dtype.kind in "fiu" and values.ndim == 1
    return is_number and values.shape == times.shape and len(values) > 1


def _over_time(name: str, curves: Sequence[Curve]) -> Figure:
    traces = []
    for number, (point, times, values) in enumerate(curves):
        some = np.unique(np.linspace(0, len(values) - 1, SAMPLES).astype(int))
        traces.append({
            "type": "scatter", "mode": "lines", "name": f"point {point}", "opacity": 0.7,
            "x": listed(times[some]), "y": listed(values[some]), "showlegend": False,
            "line": {"width": 1.3, "color": (BLUE, GREY, RED)[number % 3]},
            "hovertemplate": f"point {point}<br>%{{x}}<br>%{{y}}<extra></extra>",
        })  # fmt: skip
    whole = np.concatenate([curve.values for curve in curves])
    is_positive = bool((whole[np.isfinite(whole)] > 0).all())
    height = {"type": "log", "exponentformat": "power"} if is_positive else {}
    return Figure(
        title=f"{name} over time",
        says=f"Curves of {len(traces)} of the points that keep any.",
        traces=traces,
        layout={"xaxis": plain_axis("network time"), "yaxis": plain_axis(shown(name), **height)},
    )
