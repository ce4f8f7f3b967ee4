"""Minimax objectives: one objective in terms of another.

Question: A car should reach its target with little effort on a short path. How does a network weigh
          both?
Answer: It minimises the larger of the two (equation (6)), each relative to its range between best
          and worst. Neurons that are common to all cells measure each objective and hold the level
          that none exceeds; multipliers that add up to one give the fraction of each objective in
          the cost. At equal weights both are equal. The weights are inputs, so one network with
          fixed gains gives the whole Pareto front, every point certified (`ann_dc.pareto`).
Figure:   out/demos/16_minimax.png: Pareto front with ideal and nadir, speeds along the front, and
          objectives, their level and multipliers over network time.
"""

from pathlib import Path

import numpy as np
import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style

DT, N = 0.1, 12
COLOURS = (style.BLUE, style.ORANGE)
"""Colours of the objectives."""


def car() -> ann_dc.OptimalControlProblem:
    """Return the paper's car with a near target and two objectives."""
    x, y, theta, phi, nu, eta = sp.symbols("x y theta phi nu eta")
    velocity = (-0.1 * x + sp.cos(theta) * nu, -0.1 * y + sp.sin(theta) * nu)
    effort = (nu**2 + eta**2) / 2
    return ann_dc.OptimalControlProblem(
        name="car", states=(x, y, theta, phi), controls=(nu, eta), dt=DT, horizon=N,
        dynamics=(*velocity, -0.1 * theta + sp.tan(phi) * nu, -0.1 * phi + eta),
        q_0=(0, 0, 0, 0), q_d=(3, 2, 0, 0), units={"x": "m", "y": "m"},
        # N times the sum of squared steps: the squared length of a path with equal steps
        objectives={
            "effort": effort,
            "length": N * DT**2 * (velocity[0] ** 2 + velocity[1] ** 2) + 0.02 * effort,
        },
    )  # fmt: skip


def main(out: Path | None = None, points: int = 15) -> dict:
    """Compute the front and one run of its network; return both and the figure path."""
    front = ann_dc.pareto(car(), points)
    print(front)
    run = ann_dc.OdeBackend(verify=False).run(front.design.network)
    figures = []
    if out is not None:
        figures.append(plotting.save(picture(front, run), Path(out) / "16_minimax.png"))
    return {"front": front, "run": run, "figures": figures}


def picture(front, run):
    """Draw the front, the speeds, and the common neurons over network time."""
    figure = plotting.new_figure(11, 3.7)
    plane, speeds, neurons = figure.subplots(1, 3)
    order = np.argsort(front.values[:, 0])
    tones = np.linspace(0.05, 0.85, len(front))
    draw_front(plane, front, order, tones)
    for point, tone in list(zip(order, tones))[:: max(1, len(front) // 7)]:
        speeds.step(
            DT * np.arange(N), front.controls(point)[0], where="post", color=colour_of(tone)
        )
    plotting.quiet(speeds)
    speeds.set(xlabel="time (s)", ylabel="speed (m/s)", title="speeds along the front")
    draw_neurons(neurons, front, run)
    plotting.headline(
        figure,
        f"car, effort against length: {int(front.certified.sum())} of {len(front)} "
        "points certified, one network with fixed gains",
    )
    return figure


def colour_of(tone: float):
    """Return the colour of a point by its position along the front."""
    from matplotlib import colormaps

    return colormaps["viridis"](tone)


def draw_front(axes, front, order, tones) -> None:
    """Draw effort against squared length."""
    plotting.quiet(axes)
    axes.plot(*front.values[order].T, color=style.GREY, lw=1)
    axes.scatter(*front.values[order].T, c=[colour_of(tone) for tone in tones], s=22, zorder=3)
    axes.plot(*front.ideal, "*", color=style.INK, ms=9)
    axes.annotate("ideal", front.ideal, (8, 2), textcoords="offset points", fontsize=8)
    axes.axvline(front.nadir[0], color=style.GREY, lw=0.8, ls=":")
    axes.axhline(front.nadir[1], color=style.GREY, lw=0.8, ls=":")
    axes.annotate("nadir", front.nadir, (-30, -11), textcoords="offset points", fontsize=8)
    axes.set(xlabel="effort", ylabel="squared length (m²)", title="Pareto front")


def draw_neurons(axes, front, run) -> None:
    """Draw objectives, level and multipliers at equal weights."""
    plotting.quiet(axes)
    path = run.trajectory
    time = path.time * front.design.spectrum.radius
    for name, colour in zip(front.names, COLOURS):
        axes.plot(
            time, path[f"z_J.{name}"][:, -1], color=colour, lw=1.3, label=f"multiplier, {name}"
        )
        axes.plot(time, path[f"J.{name}"][:, -1], color=colour, lw=1, ls="--", label=name)
    axes.plot(time, path["E.max"][:, -1], color=style.INK, lw=1, label="level")
    axes.set(
        xlabel=style.FASTEST, title="common neurons, equal weights", ylim=(-0.6, 1.1),
        xlim=(0, 250),
    )  # fmt: skip
    axes.legend(fontsize=7.5, frameon=False, loc="upper right")


if __name__ == "__main__":
    main(Path("out/demos"))
