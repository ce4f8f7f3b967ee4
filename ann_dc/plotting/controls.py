"""Figure of the controls over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ann_dc.plotting.style import (
    GREY,
    VERMILION,
    drawable,
    headline,
    legend_below,
    limit_lines,
    new_figure,
    quiet,
    time_label,
    title,
    with_unit,
)
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked


@checked
def controls(solution: Solution) -> Figure:
    """Plot every control over time, piecewise constant, between its bounds.

    A bound is omitted if its distance exceeds the range of the control's values.

    Parameters
    ----------
    solution : Solution
        Solution to plot.

    Returns
    -------
    matplotlib.figure.Figure
    """
    names = [str(u) for u in solution.problem.controls]
    figure = new_figure(6.4, 1.2 + 1.6 * max(len(names), 1.6))
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    edges = drawable(solution.time)
    for axes, name, bounds in zip(panels, names, solution.problem.control_limits):
        axes.stairs(drawable(solution[name]), edges, baseline=None, color=VERMILION, lw=1.8)
        axes.axhline(0.0, color=GREY, lw=0.6)
        axes.set_ylabel(with_unit(name, solution.problem.unit(name)))
        axes.set_xlim(edges[0], edges[-1])
        axes.margins(y=0.12)
        limit_lines(axes, bounds)
        quiet(axes)
    panels[-1].set_xlabel(time_label(solution.problem))
    headline(figure, title(solution))
    legend_below(figure)
    return figure
