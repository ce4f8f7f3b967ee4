"""The network in discrete time: clock periods instead of time constants.

Question: How many steps does a switched-capacitor version take, by update order, step length and
          acceleration?
Answer:   With multilevel gains about 200 steps if all neurons move at once, slightly fewer if
          multipliers move after the primal neurons or stage by stage, with the best fixed step and
          with the adaptive step alike; 80 to 110 with Anderson acceleration. Beyond the limit 2a /
          (a^2 + b^2) nothing settles. A resistive grid adds slow modes that oscillate: 109 steps if
          multipliers move last and 967 if all move at once (149 and 1408 to a tolerance of 1e-9).
Figure:   out/demos/05_recurrent_layers.png: residual over steps; number of steps over their length.
"""

import warnings
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style

RUNS = {
    "simultaneous": (ann_dc.SIMULTANEOUS, False, style.BLUE),
    "two-phase": (ann_dc.TWO_PHASE, False, style.ORANGE),
    "stage by stage": (ann_dc.STAGE_BY_STAGE, False, style.GREEN),
    "simultaneous, Anderson": (ann_dc.SIMULTANEOUS, True, style.VERMILION),
    "two-phase, Anderson": (ann_dc.TWO_PHASE, True, style.PURPLE),
}
"""Update order, acceleration and colour of every run."""


def backend(order, accelerated: bool, step=None) -> ann_dc.RecurrentBackend:
    """Return a recurrent backend with an adaptive step, or with the given step."""
    acceleration = ann_dc.Anderson() if accelerated else None
    return ann_dc.RecurrentBackend(order=order, acceleration=acceleration, step=step, limit=2_000)


def steps_against_length(network, limit: float, fractions) -> list[int | None]:
    """Count steps to settle for fractions of the stability limit; None if not settled."""
    counts = []
    for fraction in fractions:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # steps above the limit are intended
            run = backend(ann_dc.SIMULTANEOUS, False, ann_dc.FixedStep(step=fraction * limit)).run(
                network
            )
        counts.append(run.settling_steps)
    return counts


def main(out: Path | None = None) -> dict:
    """Run every update order; return the step counts, the scan and the figure path."""
    design = ann_dc.design(ann_dc.plants.car(), preconditioner=ann_dc.PreconditionerKind.MULTILEVEL)
    network, limit = design.network, design.spectrum.largest_step
    runs = {name: backend(order, fast).run(network) for name, (order, fast, _) in RUNS.items()}
    steps = {name: run.settling_steps for name, run in runs.items()}
    fractions = np.append(np.linspace(0.15, 0.95, 17), [1.02, 1.1])
    scan = steps_against_length(network, limit, fractions)
    best = min(count for count in scan if count is not None)
    for name, count in steps.items():
        print(f"{name:24} adaptive step    {count:4} steps")
    print(f"{'simultaneous':24} best fixed step  {best:4} steps (stability limit h = {limit:.3f})")
    figures = []
    if out is not None:
        figure = picture(runs, limit, fractions, scan)
        figures.append(plotting.save(figure, Path(out) / "05_recurrent_layers.png"))
    return {
        "steps": steps,
        "best_fixed": best,
        "scan": dict(zip(fractions, scan)),
        "figures": figures,
    }


def picture(runs: dict, limit: float, fractions, scan):
    """Draw the residual over steps, and the number of steps over their length."""
    figure = plotting.new_figure(9.6, 4.2)
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    for name, (_, _, colour) in RUNS.items():
        residual = runs[name].trajectory.kkt
        left.semilogy(np.arange(len(residual)), residual, color=colour, lw=1.6, label=name)
    left.axhline(1e-6, color=style.GREY, lw=1, ls=":", label="tolerance 1e-6")
    left.set(xlabel="recurrent steps (clock periods)", ylabel="relative KKT residual")
    left.set_ylim(1e-9, 10)
    left.legend(frameon=False, fontsize=8)
    settled = [(s * limit, c) for s, c in zip(fractions, scan) if c is not None]
    unsettled = [s * limit for s, c in zip(fractions, scan) if c is None]
    right.plot(*zip(*settled), "o-", color=style.BLUE, ms=4, label="fixed step, settled")
    top = 1.1 * max(count for _, count in settled)
    right.plot(
        unsettled,
        [top] * len(unsettled),
        "x",
        color=style.VERMILION,
        label="fixed step, not settled",
    )
    right.axvline(limit, color=style.INK, lw=1, ls="--", label="stability limit 2a/(a²+b²)")
    right.axhline(
        runs["simultaneous"].settling_steps, color=style.GREEN, lw=1.2, label="adaptive step"
    )
    right.set(
        xlabel="step h (unit time constants)", ylabel="number of steps to 1e-6", ylim=(0, 1.2 * top)
    )
    right.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        plotting.quiet(axes)
    plotting.headline(
        figure, f"{plotting.caption(ann_dc.plants.car())}, as recurrent layers, fixed gains"
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
