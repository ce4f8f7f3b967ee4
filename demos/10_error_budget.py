"""Error budget: the parts that decide the control error.

Question: Which offsets, gains and tolerances make the controls wrong, and is that known without a
          simulation?
Answer:   One backward sweep over the circuit's equations gives the sensitivity to every part. For
          OPA192 and AD734 with 0.1 % resistors the offsets of the multipliers give half of the
          variance, then resistors, then multiplier gains; op-amp offsets do not matter. Forty drawn
          circuits in ngspice have the errors that the emulation predicts, each to better than 0.2
          %.
Figure:   out/demos/10_error_budget.png: largest contributions; predicted and simulated samples.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.analysis import equilibrium
from ann_dc.fidelity import (
    Item,
    budget,
    measured_errors,
    predicted_errors,
    sensitivity,
    total_error,
)
from ann_dc.hardware.emulation import emulate, emulated_state
from ann_dc.hardware.parts import Kind
from ann_dc.plotting import style

PARTS = "opa192_ad734"
SAMPLES = 40
COLOURS = {
    Kind.RESISTOR: style.BLUE,
    Kind.OFFSET: style.VERMILION,
    Kind.GAIN: style.GREEN,
    Kind.PRODUCT_OFFSET: style.ORANGE,
}
NAMES = {
    Kind.RESISTOR: "resistor",
    Kind.OFFSET: "op-amp offset",
    Kind.GAIN: "multiplier gain",
    Kind.PRODUCT_OFFSET: "multiplier offset",
}


@dataclass(frozen=True)
class Sampled:
    """Control error of every sample, predicted by emulation and measured in ngspice."""

    predicted: np.ndarray
    measured: np.ndarray


def largest_of_each(items: tuple[Item, ...], count: int = 4) -> tuple[Item, ...]:
    """Return the largest contributions of every kind, by fraction of the variance."""
    kept = {kind: [i for i in items if i.parameter.kind is kind][:count] for kind in COLOURS}
    return tuple(item for item in items if item in kept[item.parameter.kind])


def main(out: Path | None = None, samples: int = SAMPLES) -> dict:
    """Compute the budget and the samples; return both and the path of the figure."""
    network = ann_dc.design(
        ann_dc.plants.car(), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    ).network
    level = ann_dc.presets.get(PARTS)
    circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    emulation = emulate(circuit, level)
    x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    found = sensitivity(emulation, x)
    items = budget(found, level.tolerances)
    total = total_error(found, level.tolerances)
    shares = {k: sum(i.share for i in items if i.parameter.kind is k) for k in COLOURS}
    for kind, share in sorted(shares.items(), key=lambda pair: -pair[1]):
        print(f"{NAMES[kind]:18} {share:6.1%} of the variance")
    print(f"standard deviation of the worst control {total:.1e} (relative to the largest control)")
    seeds = range(samples)
    drawn = Sampled(
        predicted_errors(circuit, level, probe, seeds),
        measured_errors(circuit, level, probe, seeds),
    )
    off = np.abs(drawn.predicted / drawn.measured - 1).max()
    print(f"{samples} samples in ngspice: median control error {np.median(drawn.measured):.1e}; "
          f"largest deviation of the emulation {off:.2%}")  # fmt: skip
    figures = []
    if out is not None:
        figure = picture(largest_of_each(items), drawn)
        figures.append(plotting.save(figure, Path(out) / "10_error_budget.png"))
    return {"shares": shares, "total": total, "samples": drawn, "figures": figures}


def picture(items: tuple[Item, ...], drawn: Sampled):
    """Draw the largest contributions, and predicted and measured errors of samples."""
    figure = plotting.new_figure(10.0, 4.6)
    bars, scatter = figure.subplots(1, 2, width_ratios=(3, 2))
    rows = np.arange(len(items))[::-1]
    for kind in dict.fromkeys(item.parameter.kind for item in items):
        chosen = [(row, item) for row, item in zip(rows, items) if item.parameter.kind is kind]
        bars.barh([row for row, _ in chosen], [1e3 * item.error for _, item in chosen],
                  color=COLOURS[kind], label=NAMES[kind], height=0.7)  # fmt: skip
    names = [f"{i.parameter.meaning}, {size(i)}" for i in items]
    bars.set_yticks(rows, names, fontsize=7)
    bars.set(xlabel="control error (1e-3 of the largest control), one part in all cells",
             title="four largest of every kind, by fraction of the variance")  # fmt: skip
    top = 1.1e3 * max(drawn.predicted.max(), drawn.measured.max())
    scatter.plot([0, top], [0, top], color=style.GREY, lw=1, ls="--", label="equal")
    scatter.plot(1e3 * drawn.predicted, 1e3 * drawn.measured, "o", ms=5, mfc="none",
                 color=style.INK, label="circuit instance, all errors drawn")  # fmt: skip
    scatter.set(xlabel="predicted by emulation (1e-3)", ylabel="ngspice (1e-3)",
                title="control error (relative to the largest)",
                xlim=(0, top), ylim=(0, top))  # fmt: skip
    for axes in (bars, scatter):
        plotting.quiet(axes)
        axes.title.set_fontsize(9)
        axes.legend(frameon=False, fontsize=8, loc="lower right")
    bars.tick_params(axis="y", labelsize=7)
    plotting.headline(
        figure, f"{plotting.caption(ann_dc.plants.car())}, with OPA192, AD734 and 0.1 % resistors"
    )
    return figure


def size(item: Item) -> str:
    """Return the assumed standard deviation with its unit."""
    if item.parameter.kind.unit == "V":
        return f"{1e3 * item.size:g} mV"
    return f"{item.size:.1%}"


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
