"""Figure of the trajectory: the plan in the plane and every state over time."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ann_dc.plotting.style import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    VERMILION,
    drawable,
    headline,
    legend_below,
    limit_lines,
    new_figure,
    quiet,
    time_label,
    title,
    with_unit,
)
from ann_dc.problem.bounds import NO_BOUND
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked

HEADINGS = ("phi", "theta", "psi")
"""States drawn as arrows in the plane of x and y."""

MARKED = 60
"""Largest number of stages with one dot each."""

FORBIDDEN = "#E3E3E3"
GRID = 240
"""Grid points per side at which inequalities of the plane are evaluated."""


@checked
def trajectory(solution: Solution) -> Figure:
    """Plot the plan in the plane, and every state with a simulation of the controls.

    Parameters
    ----------
    solution : Solution
        Solution to plot.

    Returns
    -------
    matplotlib.figure.Figure
        The plane shows x and y, or the first two states if the problem lacks them. Regions excluded
        by inequalities of these two states alone are grey, and bounds of states are dashed.
    """
    states = [str(s) for s in solution.problem.states if s not in solution.problem.handed_on]
    columns = 1 if len(states) <= 5 else 2
    rows = -(-len(states) // columns)
    figure = new_figure(4.6 * (len(states) > 1) + 3.9 * columns, max(4.4, 1.35 * rows + 1.2))
    ratios = [4.6, *[3.9] * columns] if len(states) > 1 else [3.9] * columns
    grid = figure.add_gridspec(rows, len(ratios), width_ratios=ratios)
    if len(states) > 1:
        _plane(figure.add_subplot(grid[:, 0]), solution, _plane_states(states))
    panels: list[Axes] = []
    for i, name in enumerate(states):
        place = grid[i % rows, len(ratios) - columns + i // rows]
        panels.append(figure.add_subplot(place, sharex=panels[0] if panels else None))
        _state_over_time(panels[-1], solution, name)
        if (i + 1) % rows == 0 or i == len(states) - 1:
            panels[-1].set_xlabel(time_label(solution.problem))
        else:
            panels[-1].tick_params(labelbottom=False)
    figure.align_ylabels(panels)
    headline(figure, title(solution))
    legend_below(figure)
    return figure


def _plane_states(states: list[str]) -> tuple[str, str]:
    return ("x", "y") if {"x", "y"} <= set(states) else (states[0], states[1])


def _plane(axes: Axes, solution: Solution, pair: tuple[str, str]) -> None:
    states = [str(s) for s in solution.problem.states]
    rows = [states.index(name) for name in pair]
    a, b = (drawable(solution[name]) for name in pair)
    rolled = drawable(solution.certificate.rollout[rows])
    small = solution.problem.horizon > MARKED
    axes.plot(a, b, "-" if small else "o-", color=BLUE, lw=1.6, ms=4, zorder=3)
    axes.plot(*rolled, "--", color=INK, lw=1.0, zorder=4)
    _headings(axes, solution, pair)
    start, target = _ends(solution, rows)
    axes.plot(*start, "s", color=GREEN, ms=9, mfc="none", mew=1.8, label="start q_0", zorder=5)
    if np.isfinite(target).all():
        axes.plot(*target, "*", color=VERMILION, ms=13, label="target q_d", zorder=5)
    across, up = (solution.problem.unit(name) for name in pair)
    axes.set_xlabel(with_unit(pair[0], across))
    axes.set_ylabel(with_unit(pair[1], up))
    if _is_map(solution, pair):
        axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    _forbidden(axes, solution, pair)
    quiet(axes)


def _is_map(solution: Solution, pair: tuple[str, str]) -> bool:
    """Return True if both axes are positions in one unit, so that angles are true."""
    across, up = (solution.problem.unit(name) for name in pair)
    return pair == ("x", "y") and across == up


def _ends(solution: Solution, rows: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return components of q_0 and q_d; settled values for a free q_0.

    A free q_d gives nan.
    """
    problem = solution.problem
    start = np.where(problem.fixed_start, problem.ends[0], solution.populations["q"][0])
    target = [np.nan if value is None else value for value in problem.q_d or ()]
    return drawable(start)[rows], np.array(target, float)[rows]


def _headings(axes: Axes, solution: Solution, pair: tuple[str, str]) -> None:
    """Draw heading arrows if the axes are positions and a heading exists."""
    states = [str(s) for s in solution.problem.states]
    heading = next((h for h in HEADINGS if h in states), None)
    if heading is None or not _is_map(solution, pair):
        return
    x, y, angle = (drawable(solution[name]) for name in ("x", "y", heading))
    arrows = axes.quiver(
        x, y, np.cos(angle), np.sin(angle),
        color=ORANGE, width=0.007, scale=11, headwidth=4, zorder=2,
    )  # fmt: skip
    arrows.set_label("_nolegend_")
    axes.plot([], [], color=ORANGE, lw=2, marker=">", ms=6, label=f"heading {heading}")


def _forbidden(axes: Axes, solution: Solution, pair: tuple[str, str]) -> None:
    """Shade the region in which an inequality of these two states alone is violated."""
    problem = solution.problem
    names = [{str(s) for s in row.expression.free_symbols} for row in problem.inequalities]
    own = [read <= {*pair} for read in names]
    if not any(own):
        return
    left, right, low, high = axes.axis()
    reach = max(right - left, high - low) if _is_map(solution, pair) else 0.0
    plane = np.meshgrid(
        np.linspace(left - reach, right + reach, GRID), np.linspace(low - reach, high + reach, GRID)
    )
    q, u = np.zeros((problem.n, GRID**2)), np.zeros((problem.m, GRID**2))
    states = [str(s) for s in problem.states]
    for name, values in zip(pair, plane):
        q[states.index(name)] = values.ravel()
    data = {symbol: np.zeros(GRID**2) for symbol in problem.inputs}
    with np.errstate(all="ignore"):
        rows = problem.functions.with_inputs(data).rows(q, u).value[own]
    excess = np.nan_to_num(rows.max(axis=0)).reshape(GRID, GRID)
    drawn = axes.dataLim.frozen()
    axes.contourf(*plane, excess, levels=[0, np.inf], colors=[FORBIDDEN], zorder=0)
    axes.dataLim.set(drawn)  # what is forbidden has no end
    axes.autoscale_view()
    axes.fill([], [], color=FORBIDDEN, label="forbidden")


def _state_over_time(axes: Axes, solution: Solution, name: str) -> None:
    problem = solution.problem
    row = [str(s) for s in problem.states].index(name)
    time = drawable(solution.time)
    small = problem.horizon > MARKED
    axes.plot(
        time, drawable(solution[name]), "-" if small else "o-",
        color=BLUE, lw=1.6, ms=3.5, label="network",
    )  # fmt: skip
    axes.plot(
        time, drawable(solution.certificate.rollout[row]), "--",
        color=INK, lw=1.0, label="roll-out of the controls",
    )  # fmt: skip
    _, target = _ends(solution, [row])
    if np.isfinite(target).all():
        axes.plot(
            time[-1], target[0], "*",
            color=VERMILION, ms=10, clip_on=False, zorder=5, label="target q_d",
        )  # fmt: skip
    axes.set_ylabel(with_unit(name, problem.unit(name)).replace(" (", "\n("))
    axes.margins(y=0.18)
    limit_lines(axes, problem.bounds.get(name, NO_BOUND))
    quiet(axes)
