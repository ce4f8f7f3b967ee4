"""The house style: colours, axes, legends, titles; what every picture and demo draws with."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ann_dc.solution import Solution

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, INK, GREY = "#56B4E9", "#CC79A7", "#222222", "#8A8A8A"
"""Okabe and Ito's palette: distinct for every kind of colour vision."""

LARGEST = 1e100
"""Values beyond it are left out of a picture."""

_LEGEND = {"frameon": False, "fontsize": 8, "borderaxespad": 0.0}


def new_figure(width: float, height: float) -> Figure:
    """An empty figure in inches that makes room for its own labels."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def quiet(axes: Axes) -> None:
    """The house style: two spines, a light grid behind the data, small ticks."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.grid(color="#E6E6E6", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, color=GREY)
    axes.xaxis.label.set_fontsize(9)
    axes.yaxis.label.set_fontsize(9)


def with_unit(name: str, units: Mapping[str, str] | None) -> str:
    """``name (unit)``, in the problem's own units where none is given."""
    return f"{name} ({(units or {}).get(name, 'problem units')})"


def title(solution: Solution) -> str:
    """Name of the problem, form of the equations, and how the run ended."""
    form = solution.equations.form
    head = f"{solution.problem.name}, {form}" if str(form) != "corrected" else solution.problem.name
    words = solution.status.outcome.name.lower().replace("_", " ")
    if solution.status.settled:
        kind = "certified optimum" if solution.certified else "NOT certified"
        words += f", {kind}, objective {solution.objective:.7g}"
    elif solution.status.neuron is not None:
        words += f" at {solution.status.neuron}"
    return f"{head}: {words}"


def headline(figure: Figure, solution: Solution) -> None:
    """The title over all panels, on the left."""
    figure.suptitle(title(solution), x=0.02, ha="left", fontsize=10)


def legend_beside(axes: Axes) -> None:
    """A legend that covers no data."""
    axes.legend(**_LEGEND, loc="upper left", bbox_to_anchor=(1.02, 1.0))


def legend_below(figure: Figure) -> None:
    """One legend for all panels, each label once."""
    found: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            found.setdefault(label, handle)
    figure.legend(
        found.values(), found.keys(), frameon=False, fontsize=8,
        loc="outside lower center", ncols=len(found),
    )  # fmt: skip


def drawable(values: np.ndarray) -> np.ndarray:
    """Values with everything that is not finite, or beyond reason, left out."""
    values = np.asarray(values, float)
    return np.where(np.abs(values) < LARGEST, values, np.nan)
