"""Settling against the number of stages, 9 to 1152.

Question: How does settling grow with N for the same manoeuvre in finer stages, and what does a
          processor need per unit of network time?
Answer:   With cyclic reduction the car takes 47 to 55 tau_min for all N and multilevel 124 to 157:
          exponents of -0.03 (95 % interval -0.04 to -0.01) and -0.03 (-0.07 to 0.01). With diagonal
          gains and the penalty of nine stages settling grows as N^2.26 (1.94 to 2.58); designed for
          every N, as N^1.08 (0.90 to 1.26) for the double integrator and N^1.03 (0.75 to 1.30) for
          the car, which does not settle within 20,000 tau_min beyond 48 stages. Computing time per
          tau_min is proportional to the cells from 36 stages on: N^1.03 (0.89 to 1.18) and N^1.01
          (0.85 to 1.17) on one core; these exponents vary by 0.1 between runs.
Figure:   out/demos/19_settling_against_stages.png
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Exponent, exponent_of
from ann_dc.study.library import SIZES, median_rho, settling_against_horizon

KINDS = {
    "cyclic-reduction": ("cyclic reduction", style.GREEN, "v"),
    "multilevel": ("multilevel", style.BLUE, "o"),
    "diagonal": ("diagonal", style.VERMILION, "s"),
    "kept": ("diagonal, rho of N = 9", style.PURPLE, "D"),
}
"""Label, colour and marker by preconditioner; "kept": the penalty is not designed for N."""
PLANTS = {"car": "-", "double_integrator": "--"}
"""Line styles of the plants."""
STAGES = {
    ("car", "cyclic-reduction"): SIZES,
    ("car", "multilevel"): SIZES,
    ("car", "diagonal"): (9, 12, 18, 24, 36, 48, 72),
    ("double_integrator", "cyclic-reduction"): (9, 18, 36, 72, 144, 288, 576),
    ("double_integrator", "multilevel"): (9, 18, 36, 72, 144, 288, 576),
    ("double_integrator", "diagonal"): (9, 18, 36, 72, 144),
    ("double_integrator", "kept"): (9, 12, 18, 24, 36),
}
"""Numbers of stages N by plant and preconditioner."""
LARGE = 36
"""Number of stages from which the cells dominate the computing time."""


class Series(NamedTuple):
    """Results of one plant and preconditioner over N; nan if not settled.

    Attributes
    ----------
    sizes : (S,) array
        Numbers of stages N.
    settling : (S,) array
        Settling time to 1e-6 (tau_min).
    computing : (S,) array
        Computing time per tau_min (s).
    grows : Exponent
        Power of N of the settling time.
    costs : Exponent
        Power of N of the computing time, from `LARGE` on.
    """

    sizes: np.ndarray
    settling: np.ndarray
    computing: np.ndarray
    grows: Exponent
    costs: Exponent


def series(plant: str, kind: str, sizes: Sequence[int]) -> Series:
    """Run the studies of one plant with one preconditioner."""
    studies = settling_against_horizon(
        plant,
        sizes=sizes,
        preconditioner="diagonal" if kind == "kept" else kind,
        rho=rho_of_nine(plant) if kind == "kept" else None,
    )
    tables = [study.run(workers=0) for study in studies.values()]
    settling, computing = (
        np.array([table[name][0] for table in tables])
        for name in ("normalised_settling_time", "computing_time")
    )
    large = np.array(sizes) >= LARGE
    costs = exponent_of(np.array(sizes)[large], computing[large])
    found = Series(np.array(sizes), settling, computing, exponent_of(sizes, settling), costs)
    reported = ", ".join(f"{N}: {time:.0f}" for N, time in zip(sizes, settling))
    print(f"{plant}, {KINDS[kind][0]}: {reported}", flush=True)
    print(f"  settling time ~ N^{found.grows}, computing time per tau_min ~ N^{costs}")
    return found


def rho_of_nine(plant: str) -> float:
    """Return the penalty designed for nine stages with the diagonal preconditioner."""
    problem = ann_dc.plants.get(plant)()
    nine = dataclasses.replace(problem.with_horizon(9), dt=problem.horizon * problem.dt / 9)
    return median_rho(
        ann_dc.design(nine, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    )


def main(
    out: Path | None = None,
    stages: Mapping[tuple[str, str], Sequence[int]] = STAGES,
) -> dict:
    """Run every plant with every preconditioner; return the series and the figure path."""
    found = {(p, kind): series(p, kind, sizes) for (p, kind), sizes in stages.items()}
    figures = []
    if out is not None:
        figures.append(plotting.save(picture(found), Path(out) / "19_settling_against_stages.png"))
    return {"series": found, "figures": figures}


def picture(found: dict[tuple[str, str], Series]):
    """Draw settling time, and computing time per tau_min, over N."""
    figure = plotting.new_figure(10.4, 4.8)
    left, right = figure.subplots(1, 2)
    for (plant, kind), one in found.items():
        label, colour, mark = KINDS[kind]
        look = {"color": colour, "marker": mark, "ls": PLANTS.get(plant, "-"), "ms": 5, "lw": 1.3,
                 "mec": "white"}  # fmt: skip
        name = f"{plant.replace('_', ' ')}, {label}"
        left.plot(one.sizes, one.settling, label=f"{name}{power(one.grows)}", **look)
        lost = one.sizes[~np.isfinite(one.settling)]
        left.plot(lost, np.full(len(lost), 2e4), "x", color=colour, ms=7)
        right.plot(one.sizes, 1e3 * one.computing, label=f"{name}{power(one.costs)}", **look)
    left.plot([], [], "x", color=style.INK, label="not settled in 20 000 tau_min")
    one = np.array([150.0, 1000.0])
    right.plot(one, 1e-5 * one, color=style.INK, lw=1, ls=":", label="proportional to N")
    left.set(ylabel="settling time to 1e-6 (tau_min)", ylim=(20, 3e4))
    left.set_title("settling time of the network", fontsize=9)
    right.set(ylabel="computing time (ms per tau_min)")
    right.set_title("computing time of the integration, one core", fontsize=9)
    for axes in (left, right):
        axes.set(xscale="log", yscale="log", xlabel="number of stages N (same final time)")
        axes.legend(frameon=False, fontsize=7.5, loc="upper left", bbox_to_anchor=(0, -0.16))
        plotting.quiet(axes)
        ticks = SIZES
        axes.set_xticks(ticks, [str(N) for N in ticks])
        axes.minorticks_off()
    plotting.headline(figure, "Fixed final time divided into N stages; gains designed for each N")
    return figure


def power(exponent: Exponent) -> str:
    """Return the power of N for a legend; empty if its interval is 1 wide or more."""
    return f": N^{exponent}" if exponent.high - exponent.low < 1 else ""


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
