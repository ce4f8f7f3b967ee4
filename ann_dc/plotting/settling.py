"""How the network settled: neurons and KKT residual over network time, beside the prediction."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ann_dc.analysis.spectra import Spectrum
from ann_dc.backends.settling import last_exit
from ann_dc.backends.status import Outcome
from ann_dc.plotting.spectrum import final_spectrum
from ann_dc.plotting.style import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    drawable,
    headline,
    legend_beside,
    new_figure,
    quiet,
)
from ann_dc.solution import Solution

POPULATION = {
    "q": (BLUE, "-"),
    "u": (VERMILION, "-"),
    "mu": (PURPLE, "-"),
    "t": (SKY, "-."),
    "beta": (GREEN, "-."),
}
"""Colour and line of each population; t lies on q, and beta on mu, so theirs are broken."""

THIN_LINES = 300
"""Single neurons drawn behind their population, at most."""


def settling(solution: Solution) -> Figure:
    """How the neurons approach their last values, and how the KKT residual falls.

    The dashed line is the spectrum's prediction exp(abscissa s), with nothing fitted to the run;
    the settling time is marked where the residual last falls below the run's tolerance.
    """
    figure = new_figure(7.6, 6.2)
    neurons, residual = figure.subplots(2, 1, sharex=True)
    found = _prediction(solution)
    end = float(solution.trajectory.time[-1]) or 1.0
    _neurons(neurons, solution)
    _residuals(residual, solution)
    for axes in (neurons, residual):
        _predicted(axes, found, end)
        axes.set_xlim(0.0, end)
        legend_beside(axes)
        quiet(axes)
    residual.set_xlabel("network time s (unit time constants)")
    if found is not None:
        radius = found.radius
        above = neurons.secondary_xaxis(
            "top", functions=(lambda s: s * radius, lambda n: n / radius)
        )
        above.set_xlabel("fastest time constants (1 / spectral radius)", fontsize=9)
        above.tick_params(labelsize=8)
    headline(figure, solution)
    return figure


def _neurons(axes: Axes, solution: Solution) -> None:
    """Distance to the last value, relative to the largest distance of the population."""
    run = solution.trajectory
    with np.errstate(all="ignore"):
        distance = drawable(np.abs(run.states - run.states[-1]))
    for name, columns in _populations(solution):
        largest = float(np.nanmax(distance[:, columns], initial=0.0)) or 1.0
        shares = np.where(distance[:, columns] > 0, distance[:, columns] / largest, np.nan)
        colour, style = POPULATION.get(name, (GREY, "-"))
        thin = shares[:, :: max(1, distance.shape[1] // THIN_LINES)]
        lines = [np.column_stack([run.time, line]) for line in thin.T]
        axes.add_collection(LineCollection(lines, colors=colour, lw=0.4, alpha=0.25, zorder=1))
        farthest = np.fmax.reduce(shares, axis=1)
        axes.semilogy(
            run.time, farthest, style, color=colour, lw=2.0 if style == "-" else 1.4,
            label=f"{name}, farthest neuron",
        )  # fmt: skip
    axes.set_ylabel("distance to the last value\n(share of the population's largest)")
    axes.set_ylim(1e-8, 3.0)


def _populations(solution: Solution) -> Iterator[tuple[str, np.ndarray]]:
    network = solution.network
    owner = np.array([neuron.population for neuron in network.cell.neurons])[network.places[:, 0]]
    for name in sorted(set(owner), key=[*POPULATION, *owner].index):
        yield str(name), np.flatnonzero(owner == name)


def _residuals(axes: Axes, solution: Solution) -> None:
    trajectory, tolerance = solution.trajectory, solution.run.tolerance
    time, parts = trajectory.residual_time, drawable(trajectory.residuals)
    parts = np.where(parts > 0, parts, np.nan)
    kkt = np.fmax.reduce(parts, axis=1)
    axes.semilogy(time, kkt, color="#C9C9C9", lw=4.5, label="KKT residual (the larger)")
    axes.semilogy(time, parts[:, 0], color=SKY, lw=1.2, label="constraint residual")
    axes.semilogy(time, parts[:, 1], color=ORANGE, lw=1.2, label="stationarity residual")
    axes.axhline(tolerance, color=GREY, lw=1.0, ls=":", label=f"tolerance {tolerance:g}")
    settled = last_exit(time, trajectory.kkt, tolerance)
    if solution.status.settled and np.isfinite(settled):
        axes.plot(
            settled, tolerance, "D", color=VERMILION, ms=7, zorder=5,
            label=f"settled at s = {settled:.4g}",
        )  # fmt: skip
    axes.set_ylabel("relative residual (1)")
    low = min(tolerance, np.nanmin(kkt, initial=1.0)) / 3
    axes.set_ylim(low, 3 * max(np.nanmax(kkt, initial=tolerance), 1.0))


def _predicted(axes: Axes, found: Spectrum | None, end: float) -> None:
    if found is None:
        return
    low, high = np.log(axes.get_ylim())
    time = np.linspace(0.0, end, 400)
    power = found.abscissa * time
    inside = (power >= low) & (power <= high)
    axes.plot(
        time[inside], np.exp(power[inside]), "--", color=INK, lw=1.2, zorder=4,
        label=f"predicted exp({found.abscissa:.3g} s)",
    )  # fmt: skip


def _prediction(solution: Solution) -> Spectrum | None:
    """The spectrum, where the run came near enough to an equilibrium for it to mean something."""
    ended_early = solution.status.outcome in (Outcome.DIVERGED, Outcome.LEFT_DOMAIN)
    return None if ended_early else final_spectrum(solution)
