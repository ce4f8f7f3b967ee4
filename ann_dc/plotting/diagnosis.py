"""Figure of a design diagnosis: spectrum, slowest modes and weakest constraints."""

from __future__ import annotations

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ann_dc.analysis.slowness import LIMIT, Mode, Slowness
from ann_dc.diagnosis import Diagnosis
from ann_dc.plotting.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    caption,
    headline,
    legend_beside,
    new_figure,
    quiet,
)
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import checked

LINES = (BLUE, VERMILION, PURPLE, SKY, ORANGE, GREEN)
"""Colours of the leading neurons of a mode."""

LEADING = 5
"""Number of neurons of a mode drawn in colour; the others are grey."""

PLAIN = FuncFormatter(lambda value, _: f"{value:g}")

BELOW = "#CFE8DF"
"""Colour of the range that a penalty covers: multiplier sensitivity between -w/2 and w."""


@checked
def diagnosis(found: Diagnosis, problem: OptimalControlProblem | None = None) -> Figure:
    """Plot the diagnosis computed by `ann_dc.diagnose`.

    Left, the eigenvalues in units of the spectral radius, with the settling rate and the limit of
    half the radius. Below, the multiplier sensitivity (inverse Schur complement) of every
    constraint and the range between -w/2 and w that its penalty covers. Right, the slowest modes
    over the horizon by neuron.

    Parameters
    ----------
    found : Diagnosis
        Diagnosis to plot.
    problem : OptimalControlProblem, optional
        Problem of the design, for the title; a network does not contain dt.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(11.0, 6.4)
    modes = found.slowness.modes
    halves = figure.add_gridspec(1, 2, width_ratios=(5, 6))
    left, right = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    spectrum, rows = left.subplots(2, 1)
    _eigenvalues(spectrum, found.slowness)
    _rows(rows, found)
    panels = right.subplots(len(modes), 1, sharex=True, squeeze=False)[:, 0]
    for number, (axes, mode) in enumerate(zip(panels, modes), 1):
        _mode(axes, mode, number)
    panels[-1].set_xlabel("stage k (1)")
    headline(
        figure,
        f"{found.title if problem is None else caption(problem)}; ratio {found.slowness.ratio:.3g},"
        f" {found.slowness.distance:.3g} times the limit ({found.kind.value})\n{found.reason}",
    )
    return figure


def _eigenvalues(axes: Axes, found: Slowness) -> None:
    values = found.spectrum.eigenvalues / found.spectrum.radius
    decaying = values[values.real < 0]
    axes.plot(
        -decaying.real, decaying.imag, "o", color=BLUE, ms=4, alpha=0.6, mec="white", mew=0.3,
        label="eigenvalues",
    )  # fmt: skip
    for number, mode in enumerate(found.modes, 1):
        if mode.rate > 0:
            at = mode.rate / found.spectrum.radius, mode.eigenvalue.imag / found.spectrum.radius
            axes.annotate(str(number), at, xytext=(5, 4), textcoords="offset points", fontsize=8,
                          color=INK)  # fmt: skip
    axes.axvline(1 / LIMIT, color=GREEN, lw=1.4, label=f"limit: ratio {LIMIT:g}")
    if np.isfinite(found.ratio):
        axes.axvline(
            1 / found.ratio, color=VERMILION, ls="--", lw=1.2, label=f"ratio {found.ratio:.3g}"
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter(PLAIN)
    axes.set_xlabel("rate of decay (share of the radius)")
    axes.set_ylabel("imaginary part\n(share of the radius)")
    quiet(axes)
    legend_beside(axes)


def _rows(axes: Axes, found: Diagnosis) -> None:
    rows = found.slowness.rows
    places = np.arange(len(rows))[::-1]
    penalty = np.array([row.penalty for row in rows])
    axes.barh(places, 1.5 * penalty, left=-0.5 * penalty, height=0.8, color=BELOW,
              label="covered by the penalty w:\n-w/2 .. w")  # fmt: skip
    low, high = np.array([(row.lowest, row.highest) for row in rows]).T
    axes.barh(places, high - low, left=low, height=0.36, color=BLUE, label="over the horizon")
    low, high = np.array([(row.at_stage.min(), row.at_stage.max()) for row in rows]).T
    axes.hlines(
        places, low, high, color=ORANGE, lw=3, capstyle="round", label="at a stage", zorder=3
    )
    linear = float(penalty.min())
    axes.set_xscale("symlog", linthresh=linear)
    axes.xaxis.set_major_formatter(  # ticks crowd around zero, where the scale is linear
        FuncFormatter(lambda value, _: f"{value:g}" if value == 0 or abs(value) >= linear else "")
    )
    axes.use_sticky_edges = False
    axes.margins(x=0.05)
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.set_yticks(places, [row.neuron for row in rows], fontsize=8)
    axes.set_xlabel("shadow stiffness (network units)")
    quiet(axes)
    legend_beside(axes)


def _mode(axes: Axes, mode: Mode, number: int) -> None:
    stages = np.arange(mode.shape.shape[1])
    leading = mode.leading[:LEADING]
    shapes = dict(zip(mode.names, mode.shape))
    for name in set(mode.names) - set(leading):
        axes.plot(stages, shapes[name], color=GREY, lw=0.5, alpha=0.4)
    for name, colour in zip(leading, cycle(LINES)):
        share = 100 * np.nansum(shapes[name] ** 2)
        axes.plot(stages, shapes[name], color=colour, lw=1.6, label=f"{name}, {share:.0f} %")
    pair = f" ± {mode.eigenvalue.imag:.3g}i" if mode.oscillates else ""
    axes.set_title(
        f"mode {number}: eigenvalue {mode.eigenvalue.real:.3g}{pair}, {mode.pattern}",
        fontsize=9, loc="left",
    )  # fmt: skip
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.set_ylabel("root of the energy (1)")
    quiet(axes)
    legend_beside(axes)
