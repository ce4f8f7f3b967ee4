"""Figure 6, equation (21) and Theorem IV.1: lambda, A, B and errors over outer iterations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ann_dc.errors import NetworkError
from ann_dc.paper.replans import SHARE, Iterations
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
from ann_dc.two_level.lyapunov import Lyapunov
from ann_dc.two_level.run import TwoLevelRun

THIRD = 3
"""Iteration after which the paper reports convergence."""

LONG = 50
"""Number of iterations above which an axis is logarithmic."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curves:
    """Quantities (J,) before each of J outer iterations, in network units; `gain` is lambda."""

    name: str
    gain: np.ndarray
    A: np.ndarray
    B: np.ndarray
    theta: np.ndarray
    colour: str = BLUE


def gain_over_iterations(columns: Mapping[str, Sequence[Curves]], *, title: str = "") -> Figure:
    """Plot lambda, A, |B| and Theta over the outer iterations, one column per case.

    Columns are keyed by heading, with one curve per plan. Dots mark B < 0, for which some lambda
    decreases Theta; crosses mark the other points. See equations (19), (21), (33) of the paper.
    """
    figure = style.new_figure(0.8 + 3.3 * len(columns), 8.2)
    grid = figure.subplots(4, len(columns), squeeze=False, sharex="col")
    for column, (heading, curves) in zip(grid.T, columns.items()):
        column[0].set_title(heading, fontsize=9, loc="left", color=INK)
        for curve in curves:
            j = np.arange(1, len(curve.gain) + 1)
            line = {"color": curve.colour, "lw": 1.3, "label": curve.name}
            for axes, values in zip(column, (curve.gain, curve.A, None, curve.theta)):
                if values is not None:
                    axes.plot(j, style.drawable(values), **line)
            _signed(column[2], j, style.drawable(curve.B), curve.colour)
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
            style.quiet(axes)
    _key_of_signs(grid[2, 0])
    style.headline(figure, title)
    style.legend_below(figure, most=5)
    return figure


def _signed(axes: Axes, j: np.ndarray, B: np.ndarray, colour: str) -> None:
    axes.plot(j, np.abs(B), color=colour, lw=0.5, alpha=0.5)
    for of, marker in ((B < 0, "."), (B >= 0, "+")):
        axes.plot(j[of], np.abs(B[of]), marker, color=colour, ms=5)


def _key_of_signs(axes: Axes) -> None:
    axes.plot([], [], ".", color=INK, label="B < 0: some λ lowers Θ")
    axes.plot([], [], "+", color=INK, label="B ≥ 0: none")


def definitions(curves: Sequence[Curves], *, title: str = "") -> Figure:
    """Plot A, B, |B/A| and the change of Theta for several definitions of A and B.

    The curves belong to the same iterations, with one lambda for t and beta. The last panel shows A
    lambda^2 + B lambda next to the change of Theta. See equations (20), (21), (33) of the paper.
    """
    figure = style.new_figure(9.6, 6.0)
    (a, b), (bound, change) = figure.subplots(2, 2, sharex=True)
    j = np.arange(1, len(curves[0].gain) + 1)
    for curve in curves:
        line = {"color": curve.colour, "lw": 1.6, "label": curve.name}
        foretold = curve.A * curve.gain**2 + curve.B * curve.gain
        a.semilogy(j, style.drawable(curve.A), **line)
        b.plot(j, style.drawable(curve.B), **line)
        bound.semilogy(j, style.drawable(np.abs(curve.B / curve.A)), **line)
        change.plot(j, style.drawable(foretold), **line)
    did = np.diff(curves[0].theta)
    change.plot(j[:-1], style.drawable(did), ":", color=INK, lw=2.0, label="measured ΔΘ")
    bound.plot(j, curves[0].gain, "--", color=GREY, lw=1.2, label="applied λ")
    for axes, label in zip((a, b, bound, change), ("A", "B", "|B/A|", "ΔΘ = A λ² + B λ")):
        axes.set_ylabel(f"{label} (network units)")
        style.quiet(axes)
    for axes in (b, change):
        axes.axhline(0.0, color=GREY, lw=0.8, zorder=1)
    for axes in (bound, change):
        axes.set_xlabel("outer iteration j")
    style.headline(figure, title)
    style.legend_below(figure)
    return figure


def following(
    reported: np.ndarray, found: Mapping[str, tuple[np.ndarray, float]], *, title: str = ""
) -> Figure:
    """Plot errors of the stages and their ratios to the coordination errors, with bounds.

    See equation (18) and Theorem IV.1. `reported` (J,) is the norm of e_t and e_beta together.
    `found` has the norms (J,) of a stage error and its rate in Theorem IV.1, by name.
    """
    figure = style.new_figure(9.6, 4.0)
    errors, quotients = figure.subplots(1, 2)
    j = np.arange(1, len(reported) + 1)
    errors.semilogy(j, reported, color=INK, lw=1.5, label="|e_t, e_beta|")
    for colour, (name, (values, rate)) in zip((BLUE, VERMILION), found.items()):
        errors.semilogy(j, values, color=colour, lw=1.5, label=f"|{name}|")
        errors.semilogy(j, rate * reported, ":", color=colour, lw=1.2, label=f"bound of |{name}|")
        quotients.plot(j, values / reported, color=colour, lw=1.5)
        quotients.axhline(rate, color=colour, lw=1.2, ls=":")
    errors.set_ylabel("error norm (network units)")
    quotients.set_ylabel("error / |e_t, e_beta| (1)")
    quotients.set_ylim(bottom=0)
    for axes in (errors, quotients):
        axes.set_xlabel("outer iteration j")
        style.quiet(axes)
    style.headline(figure, title)
    style.legend_below(figure)
    return figure


COLOURS = (BLUE, VERMILION, GREEN, ORANGE, PURPLE)
"""Colours of the plans T_0, T_1, ..."""
UNTOLD = "figures of the two levels need the solution; pass settled="


def figure_6(found: Iterations) -> Figure:
    """Plot lambda, A, B and Theta of every plan in both cases, and as printed.

    Raises `NetworkError` if a run does not contain the solution.

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> figure = figure_6(iterations())  # doctest: +SKIP

    References
    ----------
    Paper, Figure 6.
    """
    columns = {}
    for plans in found.cases:
        own = _known(plans.run)
        columns[plans.case.name] = [
            _curves(f"T_{m}", plans.run, own, m, colour)
            for m, colour in zip(range(len(plans.starts)), COLOURS)
        ]
    columns["settling at T_0"] = [
        _curves(f"two gains (λ of t): {_needed(found.gradient)}", found.gradient, None, 0, SKY),
        _curves(f"Newton's method: {_needed(found.newton)}", found.newton, None, 0, PURPLE),
    ]
    letter = found.letter
    columns["(28)-(30), (33) as printed"] = [
        _curves("T_0 as printed, A and B as they are", letter, _known(letter), 0, INK),
        _curves("T_0 as printed, A and B of (20), (21)", letter, letter.printed_lyapunov, 0, GREY),
    ]
    ends = np.concatenate([plans.run.outer_iterations for plans in found.cases])
    settled = f"{(ends >= 0).sum()} of {len(ends)} plans settle"
    return gain_over_iterations(
        columns,
        title=f"Figure 6. λ = {SHARE:g} |B/A| (33), with which {settled}; gains and steps that "
        "settle; (28)-(30) as printed",
    )


def figure_of_definitions(found: Iterations) -> Figure:
    """Plot A and B for one fixed gain of t and beta, corrected and as printed.

    The printed definitions are (20) and (21).

    Raises `NetworkError` if a run does not contain the solution.

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> figure = figure_of_definitions(iterations())  # doctest: +SKIP

    References
    ----------
    Paper equations (20), (21).
    """
    run = found.common
    return definitions(
        [
            _curves("corrected", run, _known(run), 0, BLUE),
            _curves("as printed in (20), (21)", run, run.printed_lyapunov, 0, VERMILION),
        ],
        title="A and B of (21), T_0 with one fixed gain for t and beta, started near the solution",
    )


def figure_of_following(found: Iterations) -> Figure:
    """Plot the measurement of Theorem IV.1 in a run that settles with two fixed gains.

    Raises `NetworkError` if a run does not contain the solution.

    Examples
    --------
    >>> from ann_dc.paper import iterations
    >>> figure = figure_of_following(iterations())  # doctest: +SKIP

    References
    ----------
    Paper equation (18) and Theorem IV.1.
    """
    distances = found.gradient.distances
    if distances is None:
        raise NetworkError(UNTOLD)
    errors = {
        "e_v": (distances.v[:, 0], found.following.v),
        "e_mu": (distances.mu[:, 0], found.following.mu),
    }
    return following(
        distances.reported[:, 0],
        errors,
        title="Theorem IV.1 measured, T_0 with two fixed gains; dotted: its bound to first order",
    )


def _needed(run: TwoLevelRun) -> str:
    return f"{run.outer_iterations[0]} outer iterations"


def _known(run: TwoLevelRun) -> Lyapunov:
    if run.lyapunov is None:
        raise NetworkError(UNTOLD)
    return run.lyapunov


def _curves(name: str, run: TwoLevelRun, of: Lyapunov | None, sample: int, colour: str) -> Curves:
    theta, A, B = (np.asarray(part)[: run.rounds, sample] for part in of or _known(run))
    gain = run.gains[:, 0, sample]
    return Curves(name=name, gain=gain, A=A, B=B, theta=theta, colour=colour)
