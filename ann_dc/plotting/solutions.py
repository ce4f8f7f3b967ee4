"""Figures of a solution: trajectory, controls, settling and spectrum."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.status import Outcome
from ann_dc.plotting import style
from ann_dc.plotting.style import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, VERMILION
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

    The plane shows x and y, or the first two states if the problem lacks them. Regions excluded by
    inequalities of these two states alone are grey, and bounds of states are dashed.
    """
    states = [str(s) for s in solution.problem.states if s not in solution.problem.handed_on]
    columns = 1 if len(states) <= 5 else 2
    rows = -(-len(states) // columns)
    figure = style.new_figure(4.6 * (len(states) > 1) + 3.9 * columns, max(4.4, 1.35 * rows + 1.2))
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
            panels[-1].set_xlabel(style.time_label(solution.problem))
        else:
            panels[-1].tick_params(labelbottom=False)
    figure.align_ylabels(panels)
    style.headline(figure, style.title(solution))
    style.legend_below(figure)
    return figure


def _plane_states(states: list[str]) -> tuple[str, str]:
    return ("x", "y") if {"x", "y"} <= set(states) else (states[0], states[1])


def _plane(axes: Axes, solution: Solution, pair: tuple[str, str]) -> None:
    states = [str(s) for s in solution.problem.states]
    rows = [states.index(name) for name in pair]
    a, b = (style.drawable(solution[name]) for name in pair)
    rolled = style.drawable(solution.certificate.rollout[rows])
    small = solution.problem.horizon > MARKED
    axes.plot(a, b, "-" if small else "o-", color=BLUE, lw=1.6, ms=4, zorder=3)
    axes.plot(*rolled, "--", color=INK, lw=1.0, zorder=4)
    _headings(axes, solution, pair)
    style.mark_ends(axes, *_ends(solution, rows))
    across, up = (solution.problem.unit(name) for name in pair)
    axes.set_xlabel(style.with_unit(pair[0], across))
    axes.set_ylabel(style.with_unit(pair[1], up))
    if _is_map(solution, pair):
        axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    _forbidden(axes, solution, pair)
    style.quiet(axes)


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
    return style.drawable(start)[rows], np.array(target, float)[rows]


def _headings(axes: Axes, solution: Solution, pair: tuple[str, str]) -> None:
    """Draw heading arrows if the axes are positions and a heading exists."""
    states = [str(s) for s in solution.problem.states]
    heading = next((h for h in HEADINGS if h in states), None)
    if heading is None or not _is_map(solution, pair):
        return
    x, y, angle = (style.drawable(solution[name]) for name in ("x", "y", heading))
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
    time = style.drawable(solution.time)
    small = problem.horizon > MARKED
    axes.plot(
        time, style.drawable(solution[name]), "-" if small else "o-",
        color=BLUE, lw=1.6, ms=3.5, label="network",
    )  # fmt: skip
    axes.plot(
        time, style.drawable(solution.certificate.rollout[row]), "--",
        color=INK, lw=1.0, label="simulation (discrete time)",
    )  # fmt: skip
    _, target = _ends(solution, [row])
    if np.isfinite(target).all():
        axes.plot(
            time[-1], target[0], "*",
            color=VERMILION, ms=10, clip_on=False, zorder=5, label="target q_d",
        )  # fmt: skip
    axes.set_ylabel(style.with_unit(name, problem.unit(name)).replace(" (", "\n("))
    axes.margins(y=0.18)
    style.limit_lines(axes, problem.bounds.get(name, NO_BOUND))
    style.quiet(axes)


@checked
def controls(solution: Solution) -> Figure:
    """Plot every control over time, piecewise constant, between its bounds.

    A bound is omitted if its distance exceeds the range of the control's values.
    """
    names = [str(u) for u in solution.problem.controls]
    figure = style.new_figure(6.4, 1.2 + 1.6 * max(len(names), 1.6))
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    edges = style.drawable(solution.time)
    for axes, name, bounds in zip(panels, names, solution.problem.control_limits):
        axes.stairs(style.drawable(solution[name]), edges, baseline=None, color=VERMILION, lw=1.8)
        axes.axhline(0.0, color=GREY, lw=0.6)
        axes.set_ylabel(style.with_unit(name, solution.problem.unit(name)))
        axes.set_xlim(edges[0], edges[-1])
        axes.margins(y=0.12)
        style.limit_lines(axes, bounds)
        style.quiet(axes)
    panels[-1].set_xlabel(style.time_label(solution.problem))
    style.headline(figure, style.title(solution))
    style.legend_below(figure)
    return figure


POPULATION = {
    "q": (BLUE, "-"),
    "u": (VERMILION, "-"),
    "mu": (PURPLE, "-"),
    "t": (SKY, "-."),
    "beta": (GREEN, "-."),
    "z": (ORANGE, "-"),
    "z_end": (INK, "-"),
}
"""Colour and line style of each population.

Lines of t and beta are broken because they coincide with q and mu.
"""

FIRST_INSTANT = 1.0
"""Initial interval of the plotted network time that the residual axis need not cover."""

THIN_LINES = 300
"""Largest number of single neurons drawn behind their population."""


@checked
def settling(solution: Solution) -> Figure:
    """Plot the distance of neurons from their final values, and the KKT residual.

    Network time is in fastest time constants (1 / spectral radius) if a spectrum exists. The dashed
    line is the prediction of the spectrum, without any fit to the run. A mark shows the settling
    time, at which the residual last falls below the tolerance of the run. A residual that falls by
    decades within the first of these time constants exceeds the axis.
    """
    figure = style.new_figure(7.6, 6.2)
    neurons, residual = figure.subplots(2, 1, sharex=True)
    ended_early = solution.status.outcome in (Outcome.DIVERGED, Outcome.LEFT_DOMAIN)
    found = None if ended_early else _final_spectrum(solution)
    radius = 1.0 if found is None else found.radius
    end = radius * float(solution.trajectory.time[-1]) or 1.0
    _neurons(neurons, solution, radius)
    _residuals(residual, solution, radius)
    for axes in (neurons, residual):
        _predicted(axes, found, end)
        axes.set_xlim(0.0, end)
        style.legend_beside(axes)
        style.quiet(axes)
    residual.set_xlabel(style.UNSCALED if found is None else style.FASTEST)
    style.headline(figure, style.title(solution))
    return figure


def _neurons(axes: Axes, solution: Solution, radius: float) -> None:
    """Plot the distance to the final value, relative to the population's largest."""
    run, time = solution.trajectory, radius * solution.trajectory.time
    with np.errstate(all="ignore"):
        distance = style.drawable(np.abs(run.states - run.states[-1]))
    for name, columns in _populations(solution):
        largest = float(np.nanmax(distance[:, columns], initial=0.0)) or 1.0
        shares = np.where(distance[:, columns] > 0, distance[:, columns] / largest, np.nan)
        colour, line = POPULATION.get(name, (GREY, "-"))
        thin = shares[:, :: max(1, distance.shape[1] // THIN_LINES)]
        lines = [np.column_stack([time, values]) for values in thin.T]
        axes.add_collection(LineCollection(lines, colors=colour, lw=0.4, alpha=0.25, zorder=1))
        farthest = np.fmax.reduce(shares, axis=1)
        axes.semilogy(
            time, farthest, line, color=colour, lw=2.0 if line == "-" else 1.4,
            label=f"{name}, farthest neuron",
        )  # fmt: skip
    axes.set_ylabel("distance to final value\n(relative to the population's largest)")
    axes.set_ylim(1e-8, 3.0)


def _populations(solution: Solution) -> Iterator[tuple[str, np.ndarray]]:
    network = solution.network
    owner = np.array([neuron.population for neuron in network.cell.neurons])[network.places[:, 0]]
    for name in sorted(set(owner), key=[*POPULATION, *owner].index):
        yield str(name), np.flatnonzero(owner == name)


def _residuals(axes: Axes, solution: Solution, radius: float) -> None:
    trajectory, tolerance = solution.trajectory, solution.run.tolerance
    time, parts = radius * trajectory.residual_time, style.drawable(trajectory.residuals)
    parts = np.where(parts > 0, parts, np.nan)
    kkt = np.fmax.reduce(parts, axis=1)
    axes.semilogy(time, kkt, color="#C9C9C9", lw=4.5, label="KKT residual (the larger of both)")
    axes.semilogy(time, parts[:, 0], color=SKY, lw=1.2, label="constraint residual")
    axes.semilogy(time, parts[:, 1], color=ORANGE, lw=1.2, label="stationarity residual")
    axes.axhline(tolerance, color=GREY, lw=1.0, ls=":", label=f"tolerance {tolerance:g}")
    settled = radius * solution.run.settling_time
    if solution.status.settled and np.isfinite(settled):
        axes.plot(
            settled, tolerance, "D", color=VERMILION, ms=7, zorder=5,
            label=f"settled after {settled:.3g}",
        )  # fmt: skip
    axes.set_ylabel("KKT residual (relative)")
    low = min(tolerance, np.nanmin(kkt, initial=1.0)) / 3
    axes.set_ylim(low, 3 * max(np.nanmax(kkt[time >= FIRST_INSTANT], initial=tolerance), 1.0))
    if kkt[0] > axes.get_ylim()[1]:
        axes.annotate(
            f"from {kkt[0]:.0e}", (0.0, 1.0), (16, -2), xycoords="axes fraction",
            textcoords="offset points", va="top", fontsize=8, color=GREY,
        )  # fmt: skip


def _predicted(axes: Axes, found: Spectrum | None, end: float) -> None:
    if found is None:
        return
    low, high = np.log(axes.get_ylim())
    time = np.linspace(0.0, end, 400)
    rate = found.abscissa / found.radius
    power = rate * time
    inside = (power >= low) & (power <= high)
    pace = "falls" if found.abscissa < 0 else "grows"
    axes.plot(
        time[inside], np.exp(power[inside]), "--", color=INK, lw=1.2, zorder=4,
        label=f"predicted: {pace} by e in {1 / abs(rate):.3g}" if rate else "predicted: constant",
    )  # fmt: skip


@checked
def spectrum(solution: Solution) -> Figure:
    """Plot the eigenvalues of the flow with fixed gains at the end of the run.

    Blue eigenvalues decay and vermilion ones grow. The circle is the spectral radius (fastest time
    constant), and the dashed line is the abscissa (settling rate).
    """
    figure = style.new_figure(7.0, 4.4)
    axes = figure.subplots()
    found = _final_spectrum(solution)
    axes.set_xlabel("real part of the rate (per unit time constant)")
    axes.set_ylabel("imaginary part (per unit time constant)")
    style.headline(figure, style.title(solution))
    style.quiet(axes)
    if found is None:
        axes.text(
            0.5, 0.5, "no spectrum: the final state\nis not finite",
            ha="center", va="center", transform=axes.transAxes, color=GREY,
        )  # fmt: skip
        return figure
    _eigenvalues(axes, found)
    style.legend_beside(axes)
    return figure


def _final_spectrum(solution: Solution) -> Spectrum | None:
    """Return the spectrum at the end of the run; None if it does not exist."""
    if not (np.abs(solution.trajectory.final) < style.LARGEST).all():
        return None
    with np.errstate(all="ignore"):
        found = solution.spectrum
    return found if np.isfinite(found.eigenvalues).all() and found.radius > 0 else None


def _eigenvalues(axes: Axes, found: Spectrum) -> None:
    real, imaginary = np.real(found.eigenvalues), np.imag(found.eigenvalues)
    for mask, colour, name in ((real < 0, BLUE, "decaying"), (real >= 0, VERMILION, "growing")):
        if mask.any():
            axes.plot(
                real[mask], imaginary[mask], "o", color=colour, ms=5, alpha=0.75,
                mec="white", mew=0.4, ls="none", label=f"{mask.sum()} {name}", zorder=3,
            )  # fmt: skip
    axes.axhline(0.0, color=GREY, lw=0.8)
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.axvline(
        found.abscissa, color=VERMILION, ls="--", lw=1.2, label=f"abscissa {found.abscissa:.3g}"
    )
    axes.add_patch(Circle((0, 0), found.radius, fill=False, color=GREEN, lw=1.2))
    axes.plot([], [], color=GREEN, lw=1.2, label=f"radius {found.radius:.3g}")
    axes.plot([], [], " ", label=f"radius / |abscissa| {found.stiffness_ratio:.3g}")
    axes.set_aspect("equal")
    right = max(found.abscissa, 0.0)
    axes.set_xlim(-1.08 * found.radius, max(1.1 * right, 0.15 * found.radius))
    tall = max(float(np.abs(imaginary).max()), 0.35 * found.radius)
    axes.set_ylim(-1.15 * tall, 1.15 * tall)


@checked
def save_all(solution: Solution, folder: str | Path) -> list[Path]:
    """Write trajectory.png, controls.png, settling.png and spectrum.png into a folder.

    The folder is created if missing. Returns the paths. Raises `OutputError` if the folder cannot
    be created or written.
    """
    figures = {
        "trajectory": trajectory(solution),
        "controls": controls(solution),
        "settling": settling(solution),
        "spectrum": spectrum(solution),
    }
    return [style.save(figure, Path(folder) / f"{name}.png") for name, figure in figures.items()]
