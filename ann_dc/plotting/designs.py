"""Figures of a diagnosis, of a design over an operating range, and of a Pareto front."""

from __future__ import annotations

from itertools import combinations, cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ann_dc.analysis.slowness import LIMIT, Mode, Slowness
from ann_dc.diagnosis import Diagnosis
from ann_dc.families.family_design import FamilyDesign, Validation
from ann_dc.families.front import Front
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
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
    over the horizon by neuron. The title names the problem, if it is given, and its dt.
    """
    figure = style.new_figure(11.0, 6.4)
    modes = found.slowness.modes
    halves = figure.add_gridspec(1, 2, width_ratios=(5, 6))
    left, right = figure.add_subfigure(halves[0]), figure.add_subfigure(halves[1])
    spectrum, rows = left.subplots(2, 1)
    _eigenvalues(spectrum, found.slowness)
    _rows(rows, found)
    panels = right.subplots(len(modes), 1, sharex=True, squeeze=False)[:, 0]
    for number, (axes, mode) in enumerate(zip(panels, modes), 1):
        _mode(axes, mode, number)
    panels[-1].set_xlabel("stage k (index)")
    name = found.title if problem is None else style.caption(problem)
    style.headline(
        figure,
        f"{name}; ratio {found.slowness.ratio:.3g}, {found.slowness.distance:.3g} times the limit "
        f"({found.kind.value})\n{found.reason}",
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
    axes.axvline(1 / LIMIT, color=GREEN, lw=1.4, label=f"limit: stiffness ratio {LIMIT:g}")
    if np.isfinite(found.ratio):
        axes.axvline(
            1 / found.ratio, color=VERMILION, ls="--", lw=1.2, label=f"ratio {found.ratio:.3g}"
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.xaxis.set_major_formatter(PLAIN)
    axes.set_xlabel("decay rate (relative to the spectral radius)")
    axes.set_ylabel("imaginary part\n(relative to the spectral radius)")
    style.quiet(axes)
    style.legend_beside(axes)


def _rows(axes: Axes, found: Diagnosis) -> None:
    rows = found.slowness.rows
    places = np.arange(len(rows))[::-1]
    penalty = np.array([row.penalty for row in rows])
    axes.barh(places, 1.5 * penalty, left=-0.5 * penalty, height=0.8, color=BELOW,
              label="covered by penalty w:\n-w/2 .. w")  # fmt: skip
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
    axes.set_xlabel("multiplier sensitivity (network units)")
    style.quiet(axes)
    style.legend_beside(axes)


def _mode(axes: Axes, mode: Mode, number: int) -> None:
    stages = np.arange(mode.shape.shape[1])
    leading = mode.leading[:LEADING]
    shapes = dict(zip(mode.names, mode.shape))
    for name in (name for name in mode.names if name not in leading):
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
    axes.set_ylabel("mode shape (root of energy)")
    style.quiet(axes)
    style.legend_beside(axes)


PAIRS = 3
"""Number of pairs of inputs or objectives drawn."""


@checked
def family(designed: FamilyDesign) -> Figure:
    """Plot a design over an operating range on its held-out inputs.

    Left, the fraction of inputs settled by a given time. Right, the inputs in pairs with their
    settling times; failing inputs are crosses.
    """
    found, problem = designed.validation, designed.family.problem
    names = list(designed.family.ranges)
    pairs = [(a, b) for a, b in zip(names[0::2], names[1::2])][:PAIRS] or [(names[0], names[-1])]
    figure = style.new_figure(3.6 * (1 + len(pairs)), 3.4)
    axes = figure.subplots(1, 1 + len(pairs), squeeze=False)[0]
    _shares(axes[0], found)
    drawn = None
    for place, pair in zip(axes[1:], pairs):
        drawn = _plane(place, found, problem, pair)
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=axes[-1])
        bar.set_label("settling time (tau_min)", size=9)
        bar.ax.tick_params(labelsize=8, color=GREY)
    low, high = found.interval
    sure = f" ({low:.1%} to {high:.1%})" if found.drawn else ""
    style.headline(
        figure,
        f"{style.caption(problem)}\n{designed.winner.gain_rule.kind.value}: {found.share:.1%} of "
        f"{len(found)} {found.inputs} settle to a certified optimum{sure}",
    )
    return figure


def _shares(axes: Axes, found: Validation) -> None:
    style.quiet(axes)
    settled = np.sort(found.settling[found.certified])
    share = np.arange(1, len(settled) + 1) / len(found)
    axes.step(settled, share, where="post", color=BLUE, lw=1.5)
    for at in (0.5, 0.99):
        reached = settled[share >= at]
        if len(reached):
            axes.plot(reached[0], at, "o", color=INK, ms=4)
            axes.annotate(
                f"{at:.0%} by {reached[0]:.0f}", (reached[0], at), (6, -10),
                textcoords="offset points", fontsize=8, color=INK,
            )  # fmt: skip
    axes.axhline(1.0, color=GREY, lw=0.8, ls=":")
    axes.set(
        xlabel=style.FASTEST, ylabel="fraction of inputs settled", ylim=(0, 1.04), xlim=(0, None)
    )
    axes.margins(x=0.12)


def _plane(axes: Axes, found: Validation, problem: OptimalControlProblem, pair: tuple[str, str]):
    style.quiet(axes)
    x, y = (np.array([sample[name][0] for sample in found.samples]) for name in pair)
    good = found.certified
    drawn = axes.scatter(x[good], y[good], c=found.settling[good], s=7, cmap="viridis", lw=0)
    axes.plot(x[~good], y[~good], "x", color=VERMILION, ms=6, mew=1.6)
    axes.set(xlabel=_named(problem, pair[0]), ylabel=_named(problem, pair[1]))
    return drawn


def _named(problem: OptimalControlProblem, name: str) -> str:
    """Return an input name with the unit of its state."""
    return style.with_unit(name, problem.unit(name.partition(".")[2] or name))


@checked
def front(found: Front) -> Figure:
    """Plot a Pareto front: objectives in pairs, and the fraction of each along it.

    Points without certificate are crosses. Lines mark the ideal and the nadir point.
    """
    pairs = list(combinations(range(len(found.names)), 2))[:PAIRS]
    figure = style.new_figure(3.7 * (1 + len(pairs)), 3.6)
    axes = figure.subplots(1, 1 + len(pairs), squeeze=False)[0]
    for place, pair in zip(axes, pairs):
        _against(place, found, *pair)
    _counted(axes[-1], found)
    good = int(found.certified.sum())
    certified = f"one network, {len(found)} weights: {good} certified points"
    style.headline(figure, f"{style.caption(found.problem)}\n{certified}")
    return figure


def _against(axes: Axes, found: Front, first: int, second: int) -> None:
    style.quiet(axes)
    good, x, y = found.certified, found.values[:, first], found.values[:, second]
    if len(found.names) == 2:
        order = np.argsort(x)
        axes.plot(x[order], y[order], color=BLUE, lw=1.0, alpha=0.5)
    axes.plot(x[good], y[good], "o", color=BLUE, ms=4)
    axes.plot(x[~good], y[~good], "x", color=VERMILION, ms=6, mew=1.6)
    axes.plot(found.ideal[first], found.ideal[second], "*", color=INK, ms=9)
    axes.annotate(
        "ideal", (found.ideal[first], found.ideal[second]), (7, 3), textcoords="offset points",
        fontsize=8, color=INK,
    )  # fmt: skip
    axes.axvline(found.nadir[first], color=GREY, lw=0.8, ls=":")
    axes.axhline(found.nadir[second], color=GREY, lw=0.8, ls=":")
    unit = found.problem.cost_unit
    axes.set(
        xlabel=style.with_unit(found.names[first], unit),
        ylabel=style.with_unit(found.names[second], unit),
    )


def _counted(axes: Axes, found: Front) -> None:
    """Plot stacked fractions of the cost over the weight of the first objective."""
    style.quiet(axes)
    order = np.argsort(found.weights[:, 0], kind="stable")
    below = np.zeros(len(found))
    colours = (BLUE, VERMILION, GREY, INK)
    width = 0.8 / len(found)
    x = (np.arange(len(found)) + 0.5) / len(found)
    for own, name in enumerate(found.names):
        share = found.shares[order, own]
        colour = colours[own % len(colours)]
        axes.bar(x, share, width, bottom=below, color=colour, label=name, alpha=0.75, lw=0)
        below += share
    axes.set(
        xlabel=f"points, ordered by the weight of {found.names[0]}",
        ylabel="share",
        ylim=(0, 1),
        xticks=[],
    )
    axes.legend(fontsize=8, frameon=True, loc="lower right")
