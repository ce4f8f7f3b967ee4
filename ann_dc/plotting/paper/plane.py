"""Figure 4: paths in the plane with obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ann_dc.plotting.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    VERMILION,
    drawable,
    headline,
    legend_below,
    new_figure,
    quiet,
    with_unit,
)
from ann_dc.validation import Finite, NotEmpty, OrNan, Positive, Shape, checked

OBSTACLE = "#D9D9D9"


@checked
@dataclass(frozen=True, kw_only=True)
class Disc:
    """Disc obstacle: centre `x`, `y` and `radius`, in the unit of the axes."""

    x: Finite
    y: Finite
    radius: Positive


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Path, or controls over the stages, with drawing style.

    Attributes
    ----------
    name : str
        Legend entry.
    rows : (R, K) array
        x and y at K nodes, or R controls at K stages.
    dashed : bool
        True for a thin dashed line without dots, for example a simulated path.
    """

    name: str
    rows: Annotated[np.ndarray, Shape("R", "K"), OrNan()]
    colour: str = BLUE
    dashed: bool = False

    def style(self) -> dict[str, Any]:
        """Return the options of ``Axes.plot``."""
        if self.dashed:
            return {"color": self.colour, "lw": 1.1, "ls": "--", "zorder": 4, "label": self.name}
        return {"color": self.colour, "lw": 1.6, "marker": "o", "ms": 4, "label": self.name}


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Content of one panel.

    Attributes
    ----------
    discs : sequence of Disc
        Obstacles; may be empty.
    """

    heading: str
    drawn: Sequence[Drawn]
    discs: Sequence[Disc] = ()


@checked
def plane(
    panels: Annotated[Sequence[Panel], NotEmpty()],
    *,
    start: tuple[float, float],
    target: tuple[float, float],
    unit: str = "m",
    title: str = "",
    columns: int | None = None,
) -> Figure:
    """Plot paths from a start to a target in panels (Figure 4 of the paper).

    The rows of the panels are x and y, in `unit`. By default all panels are in one row of
    `columns`.

    Examples
    --------
    >>> path = Drawn(name="T_0", rows=np.array([[0.0, 2.0, 5.0], [0.0, 3.0, 5.0]]))
    >>> panel = Panel(heading="around", drawn=[path], discs=[Disc(x=3.0, y=3.0, radius=0.5)])
    >>> len(plane([panel], start=(0.0, 0.0), target=(5.0, 5.0)).axes)
    1
    """
    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    figure = new_figure(0.6 + 4.0 * columns, 0.4 + 4.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axes, panel in zip(grid.flat, panels):
        _paths(axes, panel)
        axes.plot(*start, "s", color=GREEN, ms=9, mfc="none", mew=1.8, label="start q_0", zorder=5)
        axes.plot(*target, "*", color=VERMILION, ms=13, label="target q_d", zorder=5)
        axes.set_title(panel.heading, fontsize=9, loc="left", color=INK)
        axes.set_aspect("equal")
        quiet(axes)
    for axes in grid[-1]:
        axes.set_xlabel(with_unit("x", unit))
    for axes in grid[:, 0]:
        axes.set_ylabel(with_unit("y", unit))
    headline(figure, title)
    legend_below(figure, most=3)
    return figure


def _paths(axes: Axes, panel: Panel) -> None:
    for number, disc in enumerate(panel.discs):
        shape = Circle((disc.x, disc.y), disc.radius, fc=OBSTACLE, ec=GREY, lw=0.8, zorder=1)
        shape.set_label("obstacle" if number == 0 else "_nolegend_")
        axes.add_patch(shape)
    for path in panel.drawn:
        axes.plot(*drawable(path.rows), **path.style())
