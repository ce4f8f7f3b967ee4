"""Overview: from a problem to a settled network, as a block diagram with a result."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ann_dc.plotting import style
from ann_dc.plotting.paper.schemes import arrow, box
from ann_dc.plotting.style import BLUE, GREY, INK, VERMILION
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked

CELLS = 0.9, 4.3, 7.7
"""Positions of the first, a middle and the last cell."""


@checked
def overview(solution: Solution) -> Figure:
    """Draw how a network solves a problem: blocks on the left, path and residual on the right.

    The path shows the first two states. The residual is that of the KKT conditions over network
    time in tau_min, with the rate that the spectrum at the solution predicts.

    Examples
    --------
    >>> import ann_dc
    >>> len(overview(ann_dc.solve(ann_dc.plants.car(N=5))).axes)
    3
    """
    figure = style.new_figure(11.0, 4.0)
    blocks, path, residual = figure.subplots(1, 3, width_ratios=(2.2, 1.0, 1.1))
    _blocks(blocks, solution)
    _path(path, solution)
    _residual(residual, solution)
    return figure


def _blocks(axes: Axes, solution: Solution) -> None:
    problem, last = solution.problem, solution.problem.horizon - 1
    axes.axis("off")
    states, controls = (", ".join(map(str, of)) for of in (problem.states, problem.controls))
    box(axes, 0.6, 6.2, "", width=9.4, height=1.5)
    axes.text(5.3, 7.25, f"optimal-control problem: {problem.name}", ha="center", weight="bold")
    axes.text(5.3, 6.5, f"$q$ = ({states}),  $u$ = ({controls}),  N = {last + 1}", ha="center")
    arrow(axes, (5.3, 6.2), (5.3, 5.55), INK)
    axes.text(5.5, 5.87, "decompose, synthesise, design gains", va="center", color=GREY)
    for place, k in zip(CELLS, ("0", "k", str(last))):
        box(axes, place, 3.2, f"cell {k}\n$q_{{{k}}}, u_{{{k}}}, \\mu_{{{k}}}$", height=2.2)
    for left, right in pairwise(CELLS):
        arrow(axes, (left + 2.0, 4.6), (right, 4.6), BLUE)
        arrow(axes, (right, 3.9), (left + 2.0, 3.9), VERMILION)
        middle = (left + right) / 2 + 1.0
        axes.text(middle, 4.7, "$t$", ha="center", va="bottom", color=BLUE)
        axes.text(middle, 3.75, r"$\beta$", ha="center", va="top", color=VERMILION)
    axes.text(0.5, 4.3, "$q_0$", ha="center", va="center")
    axes.text(10.1, 4.3, "$q_d$", ha="center", va="center")
    arrow(axes, (5.3, 3.2), (5.3, 2.55), INK)
    axes.text(5.5, 2.87, r"$\dot x = M\,d(x)$", va="center", color=GREY)
    uses = ("continuous time", "recurrent steps", "circuit (ngspice)")
    for place, word in zip((0.2, 3.85, 7.5), uses):
        box(axes, place, 1.2, word, width=3.1, height=1.2)
    axes.text(5.3, 0.5, "certificate: KKT residual from exact derivatives", ha="center")
    axes.set_xlim(0.0, 10.8)
    axes.set_ylim(0.0, 7.9)


def _path(axes: Axes, solution: Solution) -> None:
    names = [str(state) for state in solution.problem.states[:2]]
    x, y = (solution[name] for name in names)
    axes.plot(x, y, "o-", color=BLUE, ms=3.5)
    style.mark_ends(axes, (x[0], y[0]), (x[-1], y[-1]))
    unit = solution.problem.unit
    axes.set(xlabel=style.with_unit(names[0], unit(names[0])))
    axes.set(ylabel=style.with_unit(names[1], unit(names[1])))
    axes.set_title("settled path", fontsize=10)
    style.quiet(axes)


def _residual(axes: Axes, solution: Solution) -> None:
    trajectory, modes = solution.trajectory, solution.spectrum
    time = trajectory.residual_time * modes.radius
    axes.semilogy(time, trajectory.kkt, color=INK, label="KKT residual")
    settled = solution.normalised_settling_time
    slope = np.exp(modes.abscissa / modes.radius * (time - settled)) * 1e-6
    shown = slope < trajectory.kkt.max()
    axes.semilogy(time[shown], slope[shown], color=VERMILION, ls="--", label="predicted rate")
    axes.axvline(settled, color=GREY, lw=1, ls=":", label=f"settled after {settled:.3g}")
    axes.set(xlabel=r"network time ($\tau_{min}$)", ylabel="relative KKT residual")
    axes.set_title("settling", fontsize=10)
    axes.legend(fontsize=8, loc="upper right")
    style.quiet(axes)
