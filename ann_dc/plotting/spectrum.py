"""Figure of the eigenvalues of the network at the end of a run."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ann_dc.analysis.spectra import Spectrum
from ann_dc.plotting.style import (
    BLUE,
    GREEN,
    GREY,
    LARGEST,
    VERMILION,
    headline,
    legend_beside,
    new_figure,
    quiet,
    title,
)
from ann_dc.solution.solution import Solution
from ann_dc.validation import checked


@checked
def spectrum(solution: Solution) -> Figure:
    """Plot the eigenvalues of the flow with fixed gains at the end of the run.

    Blue eigenvalues decay and vermilion ones grow. The circle is the spectral radius (fastest time
    constant), and the dashed line is the abscissa (settling rate).

    Parameters
    ----------
    solution : Solution
        Solution to plot.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure = new_figure(7.0, 4.4)
    axes = figure.subplots()
    found = final_spectrum(solution)
    axes.set_xlabel("real part of the rate (per unit time constant)")
    axes.set_ylabel("imaginary part (per unit time constant)")
    headline(figure, title(solution))
    quiet(axes)
    if found is None:
        axes.text(
            0.5, 0.5, "no spectrum: the run ended at a state\nthat is not finite",
            ha="center", va="center", transform=axes.transAxes, color=GREY,
        )  # fmt: skip
        return figure
    _eigenvalues(axes, found)
    legend_beside(axes)
    return figure


def final_spectrum(solution: Solution) -> Spectrum | None:
    """Return the spectrum at the end of the run; None if it does not exist."""
    if not (np.abs(solution.trajectory.final) < LARGEST).all():
        return None
    with np.errstate(all="ignore"):
        found = solution.spectrum
    return found if np.isfinite(found.eigenvalues).all() and found.radius > 0 else None


def _eigenvalues(axes: Axes, found: Spectrum) -> None:
    real, imaginary = np.real(found.eigenvalues), np.imag(found.eigenvalues)
    for mask, colour, name in (
        (real < 0, BLUE, "decaying"),
        (real >= 0, VERMILION, "growing"),
    ):
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
