"""One network for many inputs, and any units.

Question: Do the units of a problem matter? Does one network with fixed gains serve a range of
          initial states and targets? Which optima exist?
Answer:   A reactor in kelvin and seconds, and again in Celsius and minutes, takes the same 310
          design steps, a stiffness ratio of 3.523 and 42.9 tau_min. One unicycle, designed for
          ranges of target and heading, settles at a certified optimum for all of 300 held-out
          inputs, 99 of 100 within 80 tau_min. Sixteen initial guesses around an obstacle settle at
          both paths past it, three quarters of them at the better one.
Figure:   out/demos/12_one_network_for_many_inputs.png: the family, its held-out inputs;
          out/demos/12_two_ways_past.png: the optima in the plane, and how often each is met.
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

OVER = {"q_d.x": (1.0, 3.0), "q_d.y": (0.5, 2.0), "q_0.theta": (-0.5, 0.5)}
"""Metres and radians: where the unicycle is to go, and how it stands before."""
HELD_OUT = 300
STARTS = 16
COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.ORANGE, style.PURPLE)
"""Of the optima, best first."""


def in_kelvin() -> ann_dc.OptimalControlProblem:
    """A stirred tank with an exothermic Arrhenius reaction, cooled by its jacket: kelvin, seconds.

    The rate is 1.2e9/s exp(-E/(R T)) with E/R = 8750 K; the tank is filled anew in 60 s.
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
    """The same tank in Celsius and minutes, with mol/m^3, by somebody else."""
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
    """A problem as one user wrote it, and what became of it."""

    problem: ann_dc.OptimalControlProblem
    solution: ann_dc.Solution

    @property
    def steps(self) -> int:
        """Recurrent steps until the design had its settled point."""
        return self.solution.design.first.steps

    @property
    def ratio(self) -> float:
        """radius / |abscissa| at the settled point."""
        return self.solution.spectrum.stiffness_ratio

    @property
    def settling(self) -> float:
        """From the straight line, in fastest time constants."""
        return self.solution.normalised_settling_time

    def __str__(self) -> str:
        coolant = self.solution["T_c"]
        unit = self.problem.unit("T_c")
        return (
            f"{self.problem.interval:>10} {self.steps:8} {self.ratio:8.4f} {self.settling:10.3f}"
            f" {self.solution.objective:11.6f}   {coolant.min():.4f} to {coolant.max():.4f} {unit}"
        )


def units() -> list[Row]:
    """The reactor twice, in the units of two users."""
    rows = []
    for problem in (in_kelvin(), in_celsius()):
        solution = ann_dc.solve(problem, backend=ann_dc.OdeBackend(verify=False))
        rows.append(Row(problem=problem, solution=solution))
    return rows


def main(out: Path | None = None, held_out: int = HELD_OUT, starts: int = STARTS) -> dict:
    """Units, family and starts; return what was found and the paths of the pictures."""
    rows = units()
    print(f"{'dt':>10} {'steps':>8} {'ratio':>8} {'settling':>10} {'objective':>11}   coolant")
    print(*rows, sep="\n")
    print(f"\na family of {', '.join(OVER)} ...", flush=True)
    family = design_family(ann_dc.plants.unicycle(), OVER, held_out=held_out)
    print(family)
    print("\nmany starts ...", flush=True)
    found = ann_dc.multistart(ann_dc.plants.unicycle_soft_obstacle(N=20), starts)
    print(found)
    figures = [] if out is None else drawn(family, found, Path(out))
    return {"units": rows, "family": family, "starts": found, "figures": figures}


def drawn(family: FamilyDesign, found: Multistart, folder: Path) -> list[Path]:
    """Both pictures."""
    return [
        plotting.save(plotting.family(family), folder / "12_one_network_for_many_inputs.png"),
        plotting.save(ways(found), folder / "12_two_ways_past.png"),
    ]


def ways(found: Multistart):
    """The paths of the distinct optima in the plane, beside the shares of starts that they take."""
    problem = found.problem
    figure = plotting.new_figure(7.6, 3.2)
    plane, shares = figure.subplots(1, 2, width_ratios=(3, 1))
    for number, optimum in enumerate(found.optima):
        colour = COLOURS[number % len(COLOURS)]
        plane.plot(*optimum.q[:2], "o-", color=colour, ms=3, lw=1.2,
                   label=f"E = {optimum.objective:.4g}")  # fmt: skip
        shares.barh(number, optimum.share, color=colour, height=0.5)
    bump(plane, problem)
    plane.plot(*found.optima[0].q[:2, [0, -1]], "s", color=style.INK, ms=5)
    plane.set(
        xlabel=plotting.with_unit("x", problem.unit("x")),
        ylabel=plotting.with_unit("y", problem.unit("y")),
        aspect="equal",
    )
    plane.legend(frameon=False, fontsize=8)
    shares.set_yticks(range(len(found)), [f"{o.objective:.4g}" for o in found.optima])
    shares.set(xlabel="share of the starts (1)", ylabel="objective E (1)", xlim=(0, 1))
    shares.invert_yaxis()
    for axes in (plane, shares):
        plotting.quiet(axes)
    plotting.headline(
        figure,
        f"{plotting.caption(problem)}\n{len(found)} certified optima from {len(found.starts)} "
        "starts in one batch",
    )
    return figure


def bump(plane, problem: ann_dc.OptimalControlProblem) -> None:
    """What coming near the obstacle costs a stage, as contours."""
    px, py = sp.symbols("x y")
    at_rest = problem.cost.subs(dict.fromkeys(problem.controls, 0))
    x, y = np.meshgrid(np.linspace(-0.2, 3.2, 120), np.linspace(-0.5, 1.7, 80))
    height = sp.lambdify((px, py), at_rest)(x, y)
    plane.contourf(x, y, height, levels=np.linspace(0.1, 1.0, 10), cmap="Greys", alpha=0.6)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
