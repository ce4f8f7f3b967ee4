"""Figures of trajectories over time, with a colour and a median for each category of cases."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ann_dc.report.statistics import Findings
from ann_dc.report.study_columns import combinations, is_clustered
from ann_dc.report.study_page.figure import COLOURS, Figure, listed, plain_axis, shown

SAMPLES, GRID = 200, 120
"""Numbers of drawn samples of a trajectory, and of times of a median."""
LEAST = 3
"""Smallest number of trajectories with a median."""
TIME, RESIDUALS = "time", "residuals"


class Curve(NamedTuple):
    """Trajectory of one case; times and values have shape (m,)."""

    point: int
    times: np.ndarray
    values: np.ndarray


class Category(NamedTuple):
    """Trajectories of the cases with the same settings, and their median.

    The median (g,) at ``times`` (g,) is nan where the trajectories form two clusters, and empty for
    fewer than `LEAST` trajectories. It ends where half of the runs have ended; a run that has ended
    before counts with its last value.
    """

    label: str
    curves: list[Curve]
    times: np.ndarray
    median: np.ndarray


def over_time(found: Findings) -> list[Figure]:
    """Plot stored trajectories, one figure per quantity: residual and scalars."""
    names = dict.fromkeys(name for kept in found.curves.values() for name in kept)
    drawn = ((name, categories_of(found, name)) for name in sorted(names, key=RESIDUALS.__ne__))
    return [_figure(name, categories) for name, categories in drawn if categories]


def categories_of(found: Findings, name: str) -> list[Category]:
    """Return the stored trajectories of a quantity by varied settings; empty if it has none.

    The arrays have shape (m,) or (m, k). Times are named ``time``, or ``x_time`` if they belong to
    ``x`` alone. Of residuals with columns the largest is taken. With too many combinations of
    settings all trajectories are one category.
    """
    curves = {}
    for point, arrays in found.curves.items():
        times, values = arrays.get(_times_of(name, arrays)), arrays.get(name)
        if times is None or values is None or name.endswith(TIME):
            continue
        line = np.max(values, axis=1) if name == RESIDUALS and values.ndim == 2 else values
        if _fits(line, times):
            curves[point] = Curve(point, times, line)
    rows = np.flatnonzero(np.isin(found.points, list(curves)))
    if not len(rows):
        return []
    parts = combinations(found.varied, rows, len(COLOURS))
    named = [("", rows)] if parts is None else [(part.label, part.rows) for part in parts]
    return [_category(label, [curves[int(found.points[i])] for i in of]) for label, of in named]


def _times_of(name: str, arrays: Any) -> str:
    own = [other for other in arrays if other.endswith(f"_{TIME}")]
    return next((other for other in own if name.startswith(other.removesuffix(f"_{TIME}"))), TIME)


def _fits(values: np.ndarray, times: np.ndarray) -> bool:
    is_number = values.dtype.kind in "fiu" and values.ndim == 1
    return is_number and values.shape == times.shape and len(values) > 1


def _category(label: str, curves: list[Curve]) -> Category:
    times = np.linspace(0.0, np.median([curve.times[-1] for curve in curves]), GRID)
    if len(curves) < LEAST:
        return Category(label, curves, times[:0], times[:0])
    is_positive = all((curve.values > 0).all() for curve in curves)
    scale, back = (np.log10, lambda x: 10.0**x) if is_positive else (np.asarray, np.asarray)
    table = np.array([np.interp(times, curve.times, scale(curve.values)) for curve in curves])
    median = np.median(table, axis=0)
    median[[is_clustered(column) for column in table.T]] = np.nan
    return Category(label, curves, times, back(median))


def _figure(name: str, categories: list[Category]) -> Figure:
    traces, has_medians = [], any(len(part.median) for part in categories)
    for colour, part in zip(COLOURS, categories):
        traces += [_trace(curve, colour, 0.25 if has_medians else 0.7) for curve in part.curves]
    for colour, part in zip(COLOURS, categories):
        traces.append({
            "type": "scatter", "mode": "lines", "name": shown(part.label or "median"),
            "x": listed(part.times), "y": listed(part.median), "showlegend": bool(part.label),
            "line": {"width": 2.5, "color": colour}, "connectgaps": False,
            "hovertemplate": "%{x}<br>median %{y}<extra></extra>",
        })  # fmt: skip
    curves = [curve for part in categories for curve in part.curves]
    is_positive = all((curve.values[np.isfinite(curve.values)] > 0).all() for curve in curves)
    height = {"type": "log", "exponentformat": "power"} if is_positive else {}
    clustered = any(np.isnan(part.median).any() for part in categories)
    return Figure(
        title=f"{name} over time",
        says=f"Curves of {len(curves)} of the points with stored trajectories."
        + " Thick: median by category." * has_medians
        + " No median if curves form two clusters." * clustered,
        traces=traces,
        layout={"xaxis": plain_axis("network time"), "yaxis": plain_axis(shown(name), **height)},
    )


def _trace(curve: Curve, colour: str, opacity: float) -> dict[str, Any]:
    some = np.unique(np.linspace(0, len(curve.values) - 1, SAMPLES).astype(int))
    return {
        "type": "scatter", "mode": "lines", "name": f"point {curve.point}", "opacity": opacity,
        "x": listed(curve.times[some]), "y": listed(curve.values[some]), "showlegend": False,
        "line": {"width": 1.2, "color": colour},
        "hovertemplate": f"point {curve.point}<br>%{{x}}<br>%{{y}}<extra></extra>",
    }  # fmt: skip
