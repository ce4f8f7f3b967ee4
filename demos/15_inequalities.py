"""Inequality constraints: a car among discs, within its limits.

Question: A car must avoid three discs, drive at most 4 m/s, steer at most 2.5 rad/s and 0.5 rad.
          How does a network hold constraints?
Answer:   An inequality is one more neuron: the integrator of its multiplier with a rectifier, which
          is positive if the constraint is active and zero otherwise. A bound of a control is a
          saturation limit of its integrator. Constraints become active and inactive on the way,
          until six rows are active and nine controls are saturated; the certificate checks
          violation, signs and complementarity independently. The car settles in 74 tau_min.
Figure:   out/demos/15_inequalities.png: path with and without inequalities, controls and their
          limits, multipliers over the stages, active constraints over network time.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.evaluation import kkt_point
from ann_dc.plotting import style

DISCS = ((1.6, 0.9, 0.5), (2.9, 3.0, 0.6), (4.2, 3.6, 0.4))
"""Centre and radius of the discs, in m."""
LIMITS = {"nu": (0, 4), "eta": (-2.5, 2.5), "varphi": (-0.5, 0.5)}
"""Limits of speed (m/s), steering rate (rad/s) and steering angle (rad)."""
COLOURS = (style.GREEN, style.ORANGE, style.PURPLE, style.BLUE, style.SKY)
"""Colours of the inequalities."""
INSTANTS = 400
"""Number of instants of the run at which active constraints are determined."""


def among_discs() -> ann_dc.OptimalControlProblem:
    """Return the paper's car with a finer horizon, obstacles and limits."""
    x, y = sp.symbols("x y")
    outside = {
        f"disc{number}": (x - a) ** 2 + (y - b) ** 2 >= radius**2
        for number, (a, b, radius) in enumerate(DISCS, 1)
    }
    return replace(ann_dc.plants.car(N=24), constraints=outside, bounds=LIMITS)


def main(out: Path | None = None) -> dict:
    """Solve with and without inequalities; return solutions, active constraints, figure paths."""
    backend = ann_dc.OdeBackend(verify=False)
    free = ann_dc.solve(ann_dc.plants.car(N=24), backend=backend)
    held = ann_dc.solve(among_discs(), backend=backend)
    print(f"without inequalities: objective {free.objective:.2f}, {free.verdict}")
    print(held)
    time, conducting = active_constraints(held)
    figures = []
    if out is not None:
        figure = picture(free, held, time, conducting)
        figures.append(plotting.save(figure, Path(out) / "15_inequalities.png"))
    return {"free": free, "held": held, "conducting": conducting, "figures": figures}


def active_constraints(solution: ann_dc.Solution) -> tuple[np.ndarray, np.ndarray]:
    """Return network time in tau_min, and the active constraints (time, row, stage)."""
    run, radius = solution.trajectory, solution.spectrum.radius
    instants = np.unique(np.linspace(0, len(run.time) - 1, INSTANTS).astype(int))
    conducting = [kkt_point(solution.network, run.states[instant])[5] > 0 for instant in instants]
    return radius * run.time[instants], np.array(conducting)


def picture(free: ann_dc.Solution, held: ann_dc.Solution, time, conducting):
    """Draw path, controls, multipliers, KKT residual and active constraints."""
    figure = plotting.new_figure(10.4, 7.8)
    grid = figure.add_gridspec(4, 2)
    plane, controls = (figure.add_subplot(grid[:2, column]) for column in (0, 1))
    stages = figure.add_subplot(grid[2:, 0])
    residual = figure.add_subplot(grid[2, 1])
    active = figure.add_subplot(grid[3, 1], sharex=residual)
    paths(plane, free, held)
    draw_controls(controls, free, held)
    multipliers(stages, held)
    settling(residual, held)
    draw_active(active, time, conducting)
    for axes in figure.axes:
        plotting.quiet(axes)
    plotting.headline(figure, plotting.title(held))
    return figure


def paths(axes, free: ann_dc.Solution, held: ann_dc.Solution) -> None:
    """Draw both paths and the discs."""
    angle = np.linspace(0, 2 * np.pi, 100)
    for number, (a, b, radius) in enumerate(DISCS, 1):
        axes.fill(a + radius * np.cos(angle), b + radius * np.sin(angle), color="#DADADA")
        axes.text(a - radius / 5, b + radius / 3, f"disc{number}", ha="center", va="center", size=8)
    axes.plot(free["x"], free["y"], "--", color=style.INK, lw=1, label="without inequalities")
    axes.plot(held["x"], held["y"], "o-", ms=3.5, color=style.BLUE, label="with inequalities")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend(frameon=False, fontsize=8)


def draw_controls(axes, free: ann_dc.Solution, held: ann_dc.Solution) -> None:
    """Draw both controls and their limits."""
    for name, unit, color in (("nu", "m/s", style.VERMILION), ("eta", "rad/s", style.BLUE)):
        line = {"baseline": None, "color": color}
        axes.stairs(free[name], free.time, lw=0.8, alpha=0.6, **line)
        axes.stairs(held[name], held.time, lw=1.8, label=f"{name} ({unit})", **line)
        for limit in LIMITS[name]:
            axes.axhline(limit, color=color, lw=0.9, ls=(0, (6, 4)))
    axes.plot([], [], color=style.GREY, lw=0.9, ls=(0, (6, 4)), label="limit")
    axes.plot([], [], color=style.GREY, lw=0.8, label="without inequalities")
    axes.set(xlabel=plotting.style.time_label(held.problem), ylabel="control (m/s, rad/s)")
    axes.legend(frameon=False, fontsize=8, ncols=2)


def multipliers(axes, held: ann_dc.Solution) -> None:
    """Draw the multipliers of the active inequalities over the stages."""
    for row, color in zip(held.problem.inequalities, COLOURS):
        zeta = held[f"z.{row.name}"]
        stages = np.flatnonzero(zeta > 1e-6 * held["z"].max())
        axes.vlines(stages, 0, zeta[stages], color=color, lw=2)
        axes.plot(stages, zeta[stages], "o", color=color, ms=5, label=row.name)
    axes.set(xlabel="stage k", ylabel="multiplier zeta (cost per unit of g)")
    axes.set(xlim=(0, held.problem.horizon), ylim=(0, None))
    axes.legend(frameon=False, fontsize=8, title="inequality", title_fontsize=8)


def settling(axes, held: ann_dc.Solution) -> None:
    """Draw the KKT residual over network time until it is below the tolerance."""
    run, radius, end = (
        held.trajectory,
        held.spectrum.radius,
        held.normalised_settling_time,
    )
    axes.semilogy(radius * run.residual_time, run.kkt, color=style.INK, lw=1.2)
    axes.plot(end, held.run.tolerance, "D", color=style.VERMILION, label=f"settled after {end:.0f}")
    axes.set(ylabel="relative KKT residual", xlim=(0, 1.05 * end), ylim=(1e-7, 1e1))
    axes.tick_params(labelbottom=False)
    axes.legend(frameon=False, fontsize=8)


def draw_active(axes, time, conducting) -> None:
    """Draw a bar, in the colour of its inequality, while a constraint is active."""
    edges = [*time, time[-1]]
    seen = np.argwhere(conducting.any(axis=0))
    for place, (row, stage) in enumerate(seen):
        on = np.diff(conducting[:, row, stage].astype(int), prepend=0, append=0)
        bars = [
            (edges[a], edges[b] - edges[a]) for a, b in zip(*map(np.flatnonzero, (on > 0, on < 0)))
        ]
        axes.broken_barh(bars, (place, 0.7), color=COLOURS[row], lw=0)
    axes.set(xlabel=style.FASTEST, ylabel="active constraints", yticks=[])


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
