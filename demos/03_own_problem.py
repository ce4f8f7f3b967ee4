"""A problem of your own: a model boat across a brook.

Question: Which declarations does a problem outside the library need?
Answer:   Its symbols, the equation of motion, the cost and both boundary conditions: twenty lines.
          The network settles at a certified optimum: the boat crosses almost at right angles,
          drifts with the current, and moors 2 m downstream with its bow upstream.
Figure:   out/demos/03_crossing.png: plan view; out/demos/03_boat/: four figures of the solution.
"""

from pathlib import Path

import numpy as np
import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style

WIDTH, CURRENT = 4.0, 1.2  # width (m); current in the middle (m/s)


def boat() -> ann_dc.OptimalControlProblem:
    """Return a smooth Zermelo problem: position, heading theta, parabolic current."""
    x, y, theta, thrust, rudder = sp.symbols("x y theta thrust rudder")
    flow = CURRENT * 4 * y * (WIDTH - y) / WIDTH**2
    return ann_dc.OptimalControlProblem(
        name="boat",
        states=(x, y, theta),
        controls=(thrust, rudder),
        dynamics=(thrust * sp.cos(theta) + flow, thrust * sp.sin(theta), rudder),
        cost=thrust**2 / 2 + rudder**2 / 2,
        dt=0.15,
        horizon=24,
        q_0=(0, 0, sp.pi / 2),
        q_d=(2, WIDTH, sp.pi),
        units={"x": "m", "y": "m", "theta": "rad", "thrust": "m/s", "rudder": "rad/s"},
    )


def main(out: Path | None = None) -> dict:
    """Solve the crossing; return the result as a dictionary and the figure paths."""
    solution = ann_dc.solve(boat())
    print(solution)
    pictures = []
    if out is not None:
        pictures = plotting.save_all(solution, Path(out) / "03_boat")
        pictures.append(plotting.save(crossing(solution), Path(out) / "03_crossing.png"))
    return {"solution": solution.as_dict(), "figures": pictures}


def crossing(solution: ann_dc.Solution):
    """Draw the brook in plan view: current, path and heading."""
    figure = plotting.new_figure(6.4, 5.0)
    axes = figure.subplots()
    x, y, theta = (solution[name] for name in ("x", "y", "theta"))
    banks = np.linspace(0, WIDTH, 9)[1:-1]
    left = x.min() - 1.6
    speed = CURRENT * 4 * banks * (WIDTH - banks) / WIDTH**2
    axes.axhspan(0, WIDTH, color="#EAF3F9", zorder=0)
    axes.quiver(np.full(7, left), banks, speed, 0 * banks, color=style.SKY, scale=9, width=0.006)
    axes.plot([], [], color=style.SKY, lw=2, label=f"current, at most {CURRENT} m/s")
    axes.quiver(
        x, y, np.cos(theta), np.sin(theta), color=style.ORANGE, scale=16, width=0.006, zorder=2
    )
    axes.plot([], [], color=style.ORANGE, lw=2, label="heading theta")
    axes.plot(x, y, "o-", color=style.BLUE, ms=4, label="network")
    axes.plot(
        *solution.certificate.rollout[:2],
        "--",
        color=style.INK,
        lw=1,
        label="simulation (discrete time)",
    )
    axes.set(xlabel="downstream x (m)", ylabel="across y (m)", ylim=(-0.4, WIDTH + 0.4))
    axes.set_aspect("equal", adjustable="datalim")
    plotting.quiet(axes)
    figure.legend(loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    plotting.headline(figure, plotting.title(solution))
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
