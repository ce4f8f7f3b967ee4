"""One network for many inputs, and any units.

Question: Do the units of a problem matter? Does one network with fixed gains serve a range of
          initial states and targets? Which optima exist?
Answer:   A reactor in kelvin and seconds, and again in Celsius and minutes, takes the same 310
          design steps, a stiffness ratio of 3.523 and 42.9 tau_min. One unicycle, designed for
          ranges of target and heading, settles at a certified optimum for all of 300 held-out
          inputs, 99 of 100 within 80 tau_min. Sixteen initial guesses around an obstacle settle at
          both paths past it, three quarters of them at the better one.
Figure:   out/demos/12_operating_range.png: settling times of the held-out inputs;
          out/demos/12_optima.png: optima in the plane, and the fraction of guesses at each.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.families import FamilyDesign, Multistart, design_family
from ann_dc.plotting import style

RANGES = {"q_d.x": (1.0, 3.0), "q_d.y": (0.5, 2.0), "q_0.theta": (-0.5, 0.5)}
"""Operating range of the unicycle: target (m) and initial heading (rad)."""
HELD_OUT = 300
STARTS = 16
COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.ORANGE, style.PURPLE)
"""Colours of the optima, best first."""


def in_kelvin() -> ann_dc.OptimalControlProblem:
    """Return a stirred tank with Arrhenius reaction and cooling jacket, in K and s.

    The reaction is exothermic, with the rate 1.2e9/s exp(-E/(R T)) and E/R = 8750 K. The residence
    time is 60 s.
    """
    c, T, T_c = sp.symbols("c T T_c")
    rate = 1.2e9 * sp.exp(-8750 / T) * c
    return ann_dc.OptimalControlProblem(
        name="reactor", states=(c, T), controls=(T_c,),
        dynamics=((1 - c) / 60 - rate, (350 - T) / 60 + 209 * rate + (T_c - T) / 28.7),
        cost=((c - 0.5) / 0.5) ** 2 + ((T - 350) / 20) ** 2 + ((T_c - 300) / 10) ** 2,
        dt=3.0, horizon=20, q_0=(0.5, 350), q_d=(0.4, 356),
        units={"c": "kmol/m^3", "T": "K", "T_c": "K", "time": "s"},
    )  # fmt: skip


def in_celsius() -> ann_dc.OptimalControlProblem:
    """Return the same tank in Celsius, minutes and mol/m^3."""
    c, T, T_c = sp.symbols("c T T_c")
    rate = 60 * 1.2e9 * sp.exp(-8750 / (T + 273.15)) * c
    return ann_dc.OptimalControlProblem(
        name="reactor", states=(c, T), controls=(T_c,),
        dynamics=(
            1000 - c - rate,
            76.85 - T + 209 * rate / 1000 + (T_c - T) * 60 / 28.7,
        ),
        cost=((c - 500) / 500) ** 2 + ((T - 76.85) / 20) ** 2 + ((T_c - 26.85) / 10) ** 2,
        dt=0.05, horizon=20, q_0=(500, 76.85), q_d=(400, 82.85),
        units={"c": "mol/m^3", "T": "degC", "T_c": "degC", "time": "min"},
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """Problem in one set of units, with its solution."""

    problem: ann_dc.OptimalControlProblem
    solution: ann_dc.Solution

    @property
    def steps(self) -> int:
        """Number of recurrent steps to the settled point of the design."""
        return self.solution.design.first.steps

    @property
    def ratio(self) -> float:
        """Stiffness ratio radius / |abscissa| at the settled point."""
        return self.solution.spectrum.stiffness_ratio

    @property
    def settling(self) -> float:
        """Settling time from the straight line (tau_min)."""
        return self.solution.normalised_settling_time

    def __str__(self) -> str:
        coolant = self.solution["T_c"]
        unit = self.problem.unit("T_c")
        return (
            f"{self.problem.interval:>10} {self.steps:8} {self.ratio:8.4f} {self.settling:10.3f}"
            f" {self.solution.objective:11.6f}   {coolant.min():.4f} to {coolant.max():.4f} {unit}"
        )


def units() -> list[Row]:
    """Solve the reactor in two sets of units."""
    rows = []
    for problem in (in_kelvin(), in_celsius()):
        solution = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
        rows.append(Row(problem=problem, solution=solution))
    return rows


def main(out: Path | None = None, held_out: int = HELD_OUT, starts: int = STARTS) -> dict:
    """Run units, operating range and initial guesses; return results and figure paths."""
    rows = units()
    print(f"{'dt':>10} {'steps':>8} {'ratio':>8} {'settling':>10} {'objective':>11}   coolant")
    print(*rows, sep="\n")
    print("(ratio: stiffness ratio; settling: tau_min; coolant: range of T_c)")
    print(f"\noperating range of {', '.join(RANGES)} ...", flush=True)
    family = design_family(ann_dc.plants.unicycle(), RANGES, held_out=held_out)
    print(family)
    print("\nmany initial guesses ...", flush=True)
    found = ann_dc.multistart(ann_dc.plants.unicycle_soft_obstacle(N=20), starts)
    print(found)
    figures = [] if out is None else drawn(family, found, Path(out))
    return {"units": rows, "family": family, "starts": found, "figures": figures}


def drawn(family: FamilyDesign, found: Multistart, folder: Path) -> list[Path]:
    """Draw and save both figures."""
    return [
        plotting.save(plotting.family(family), folder / "12_operating_range.png"),
        plotting.save(optima(found), folder / "12_optima.png"),
    ]


def optima(found: Multistart):
    """Draw the distinct optima, and the fraction of initial guesses at each."""
    problem = found.problem
    figure = plotting.new_figure(7.6, 3.2)
    plane, fractions = figure.subplots(1, 2, width_ratios=(3, 1))
    for number, optimum in enumerate(found.optima):
        colour = COLOURS[number % len(COLOURS)]
        plane.plot(*optimum.q[:2], "o-", color=colour, ms=3, lw=1.2,
                   label=f"E = {optimum.objective:.4g}")  # fmt: skip
        fractions.barh(number, optimum.share, color=colour, height=0.5)
    obstacle_cost(plane, problem)
    plane.plot(*found.optima[0].q[:2, [0, -1]], "s", color=style.INK, ms=5)
    plane.set(
        xlabel=plotting.with_unit("x", problem.unit("x")),
        ylabel=plotting.with_unit("y", problem.unit("y")),
        aspect="equal",
    )
    plane.legend(frameon=False, fontsize=8)
    fractions.set_yticks(range(len(found)), [f"{o.objective:.4g}" for o in found.optima])
    fractions.set(xlabel="fraction of guesses", ylabel="objective E", xlim=(0, 1))
    fractions.invert_yaxis()
    for axes in (plane, fractions):
        plotting.quiet(axes)
    plotting.headline(
        figure,
        f"{plotting.caption(problem)}\n{len(found)} certified optima from {len(found.starts)} "
        "initial guesses in one batch",
    )
    return figure


def obstacle_cost(plane, problem: ann_dc.OptimalControlProblem) -> None:
    """Draw contours of the stage cost near the obstacle, for zero controls."""
    px, py = sp.symbols("x y")
    unforced = problem.cost.subs(dict.fromkeys(problem.controls, 0))
    x, y = np.meshgrid(np.linspace(-0.2, 3.2, 120), np.linspace(-0.5, 1.7, 80))
    height = sp.lambdify((px, py), unforced)(x, y)
    plane.contourf(x, y, height, levels=np.linspace(0.1, 1.0, 10), cmap="Greys", alpha=0.6)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
