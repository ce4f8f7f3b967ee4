"""Common style of all figures: colours, axes, legends, titles, and reproducible PNG files."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from ann_dc.files import make_folder, write_whole
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, INK, GREY = "#56B4E9", "#CC79A7", "#222222", "#8A8A8A"
"""Palette of Okabe and Ito, distinct for every kind of colour vision."""

LARGEST = 1e100
"""Magnitude above which values are omitted from a figure."""

FASTEST = "network time (tau_min)"
"""Label of network time in units of the fastest mode; it is not in seconds for any problem."""

UNSCALED = "network time (unit time constants)"
"""Label of network time in time constants of a neuron with tau = 1."""

DATED = {"png": "Software", "svg": "Date", "pdf": "CreationDate"}
"""Formats of figures, and the entry that would change from file to file."""

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_LEGEND = {"frameon": False, "fontsize": 8, "borderaxespad": 0.0}


@checked
def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure with size in inches and automatic space for labels."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


@checked
def quiet(axes: Axes) -> None:
    """Apply the common style: two spines, a light grid behind the data, small ticks."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.grid(color="#E6E6E6", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, color=GREY)
    axes.xaxis.label.set_fontsize(9)
    axes.yaxis.label.set_fontsize(9)


@checked
def with_unit(name: str, unit: str) -> str:
    """Return ``name (unit)``, or the name alone without a declared unit.

    >>> with_unit("x", "m"), with_unit("a", "m/s^2"), with_unit("x", "")
    ('x (m)', 'a (m/s²)', 'x')
    """
    raised = re.sub(r"\^(-?\d+)", lambda power: power[1].translate(_RAISED), unit)
    return f"{name} ({raised.replace('*', '·')})" if unit else name


@checked
def time_label(problem: OptimalControlProblem) -> str:
    """Return the axis label of the plant's time, with its unit."""
    return with_unit("time k dt", problem.time_unit)


@checked
def caption(
    problem: OptimalControlProblem, form: str = "corrected", step: float | None = None
) -> str:
    """Return the caption: name, form unless corrected, N, and dt or the chosen step.

    Parameters
    ----------
    form : str
        Form of the equations. Default "corrected".
    step : float or None
        Step length chosen by the network. Default None, for a fixed dt.

    Examples
    --------
    >>> from ann_dc import plants
    >>> caption(plants.car())
    'car: N = 9, dt = 0.1 s'
    """
    name = problem.name if form == "corrected" else f"{problem.name}, {form}"
    chosen = problem.handed_on and step is not None
    interval = f"{problem.timed(f'{step:.4g}')}, chosen" if chosen else problem.interval
    return f"{name}: N = {problem.horizon}, dt = {interval}"


@checked
def title(solution: Solution) -> str:
    """Return the caption of a solution, with the outcome of its run on the next line."""
    words = solution.status.outcome.name.lower().replace("_", " ")
    if solution.status.settled or solution.certified:
        kind = "certified optimum" if solution.certified else "NOT certified"
        words += f", {kind}, objective {solution.objective:.7g}"
        words += f" {solution.problem.cost_unit}" if solution.problem.cost_unit else ""
    elif solution.status.neuron is not None:
        words += f" at {solution.status.neuron}"
    head = caption(solution.problem, str(solution.equations.form), solution.step_length)
    return f"{head}\n{words}"


@checked
def headline(figure: Figure, words: str) -> None:
    """Set a left-aligned title above all panels."""
    figure.suptitle(words, x=0.02, ha="left", fontsize=10)


@checked
def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as a PNG, SVG or PDF file; equal figures give equal bytes.

    The suffix of the path determines the format; others than ``.svg`` and ``.pdf`` give a PNG file.
    Missing folders are created. Returns the path. Raises `OutputError` if the folder cannot be
    created or the file cannot be written.
    """
    path = Path(path)
    make_folder(path.parent)
    form = suffix if (suffix := path.suffix[1:].lower()) in DATED else "png"
    stream = io.BytesIO()
    with rc_context({"svg.hashsalt": "ann_dc"}):
        figure.savefig(stream, format=form, dpi=150, metadata={DATED[form]: None})
    write_whole(path, stream.getvalue())
    return path


def mark_ends(axes: Axes, start: ArrayLike, target: ArrayLike) -> None:
    """Mark the start, and a finite target, of a path in the plane."""
    axes.plot(
        *np.asarray(start),
        "s",
        color=GREEN,
        ms=9,
        mfc="none",
        mew=1.8,
        label="initial state q_0",
        zorder=5,
    )
    if np.isfinite(target).all():
        axes.plot(
            *np.asarray(target), "*", color=VERMILION, ms=13, label="terminal state q_d", zorder=5
        )


def limit_lines(axes: Axes, bounds: Iterable[Any]) -> None:
    """Draw thin dashed lines at bounds.

    A bound is omitted if its distance exceeds the range of the drawn values.
    """
    low, high = axes.get_ylim()
    for bound in bounds:
        if 2 * low - high <= bound <= 2 * high - low:
            axes.axhline(bound, color=INK, lw=0.8, ls=(0, (6, 4)), zorder=1, label="bound")


def legend_beside(axes: Axes) -> None:
    """Add a legend outside the data."""
    axes.legend(**_LEGEND, loc="upper left", bbox_to_anchor=(1.02, 1.0))


def legend_below(figure: Figure, most: int = 12) -> None:
    """Add one legend for all panels, with at most `most` labels per line.

    Each label occurs once. Without labels no legend is added.
    """
    found: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            found.setdefault(label, handle)
    if not found:
        return
    figure.legend(
        found.values(), found.keys(), frameon=False, fontsize=8,
        loc="outside lower center", ncols=min(len(found), most),
    )  # fmt: skip


def drawable(values: np.ndarray) -> np.ndarray:
    """Return values with non-finite and excessively large ones replaced by gaps."""
    values = np.asarray(values, float)
    return np.where(np.abs(values) < LARGEST, values, np.nan)
