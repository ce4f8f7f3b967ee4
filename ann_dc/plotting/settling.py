"""Figure of settling: neurons and KKT residual over network time, with prediction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.status import Outcome
from ann_dc.plotting.spectrum import final_spectrum
from ann_dc.plotting.style import (
    BLUE,
    FASTEST,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    UNSCALED,
    VERMILION,
    drawable,
    headline,
    legend_beside,
    new_figure,
    quiet,
    title,
)
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked

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

    Parameters
    ----------
    solution : Solution
        Solution to plot.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(7.6, 6.2)
    neurons, residual = figure.subplots(2, 1, sharex=True)
    found = _prediction(solution)
    radius = 1.0 if found is None else found.radius
    end = radius * float(solution.trajectory.time[-1]) or 1.0
    _neurons(neurons, solution, radius)
    _residuals(residual, solution, radius)
    for axes in (neurons, residual):
        _predicted(axes, found, end)
        axes.set_xlim(0.0, end)
        legend_beside(axes)
        quiet(axes)
    residual.set_xlabel(UNSCALED if found is None else FASTEST)
    headline(figure, title(solution))
    return figure


def _neurons(axes: Axes, solution: Solution, radius: float) -> None:
    """Plot the distance to the final value, relative to the population's largest."""
    run, time = solution.trajectory, radius * solution.trajectory.time
    with np.errstate(all="ignore"):
        distance = drawable(np.abs(run.states - run.states[-1]))
    for name, columns in _populations(solution):
        largest = float(np.nanmax(distance[:, columns], initial=0.0)) or 1.0
        shares = np.where(distance[:, columns] > 0, distance[:, columns] / largest, np.nan)
        colour, style = POPULATION.get(name, (GREY, "-"))
        thin = shares[:, :: max(1, distance.shape[1] // THIN_LINES)]
        lines = [np.column_stack([time, line]) for line in thin.T]
        axes.add_collection(LineCollection(lines, colors=colour, lw=0.4, alpha=0.25, zorder=1))
        farthest = np.fmax.reduce(shares, axis=1)
        axes.semilogy(
            time, farthest, style, color=colour, lw=2.0 if style == "-" else 1.4,
            label=f"{name}, farthest neuron",
        )  # fmt: skip
    axes.set_ylabel("distance to the last value\n(share of the population's largest)")
    axes.set_ylim(1e-8, 3.0)


def _populations(solution: Solution) -> Iterator[tuple[str, np.ndarray]]:
    network = solution.network
    owner = np.array([neuron.population for neuron in network.cell.neurons])[network.places[:, 0]]
    for name in sorted(set(owner), key=[*POPULATION, *owner].index):
        yield str(name), np.flatnonzero(owner == name)


def _residuals(axes: Axes, solution: Solution, radius: float) -> None:
    trajectory, tolerance = solution.trajectory, solution.run.tolerance
    time, parts = radius * trajectory.residual_time, drawable(trajectory.residuals)
    parts = np.where(parts > 0, parts, np.nan)
    kkt = np.fmax.reduce(parts, axis=1)
    axes.semilogy(time, kkt, color="#C9C9C9", lw=4.5, label="KKT residual (the larger)")
    axes.semilogy(time, parts[:, 0], color=SKY, lw=1.2, label="constraint residual")
    axes.semilogy(time, parts[:, 1], color=ORANGE, lw=1.2, label="stationarity residual")
    axes.axhline(tolerance, color=GREY, lw=1.0, ls=":", label=f"tolerance {tolerance:g}")
    settled = radius * solution.run.settling_time
    if solution.status.settled and np.isfinite(settled):
        axes.plot(
            settled, tolerance, "D", color=VERMILION, ms=7, zorder=5,
            label=f"settled after {settled:.3g}",
        )  # fmt: skip
    axes.set_ylabel("relative residual (1)")
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
        label=f"predicted: {pace} by e in {1 / abs(rate):.3g}" if rate else "predicted: stands",
    )  # fmt: skip


def _prediction(solution: Solution) -> Spectrum | None:
    """Return the spectrum if the run ended sufficiently close to an equilibrium."""
    ended_early = solution.status.outcome in (Outcome.DIVERGED, Outcome.LEFT_DOMAIN)
    return None if ended_early else final_spectrum(solution)
