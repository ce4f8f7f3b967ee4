"""Figures of a design over an operating range and of a Pareto front."""

from __future__ import annotations

import itertools

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ann_dc.families.family_design import FamilyDesign, Validation
from ann_dc.families.front import Front
from ann_dc.plotting.style import (
    BLUE,
    FASTEST,
    GREY,
    INK,
    VERMILION,
    caption,
    headline,
    new_figure,
    quiet,
    with_unit,
)
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.validation import checked

PAIRS = 3
"""Number of pairs of inputs or objectives drawn."""


@checked
def family(designed: FamilyDesign) -> Figure:
    """Plot a design over an operating range on its held-out inputs.

    Left, the fraction of inputs settled by a given time. Right, the inputs in pairs with their
    settling times; failing inputs are crosses.

    Parameters
    ----------
    designed : FamilyDesign
        Design to plot.

    Returns
    -------
    matplotlib.figure.Figure
    """
    found, problem = designed.validation, designed.family.problem
    names = list(designed.family.ranges)
    pairs = [(a, b) for a, b in zip(names[0::2], names[1::2])][:PAIRS] or [(names[0], names[-1])]
    figure = new_figure(3.6 * (1 + len(pairs)), 3.4)
    axes = figure.subplots(1, 1 + len(pairs), squeeze=False)[0]
    _shares(axes[0], found)
    drawn = None
    for place, pair in zip(axes[1:], pairs):
        drawn = _plane(place, found, problem, pair)
    if drawn is not None:
        bar = figure.colorbar(drawn, ax=axes[-1])
        bar.set_label("settling (fastest time constants)", size=9)
        bar.ax.tick_params(labelsize=8, color=GREY)
    low, high = found.interval
    sure = f" ({low:.1%} to {high:.1%})" if found.drawn else ""
    headline(
        figure,
        f"{caption(problem)}\n{designed.winner.gain_rule.kind.value}: {found.share:.1%} of "
        f"{len(found)} {found.inputs} settle to a certified optimum{sure}",
    )
    return figure


def _shares(axes: Axes, found: Validation) -> None:
    quiet(axes)
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
    axes.set(xlabel=FASTEST, ylabel="share of inputs settled", ylim=(0, 1.04), xlim=(0, None))
    axes.margins(x=0.12)


def _plane(axes: Axes, found: Validation, problem: OptimalControlProblem, pair: tuple[str, str]):
    quiet(axes)
    x, y = (np.array([sample[name][0] for sample in found.samples]) for name in pair)
    good = found.certified
    drawn = axes.scatter(x[good], y[good], c=found.settling[good], s=7, cmap="viridis", lw=0)
    axes.plot(x[~good], y[~good], "x", color=VERMILION, ms=6, mew=1.6)
    axes.set(xlabel=_named(problem, pair[0]), ylabel=_named(problem, pair[1]))
    return drawn


def _named(problem: OptimalControlProblem, name: str) -> str:
    """Return an input name with the unit of its state."""
    return with_unit(name, problem.unit(name.partition(".")[2] or name))


@checked
def front(found: Front) -> Figure:
    """Plot a Pareto front: objectives in pairs, and the fraction of each along it.

    Points without certificate are crosses. Lines mark the ideal and the nadir point.

    Parameters
    ----------
    found : Front
        Front to plot.

    Returns
    -------
    matplotlib.figure.Figure
    """
    pairs = list(itertools.combinations(range(len(found.names)), 2))[:PAIRS]
    figure = new_figure(3.7 * (1 + len(pairs)), 3.6)
    axes = figure.subplots(1, 1 + len(pairs), squeeze=False)[0]
    for place, pair in zip(axes, pairs):
        _against(place, found, *pair)
    _counted(axes[-1], found)
    good = int(found.certified.sum())
    headline(
        figure,
        f"{caption(found.problem)}\none network, {len(found)} weights: {good} certified points of "
        "the front",
    )
    return figure


def _against(axes: Axes, found: Front, first: int, second: int) -> None:
    quiet(axes)
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
        xlabel=with_unit(found.names[first], unit), ylabel=with_unit(found.names[second], unit)
    )


def _counted(axes: Axes, found: Front) -> None:
    """Plot stacked fractions of the cost over the weight of the first objective."""
    quiet(axes)
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
        xlabel=f"points, by the weight of {found.names[0]}", ylabel="share", ylim=(0, 1), xticks=[]
    )
    axes.legend(fontsize=8, frameon=True, loc="lower right")
