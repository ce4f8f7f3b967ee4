"""Figure 6: lambda, A and B over the outer iterations; tests of (18) and (21)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ann_dc.plotting.style import (
    BLUE,
    GREY,
    INK,
    VERMILION,
    drawable,
    headline,
    legend_below,
    new_figure,
    quiet,
)
from ann_dc.validation import NotEmpty, NotNegative, OrNan, Shape, checked

THIRD = 3
"""Iteration after which the paper reports convergence."""

LONG = 50
"""Number of iterations above which an axis is logarithmic."""

Line = Annotated[np.ndarray, Shape("J"), OrNan()]


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Coordinator quantities over the outer iterations.

    Attributes
    ----------
    name : str
        Legend entry.
    gain, A, B, theta : (J,) array
        lambda and the quantities from which it is computed, before each of J iterations, in network
        units.
    """

    name: str
    gain: Line
    A: Line
    B: Line
    theta: Line
    colour: str = BLUE


@checked
def gain_over_iterations(
    columns: Annotated[Mapping[str, Sequence[Curves]], NotEmpty()], *, title: str = ""
) -> Figure:
    """Plot lambda, A, |B| and Theta over the outer iterations, one column per case.

    Columns are keyed by heading, with one curve per plan. Dots mark B < 0, for which some lambda
    decreases Theta. Crosses mark points without such a lambda. See Figure 6 and equations (19),
    (21), (33) of the paper.
    """
    figure = new_figure(0.8 + 3.3 * len(columns), 8.2)
    grid = figure.subplots(4, len(columns), squeeze=False, sharex="col")
    for column, (heading, curves) in zip(grid.T, columns.items()):
        column[0].set_title(heading, fontsize=9, loc="left", color=INK)
        for curve in curves:
            j = np.arange(1, len(curve.gain) + 1)
            style = {"color": curve.colour, "lw": 1.3, "label": curve.name}
            for axes, values in zip(column, (curve.gain, curve.A, None, curve.theta)):
                if values is not None:
                    axes.plot(j, drawable(values), **style)
            _signed(column[2], j, drawable(curve.B), curve.colour)
        column[-1].set_xlabel("outer iteration j")
        if max(len(curve.gain) for curve in curves) > LONG:
            column[-1].set_xscale("log")
        else:
            column[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    labels = ("λ (network units)", "A (network units)", "|B| (network units)", "Θ (network units)")
    for row, label in zip(grid, labels):
        row[0].set_ylabel(label)
        for axes in row:
            axes.set_yscale("log")
            axes.axvline(THIRD, color=GREY, lw=0.8, ls="--", zorder=1, label="third iteration")
            quiet(axes)
    _key_of_signs(grid[2, 0])
    headline(figure, title)
    legend_below(figure, most=5)
    return figure


def _signed(axes: Axes, j: np.ndarray, B: np.ndarray, colour: str) -> None:
    axes.plot(j, np.abs(B), color=colour, lw=0.5, alpha=0.5)
    for of, marker in ((B < 0, "."), (B >= 0, "+")):
        axes.plot(j[of], np.abs(B[of]), marker, color=colour, ms=5)


def _key_of_signs(axes: Axes) -> None:
    axes.plot([], [], ".", color=INK, label="B < 0: some λ lowers Θ")
    axes.plot([], [], "+", color=INK, label="B ≥ 0: none does")


@checked
def definitions(curves: Annotated[Sequence[Curves], NotEmpty()], *, title: str = "") -> Figure:
    """Plot A, B, |B/A| and the change of Theta for several definitions of A and B.

    The curves belong to the same iterations, with one lambda for t and beta. The last panel shows A
    lambda^2 + B lambda next to the change of Theta. See equations (20), (21), (33) of the paper.
    """
    figure = new_figure(9.6, 6.0)
    (a, b), (bound, change) = figure.subplots(2, 2, sharex=True)
    j = np.arange(1, len(curves[0].gain) + 1)
    for curve in curves:
        style = {"color": curve.colour, "lw": 1.6, "label": curve.name}
        foretold = curve.A * curve.gain**2 + curve.B * curve.gain
        a.semilogy(j, drawable(curve.A), **style)
        b.plot(j, drawable(curve.B), **style)
        bound.semilogy(j, drawable(np.abs(curve.B / curve.A)), **style)
        change.plot(j, drawable(foretold), **style)
    did = np.diff(curves[0].theta)
    change.plot(j[:-1], drawable(did), ":", color=INK, lw=2.0, label="what Θ did")
    bound.plot(j, curves[0].gain, "--", color=GREY, lw=1.2, label="λ that was taken")
    for axes, label in zip((a, b, bound, change), ("A", "B", "|B/A|", "ΔΘ = A λ² + B λ")):
        axes.set_ylabel(f"{label} (network units)")
        quiet(axes)
    for axes in (b, change):
        axes.axhline(0.0, color=GREY, lw=0.8, zorder=1)
    for axes in (bound, change):
        axes.set_xlabel("outer iteration j")
    headline(figure, title)
    legend_below(figure)
    return figure


@checked
def following(
    told: Line, found: Mapping[str, tuple[Line, NotNegative]], *, title: str = ""
) -> Figure:
    """Plot the errors of the stages against the coordination errors, with bounds.

    See equation (18) and Theorem IV.1. The figure shows errors over the iterations, and their
    ratios with the rates.

    Parameters
    ----------
    told : (J,) array
        Norm of e_t and e_beta together.
    found : mapping of str to pair
        Norms (J,) of a stage error and its rate in Theorem IV.1, by name.
    """
    figure = new_figure(9.6, 4.0)
    errors, quotients = figure.subplots(1, 2)
    j = np.arange(1, len(told) + 1)
    errors.semilogy(j, told, color=INK, lw=1.5, label="|e_t, e_beta|")
    for colour, (name, (values, rate)) in zip((BLUE, VERMILION), found.items()):
        errors.semilogy(j, values, color=colour, lw=1.5, label=f"|{name}|")
        errors.semilogy(j, rate * told, ":", color=colour, lw=1.2, label=f"bound of |{name}|")
        quotients.plot(j, values / told, color=colour, lw=1.5)
        quotients.axhline(rate, color=colour, lw=1.2, ls=":")
    errors.set_ylabel("norm of an error (network units)")
    quotients.set_ylabel("error / |e_t, e_beta| (1)")
    quotients.set_ylim(bottom=0)
    for axes in (errors, quotients):
        axes.set_xlabel("outer iteration j")
        quiet(axes)
    headline(figure, title)
    legend_below(figure)
    return figure
