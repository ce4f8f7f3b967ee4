"""Tighter limits: settling time per active constraint.

Question: The steering limit of a car is an input that is tightened step by step. How much longer
          does the network settle as constraints become active?
Answer:   With six active constraints 135 unit time constants instead of 56, with 19 about 800:
          fewer controls remain to bend the path, and the slowest mode slows. Gains designed at a
          tight limit take 77 without and 78 with six active constraints. Every settled run is a
          certified optimum. At 0.3 rad half of the cars do not settle, and half of those that do
          are at optima of more than twice the lowest cost; IPOPT finds a plan for each: the network
          with fixed gains, started on a line, misses it.
Figure:   out/demos/25_tighter_limits.png
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import sympy as sp

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table
from ann_dc.study.library import tightened

LIMITS = (0.60, 0.55, 0.50, 0.45, 0.40, 0.35, 0.30)
"""Limits of the steering angle (rad); no plan exceeds the first limit."""
TARGETS = {"q_d.x": (4.0, 6.0), "q_d.y": (4.0, 6.0)}
"""Ranges of the terminal position (m)."""
CARS = 16
"""Number of samples per limit."""
GAINS = {
    "0.6 rad": (LIMITS[0], style.BLUE, "o"),
    "0.4 rad": (0.4, style.VERMILION, "s"),
}
"""Limits for which gains are designed (rad), with colour and marker."""


def car(limit: float) -> ann_dc.OptimalControlProblem:
    """Return the paper's car with a finer horizon and a limit of the steering angle."""
    psi, problem = sp.symbols("psi"), ann_dc.plants.car(N=24)
    angle = problem.states[3]
    sides = {"left": angle <= psi, "right": angle >= -psi}
    return replace(problem, inputs={psi: limit}, constraints=sides)


def main(
    out: Path | None = None,
    cars: int = CARS,
    limits: tuple[float, ...] = LIMITS,
    workers: int | None = None,
) -> dict:
    """Tighten the limit for gains of two designs; return the tables and the figure path."""
    tables = {}
    for name, (limit, *_) in GAINS.items():
        study = tightened(car(limit), {"psi": limits}, ranges=TARGETS, samples=cars)
        tables[name] = study.run(workers=workers)
        print(f"gains designed for {name}: {tables[name].outcomes}")
        for psi, part in tables[name].by("input.psi").items():
            print(f"  {psi:.2f} rad: {summary(part)}")
    figures = []
    if out is not None:
        figures.append(plotting.save(picture(tables), Path(out) / "25_tighter_limits.png"))
    return {"tables": tables, "figures": figures}


def settled(table: Table) -> np.ndarray:
    """Return True for every run that settled."""
    return table["outcome"] == "settled"


def summary(part: Table) -> str:
    """Return medians over the settled runs as text."""
    kept = settled(part)
    if not kept.any():
        return "none settled"
    time, active = (np.median(part[name][kept]) for name in ("settling_time", "active_rows"))
    medians = f"medians: {time:.0f} unit time constants, {active:g} active constraints"
    return f"{kept.sum()} of {len(part)} settled, {medians}"


def picture(tables: dict[str, Table]):
    """Draw settling time over active constraints and decay rate, and the settled fraction."""
    figure = plotting.new_figure(10.8, 4.0)
    rows, modes, shares = figure.subplots(1, 3)
    for shift, (name, table) in zip((0.01, -0.01), tables.items()):
        _, colour, marker = GAINS[name]
        dots = {"ls": "", "marker": marker, "color": colour, "ms": 4, "alpha": 0.6, "mew": 0}
        kept = settled(table)
        time = table["settling_time"][kept]
        rows.plot(table["active_rows"][kept], time, **dots, label=f"gains for {name}")
        modes.plot(table["predicted_decay_rate"][kept], time, **dots)
        parts = table.by("input.psi")
        each = [100 * settled(part).mean() for part in parts.values()]
        shares.bar(np.array([*parts]) + shift, each, width=0.018, color=colour, alpha=0.8)
    slow = np.concatenate([t["predicted_decay_rate"][settled(t)] for t in tables.values()])
    ends = np.array([slow[slow > 0].min(), slow.max()])
    modes.plot(ends, np.log(1e6) / ends, color=style.GREY, ls="--", label="ln(1e6) / rate")
    rows.set(yscale="log", xlabel="active constraints at the end", xticks=range(0, 21, 5))
    rows.set_ylabel("settling time (unit time constants)")
    modes.set(xscale="log", yscale="log", xlabel="slowest decay rate (per unit time constant)")
    shares.set(xlabel="limit of the steering angle (rad)", ylabel="settled (% of the samples)")
    shares.invert_xaxis()
    for axes in (rows, modes, shares):
        plotting.quiet(axes)
    for axes in (rows, modes):
        axes.legend(frameon=False, fontsize=8)
    plotting.headline(
        figure,
        f"{plotting.caption(car(LIMITS[0]))}, limited steering angle\n"
        f"Two networks with fixed gains; {len(tables['0.4 rad'])} runs each, random targets",
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
