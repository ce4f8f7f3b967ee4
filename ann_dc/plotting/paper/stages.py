"""Figure 5: piecewise constant controls over the stages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ann_dc.plotting.paper.plane import Panel
from ann_dc.plotting.style import INK, drawable, headline, legend_below, new_figure, quiet
from ann_dc.validation import NotEmpty, checked


@checked
def controls_over_stages(
    panels: Annotated[Sequence[Panel], NotEmpty()],
    *,
    labels: Annotated[Sequence[str], NotEmpty()],
    title: str = "",
    columns: int | None = None,
) -> Figure:
    """Plot every control over the stages, one column per panel (paper, Figure 5).

    The rows of the panels are the controls and `labels` are their names with units. By default all
    panels are in one row. A column whose range far exceeds that of the first shows three times that
    range and is cut off outside.
    """
    columns, m = columns or len(panels), len(labels)
    rows = m * -(-len(panels) // columns)
    figure = new_figure(0.6 + 4.4 * columns, 1.4 + 2.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex="col")
    for number, panel in enumerate(panels):
        block, place = divmod(number, columns)
        column = grid[m * block : m * (block + 1), place]
        for row, (axes, label) in enumerate(zip(column, labels)):
            for drawn in panel.drawn:
                _held(axes, drawable(drawn.rows[row]), drawn.style())
            axes.set_ylabel(label)
            quiet(axes)
        column[0].set_title(panel.heading, fontsize=9, loc="left", color=INK)
    for axes in grid[-1]:
        axes.set_xlabel("stage k")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes, others in zip(grid[:, 0], grid[:, 1:]):
        low, high = axes.get_ylim()
        for other in others:
            own, most = other.get_ylim(), 2 * (high - low)
            if own[0] < low - most or own[1] > high + most:
                other.set_ylim(2 * low - high, 2 * high - low)
    headline(figure, title)
    legend_below(figure, most=3)
    return figure


def _held(axes: Axes, values: np.ndarray, style: dict) -> None:
    """Plot values (N,) over the stages, piecewise constant."""
    stages = np.arange(len(values) + 1)
    line = {key: style[key] for key in ("color", "lw", "ls", "label", "zorder") if key in style}
    axes.plot(stages, np.append(values, values[-1]), drawstyle="steps-post", **line)
