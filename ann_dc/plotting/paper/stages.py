"""Figure 5: the controls, held from stage to stage."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ann_dc.hints.checked import checked
from ann_dc.hints.values import NotEmpty
from ann_dc.plotting.paper.plane import Panel
from ann_dc.plotting.style import INK, drawable, headline, legend_below, new_figure, quiet


@checked
def controls_over_stages(
    panels: Annotated[Sequence[Panel], NotEmpty()],
    *,
    labels: Annotated[Sequence[str], NotEmpty()],
    title: str = "",
) -> Figure:
    """Every control over the stages, a column a panel.

    Parameters
    ----------
    panels : sequence of Panel
        With the controls as rows.
    labels : sequence of str
        Of the controls, with their units.
    title : str

    Returns
    -------
    matplotlib.figure.Figure
        The other columns show three times the range of the first; what leaves it is cut off.

    References
    ----------
    Paper, Figure 5.
    """
    figure = new_figure(0.6 + 4.4 * len(panels), 1.4 + 2.2 * len(labels))
    grid = figure.subplots(len(labels), len(panels), squeeze=False, sharex="col")
    for column, panel in zip(grid.T, panels):
        for row, (axes, label) in enumerate(zip(column, labels)):
            for drawn in panel.drawn:
                _held(axes, drawable(drawn.rows[row]), drawn.style())
            axes.set_ylabel(label)
            quiet(axes)
        column[0].set_title(panel.heading, fontsize=9, loc="left", color=INK)
        column[-1].set_xlabel("stage k (1)")
        column[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes, others in zip(grid[:, 0], grid[:, 1:]):
        low, high = axes.get_ylim()
        for other in others:
            other.set_ylim(2 * low - high, 2 * high - low)
    headline(figure, title)
    legend_below(figure, most=3)
    return figure


def _held(axes: Axes, values: np.ndarray, style: dict) -> None:
    """Values (N,) from stage to stage, each until the next one."""
    stages = np.arange(len(values) + 1)
    line = {key: style[key] for key in ("color", "lw", "ls", "label", "zorder") if key in style}
    axes.plot(stages, np.append(values, values[-1]), drawstyle="steps-post", **line)
