"""Four pictures of a solution: where it goes, what drives it, how it settled, and why so fast.

Every function returns a `matplotlib.figure.Figure` of its own: no pyplot, no global state, nothing
to close. Runs that did not settle are drawn as far as they are finite.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ann_dc.backends.run import Outcome, last_exit
from ann_dc.errors import OutputError
from ann_dc.network.spectrum import Spectrum
from ann_dc.solution import Solution

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
SKY, PURPLE, INK, GREY = "#56B4E9", "#CC79A7", "#222222", "#8A8A8A"
"""Okabe and Ito's palette: distinct for every kind of colour vision."""

POPULATION = {
    "q": (BLUE, "-"),
    "u": (VERMILION, "-"),
    "mu": (PURPLE, "-"),
    "t": (SKY, "-."),
    "beta": (GREEN, "-."),
}
"""Colour and line of each population; t lies on q, and beta on mu, so theirs are broken."""

HEADINGS = ("phi", "theta", "psi")
"""States that are drawn as arrows in the plane of x and y."""

LARGEST = 1e100
"""Values beyond it are left out of a picture."""

THIN_LINES = 300
"""Single neurons drawn behind their population, at most."""


# ---- the four pictures -------------------------------------------------------------------------


def trajectory(solution: Solution, units: Mapping[str, str] | None = None) -> Figure:
    """Plan in the plane, and every state over time next to the roll-out of the controls.

    Parameters
    ----------
    solution : Solution
    units : mapping of state or control name to str, optional
        Units for the axes, for instance ``{"x": "m"}``; a problem declares none.

    Returns
    -------
    matplotlib.figure.Figure
        The plane shows x and y where the problem has them, else its first two states.
    """
    states = [str(s) for s in solution.problem.states]
    columns = 1 if len(states) <= 5 else 2
    rows = -(-len(states) // columns)
    figure = new_figure(4.6 * (len(states) > 1) + 3.9 * columns, max(4.4, 1.35 * rows + 1.2))
    ratios = [4.6, *[3.9] * columns] if len(states) > 1 else [3.9] * columns
    grid = figure.add_gridspec(rows, len(ratios), width_ratios=ratios)
    if len(states) > 1:
        _plane(figure.add_subplot(grid[:, 0]), solution, _plane_states(states), units)
    panels: list[Axes] = []
    for i, name in enumerate(states):
        place = grid[i % rows, len(ratios) - columns + i // rows]
        panels.append(figure.add_subplot(place, sharex=panels[0] if panels else None))
        _state_over_time(panels[-1], solution, name, units)
        if (i + 1) % rows == 0 or i == len(states) - 1:
            panels[-1].set_xlabel("time k dt (s)")
        else:
            panels[-1].tick_params(labelbottom=False)
    figure.align_ylabels(panels)
    _title(figure, solution)
    _legend_below(figure)
    return figure


def controls(solution: Solution, units: Mapping[str, str] | None = None) -> Figure:
    """Every control over time, held constant for a sampling interval.

    Parameters
    ----------
    solution : Solution
    units : mapping of control name to str, optional
    """
    names = [str(u) for u in solution.problem.controls]
    figure = new_figure(6.4, 1.2 + 1.6 * max(len(names), 1.6))
    panels = np.atleast_1d(figure.subplots(len(names), 1, sharex=True))
    edges = solution.problem.dt * np.arange(solution.problem.horizon + 1)
    for axes, name in zip(panels, names):
        axes.stairs(_drawable(solution[name]), edges, baseline=None, color=VERMILION, lw=1.8)
        axes.axhline(0.0, color=GREY, lw=0.6)
        axes.set_ylabel(with_unit(name, units))
        axes.set_xlim(edges[0], edges[-1])
        axes.margins(y=0.12)
        quiet(axes)
    panels[-1].set_xlabel("time k dt (s)")
    _title(figure, solution)
    return figure


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
        _legend_beside(axes)
        quiet(axes)
    residual.set_xlabel("network time s (unit time constants)")
    if found is not None:
        radius = found.radius
        above = neurons.secondary_xaxis(
            "top", functions=(lambda s: s * radius, lambda n: n / radius)
        )
        above.set_xlabel("fastest time constants (1 / spectral radius)", fontsize=9)
        above.tick_params(labelsize=8)
    _title(figure, solution)
    return figure


def spectrum(solution: Solution) -> Figure:
    """Eigenvalues of the frozen network's flow where the run ended.

    Blue ones decay, vermilion ones grow. The circle is the spectral radius (the fastest time
    constant), the dashed line the abscissa (the rate of settling).
    """
    figure = new_figure(7.0, 4.4)
    axes = figure.subplots()
    found = _spectrum(solution)
    axes.set_xlabel("real part (1 / unit time constant)")
    axes.set_ylabel("imaginary part (1 / unit time constant)")
    _title(figure, solution)
    quiet(axes)
    if found is None:
        axes.text(
            0.5, 0.5, "no spectrum: the run ended at a state\nthat is not finite",
            ha="center", va="center", transform=axes.transAxes, color=GREY,
        )  # fmt: skip
        return figure
    _eigenvalues(axes, found)
    _legend_beside(axes)
    return figure


def save_all(
    solution: Solution, folder: str | Path, units: Mapping[str, str] | None = None
) -> list[Path]:
    """Write all four pictures as PNG into a folder, which is created where it is missing.

    Parameters
    ----------
    solution : Solution
    folder : str or Path
    units : mapping of state or control name to str, optional

    Returns
    -------
    list of Path
        trajectory.png, controls.png, settling.png, spectrum.png.

    Raises
    ------
    OutputError
        If the folder cannot be created or written.
    """
    figures = {
        "trajectory": trajectory(solution, units),
        "controls": controls(solution, units),
        "settling": settling(solution),
        "spectrum": spectrum(solution),
    }
    return [save(figure, Path(folder) / f"{name}.png") for name, figure in figures.items()]


# ---- what demos and studies draw with ----------------------------------------------------------


def new_figure(width: float, height: float) -> Figure:
    """An empty figure in inches that makes room for its own labels."""
    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def quiet(axes: Axes) -> None:
    """The house style: two spines, a light grid behind the data, small ticks."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(GREY)
    axes.grid(color="#E6E6E6", lw=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, color=GREY)
    axes.xaxis.label.set_fontsize(9)
    axes.yaxis.label.set_fontsize(9)


def with_unit(name: str, units: Mapping[str, str] | None) -> str:
    """``name (unit)``, in the problem's own units where none is given."""
    return f"{name} ({(units or {}).get(name, 'problem units')})"


def title(solution: Solution) -> str:
    """Name of the problem, form of the equations, and how the run ended."""
    form = solution.equations.form
    head = f"{solution.problem.name}, {form}" if str(form) != "corrected" else solution.problem.name
    words = solution.status.outcome.name.lower().replace("_", " ")
    if solution.status.settled:
        words += f", objective {solution.objective:.7g}"
    elif solution.status.neuron is not None:
        words += f" at {solution.status.neuron}"
    return f"{head}: {words}"


def save(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG: same figure, same bytes.

    Raises
    ------
    OutputError
        If the folder cannot be created or the file cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=150, metadata={"Software": None})
    except OSError as error:
        raise OutputError(
            f"folder {str(path.parent)!r}: cannot write {path.name} there "
            f"({error.strerror or error}); give a folder that exists or can be created and that "
            "you may write to"
        ) from error
    return path


# ---- trajectory --------------------------------------------------------------------------------


def _plane_states(states: list[str]) -> tuple[str, str]:
    return ("x", "y") if {"x", "y"} <= set(states) else (states[0], states[1])


def _plane(axes: Axes, solution: Solution, pair: tuple[str, str], units) -> None:
    states = [str(s) for s in solution.problem.states]
    rows = [states.index(name) for name in pair]
    a, b = (_drawable(solution[name]) for name in pair)
    rolled = _drawable(solution.certificate.rollout[rows])
    axes.plot(a, b, "o-", color=BLUE, lw=1.6, ms=4, zorder=3)
    axes.plot(*rolled, "--", color=INK, lw=1.0, zorder=4)
    _headings(axes, solution, pair)
    start, target = _ends(solution, rows)
    axes.plot(*start, "s", color=GREEN, ms=9, mfc="none", mew=1.8, label="start q_0", zorder=5)
    if np.isfinite(target).all():
        axes.plot(*target, "*", color=VERMILION, ms=13, label="target q_d", zorder=5)
    axes.set_xlabel(with_unit(pair[0], units))
    axes.set_ylabel(with_unit(pair[1], units))
    if pair == ("x", "y"):
        axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.12)
    quiet(axes)


def _ends(solution: Solution, rows: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Some components of q_0 and of q_d; nan where the end is free."""
    problem = solution.problem
    target = [np.nan if value is None else value for value in problem.q_d or ()]
    return np.array(problem.q_0, float)[rows], np.array(target, float)[rows]


def _headings(axes: Axes, solution: Solution, pair: tuple[str, str]) -> None:
    """Arrows along the heading, where the plane is one of positions and there is a heading."""
    states = [str(s) for s in solution.problem.states]
    heading = next((h for h in HEADINGS if h in states), None)
    if heading is None or pair != ("x", "y"):
        return
    x, y, angle = (_drawable(solution[name]) for name in ("x", "y", heading))
    arrows = axes.quiver(
        x, y, np.cos(angle), np.sin(angle),
        color=ORANGE, width=0.007, scale=11, headwidth=4, zorder=2,
    )  # fmt: skip
    arrows.set_label("_nolegend_")
    axes.plot([], [], color=ORANGE, lw=2, marker=">", ms=6, label=f"heading {heading}")


def _state_over_time(axes: Axes, solution: Solution, name: str, units) -> None:
    problem = solution.problem
    row = [str(s) for s in problem.states].index(name)
    time = problem.dt * np.arange(problem.horizon + 1)
    small = problem.horizon > 60
    axes.plot(
        time, _drawable(solution[name]), "-" if small else "o-",
        color=BLUE, lw=1.6, ms=3.5, label="network",
    )  # fmt: skip
    axes.plot(
        time, _drawable(solution.certificate.rollout[row]), "--",
        color=INK, lw=1.0, label="roll-out of the controls",
    )  # fmt: skip
    _, target = _ends(solution, [row])
    if np.isfinite(target).all():
        axes.plot(
            time[-1], target[0], "*",
            color=VERMILION, ms=10, clip_on=False, zorder=5, label="target q_d",
        )  # fmt: skip
    axes.set_ylabel(with_unit(name, units).replace(" (", "\n("))
    axes.margins(y=0.18)
    quiet(axes)


# ---- settling ----------------------------------------------------------------------------------


def _neurons(axes: Axes, solution: Solution) -> None:
    """Distance to the last value, relative to the largest distance of the population."""
    run = solution.trajectory
    with np.errstate(all="ignore"):
        distance = _drawable(np.abs(run.states - run.states[-1]))
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
    time, parts = trajectory.residual_time, _drawable(trajectory.residuals)
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
    return None if ended_early else _spectrum(solution)


# ---- spectrum ----------------------------------------------------------------------------------


def _spectrum(solution: Solution) -> Spectrum | None:
    """The spectrum where the run ended, None where there is none."""
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
    axes.plot([], [], " ", label=f"radius / |abscissa| {found.ratio:.3g}")
    axes.set_aspect("equal")
    right = max(found.abscissa, 0.0)
    axes.set_xlim(-1.08 * found.radius, max(1.1 * right, 0.15 * found.radius))
    tall = max(float(np.abs(imaginary).max()), 0.35 * found.radius)
    axes.set_ylim(-1.15 * tall, 1.15 * tall)


# ---- small things ------------------------------------------------------------------------------

_LEGEND = {"frameon": False, "fontsize": 8, "borderaxespad": 0.0}


def _legend_beside(axes: Axes) -> None:
    axes.legend(**_LEGEND, loc="upper left", bbox_to_anchor=(1.02, 1.0))


def _legend_below(figure: Figure) -> None:
    """One legend for all panels, each label once."""
    found: dict[str, Artist] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            found.setdefault(label, handle)
    figure.legend(
        found.values(), found.keys(), frameon=False, fontsize=8,
        loc="outside lower center", ncols=len(found),
    )  # fmt: skip


def _title(figure: Figure, solution: Solution) -> None:
    figure.suptitle(title(solution), x=0.02, ha="left", fontsize=10)


def _drawable(values: np.ndarray) -> np.ndarray:
    """Values with everything that is not finite, or beyond reason, left out."""
    values = np.asarray(values, float)
    return np.where(np.abs(values) < LARGEST, values, np.nan)
