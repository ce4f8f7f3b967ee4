"""Ten thousand settling times in continuous time.

Question: How are settling times distributed over initial states and targets, and how does a faster
          preconditioner change them?
Answer:   10,000 cars with random initial states, headings and targets run in one batch of generated
          code in a few seconds, one sample per vector lane, with individual steps. All settle. With
          a resistive grid half of the cars take 52 tau_min and 99 of 100 at most 74; with
          multilevel gains 152 and 199. Targets nearer than the design target take longest with the
          grid.
Figure:   out/demos/14_settling_times.png: histograms of settling times; median by target.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style

CARS = 10_000
KINDS = {
    ann_dc.PreconditionerKind.MULTILEVEL: style.BLUE,
    ann_dc.PreconditionerKind.RESISTIVE_GRID: style.VERMILION,
}


def random_inputs(count: int) -> dict[str, np.ndarray]:
    """Return positions within 0.5 m, headings within 0.2 rad, targets from 4 to 6 m."""
    rng = np.random.default_rng(0)
    initial = {name: rng.uniform(-0.5, 0.5, count) for name in ("q_0.x", "q_0.y")}
    target = {name: rng.uniform(4, 6, count) for name in ("q_d.x", "q_d.y")}
    return {**initial, "q_0.phi": rng.uniform(-0.2, 0.2, count), **target}


def main(out: Path | None = None, cars: int = CARS) -> dict:
    """Run all cars with two preconditioners; return the batches and the figure path."""
    problem, batches, times, rates = ann_dc.plants.car(), {}, {}, {}
    inputs = random_inputs(cars)
    for kind in KINDS:
        design = ann_dc.design(problem, preconditioner=[kind])
        network = design.network
        ann_dc.OdeBackend().run_batch(network, {})  # compile before the timing
        began = time.perf_counter()
        batches[kind] = ann_dc.OdeBackend().run_batch(network, inputs)
        rates[kind] = cars / (time.perf_counter() - began)
        times[kind] = batches[kind].settling_times * design.spectrum.radius
        print(f"{kind.value}: {batches[kind]}; {rates[kind]:.0f} networks/s")
        quantiles = np.nanpercentile(times[kind], [50, 99])
        print("  settling time (tau_min): median {:.1f}, 99 % quantile {:.1f}".format(*quantiles))
    figures = []
    if out is not None:
        figure = picture(problem, batches, times)
        figures.append(plotting.save(figure, Path(out) / "14_settling_times.png"))
    return {"batches": batches, "times": times, "rates": rates, "figures": figures}


def picture(problem, batches, times):
    """Draw histograms of settling times, and the median by target (resistive grid)."""
    figure = plotting.new_figure(9.6, 4.2)
    left, right = figure.subplots(1, 2)
    edges = np.linspace(0, max(np.nanmax(each) for each in times.values()), 81)
    for (kind, colour), batch in zip(KINDS.items(), batches.values()):
        settled = int(batch.settled.sum())
        label = f"{kind.value}: {settled} of {len(batch)} settled"
        left.hist(times[kind], edges, color=colour, alpha=0.7, label=label)
    left.set(xlabel="settling time (tau_min)", ylabel="number of cars")
    left.set_ylim(0, 1.2 * left.get_ylim()[1])  # space for the legend
    left.set_title("to a relative KKT residual of 1e-6", fontsize=9)
    left.legend(frameon=False, fontsize=8)
    grid, settling = (
        batches[ann_dc.PreconditionerKind.RESISTIVE_GRID],
        times[ann_dc.PreconditionerKind.RESISTIVE_GRID],
    )
    x, y = (grid.inputs[f"q_d.{name}"][:, 0] for name in ("x", "y"))
    tiles = right.hexbin(x, y, settling, gridsize=25, reduce_C_function=np.median, cmap="viridis")
    right.plot(5, 5, "o", color=style.VERMILION, ms=6, label="design target")
    right.set(xlabel="target x (m)", ylabel="target y (m)", aspect="equal")
    right.set_title("resistive grid, median by target", fontsize=9)
    right.legend(frameon=True, fontsize=8, loc="lower left")
    figure.colorbar(tiles, ax=right, label="settling time (tau_min)")
    plotting.quiet(left)
    plotting.headline(
        figure,
        f"{plotting.caption(problem)}\n"
        f"Fixed gains, {len(grid)} random initial states and targets, integrated in one batch",
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
