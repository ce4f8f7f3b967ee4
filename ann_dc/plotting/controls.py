"""What drives the solution: every control over time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ann_dc.plotting.style import GREY, VERMILION, drawable, headline, new_figure, quiet, with_unit
from ann_dc.solution import Solution


def controls(solution: Solution, units: Mapping[str, str] | None = None) -> Figure:
    """Every control over time, held constant for a sampling interval.

    Parameters
    ----------
    solution : Solution
    units : mapping of control name to str, optional
    """
    names = [str(u) for u in solution.problem.controls]
    figure = new_figure(6.4, 1.2 + 1.6 * max(len(names), 1.6))
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    edges = solution.problem.dt * np.arange(solution.problem.horizon + 1)
    for axes, name in zip(panels, names):
        axes.stairs(drawable(solution[name]), edges, baseline=None, color=VERMILION, lw=1.8)
        axes.axhline(0.0, color=GREY, lw=0.6)
        axes.set_ylabel(with_unit(name, units))
        axes.set_xlim(edges[0], edges[-1])
        axes.margins(y=0.12)
        quiet(axes)
    panels[-1].set_xlabel("time k dt (s)")
    headline(figure, solution)
    return figure
