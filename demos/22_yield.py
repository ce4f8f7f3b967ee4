"""Yield curve of boards with part errors.

Question: A thousand boards have parts with errors. On how many are the controls within 2 % after 50
          us, and which parameter decides?
Answer:   On all of 60 with errors of 0.1 % and 0.1 mV. With resistors of 0.4 % the yield is 100 %,
          with 1 % it is about a half; with multiplier gains of 1 % or op-amp offsets of 1 mV it is
          three quarters. Speed is a threshold: with op amps of 8.8 MHz every board is too slow,
          with 9 MHz none. The bandwidth margin may be 6.7 to 11.6: boards oscillate below and are
          too slow above. Eight boards in ngspice have the predicted errors to 0.01 % and settling
          times to 0.3 %; the slowest mode, used here without a run, is conservative by a quarter.
Figure:   out/demos/22_yield.png
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table, Yield
from ann_dc.study.library import BOARD, FIGURES, SPEC, spot_check, yield_curves

BOARDS = 60
"""Number of circuit instances per value."""
CHECKED = 8
"""Number of samples that ngspice simulates in addition."""
CLOSER = {
    "circuit.a0": (5e2, 1e3, 1.2e3, 1.4e3, 1.7e3, 3e3, 1e4, 1e6),
    "circuit.gbw": (6e6, 8e6, 8.8e6, 8.9e6, 9e6, 9.2e6, 10e6, 14e6),
    "circuit.bandwidth_margin": (
        5.0,
        6.0,
        6.5,
        6.6,
        6.7,
        6.8,
        6.9,
        8.0,
        10.0,
        11.4,
        11.6,
        11.7,
        11.8,
        12.0,
        13.0,
    ),
}
"""Finer values of the settings for which the yield changes abruptly."""
PANELS = {
    "tolerance of resistors and multipliers (%)": {
        "tolerance.resistor": ("resistors", 100),
        "tolerance.gain": ("multiplier gains", 100),
    },
    "offset voltage (mV)": {
        "tolerance.offset": ("op amps", 1e3),
        "tolerance.product_offset": ("multipliers", 1e3),
    },
    "open-loop gain of the op amps (V/V)": {"circuit.a0": ("", 1)},
    "gain-bandwidth product (MHz)": {"circuit.gbw": ("", 1e-6)},
    "bandwidth margin (relative to the fastest rate)": {"circuit.bandwidth_margin": ("", 1)},
}
"""Settings by axis label, with label in the legend and factor of the unit."""
LINEAR = ("circuit.gbw", "circuit.bandwidth_margin")
"""Settings with a linear axis."""
COLOURS = (style.BLUE, style.VERMILION)


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """Results of the same circuit instances, emulated and simulated in ngspice."""

    emulated: Table
    simulated: Table

    def off(self, metric: str) -> np.ndarray:
        """Return the differences of a metric, relative to ngspice."""
        return np.abs(self.emulated[metric] / self.simulated[metric] - 1)


def main(
    out: Path | None = None,
    boards: int = BOARDS,
    checked: int = CHECKED,
    figures: dict | None = None,
    workers: int | None = None,
) -> dict:
    """Run circuit instances for every setting, some in ngspice; return yields and figure path."""
    studies = yield_curves("car", samples=boards, figures=figures or FIGURES | CLOSER)
    tables = {}
    for name, study in studies.items():
        print(f"{name}: {len(study)} circuit instances ...", flush=True)
        tables[name] = study.run(workers=workers)
    curves = {name: curve(name, table) for name, table in tables.items()}
    for name, found in curves.items():
        for value, share in found.items():
            print(f"{name:26} {value:8g}  {share}")
    both = spot_check("car", samples=checked).run(workers=workers).by("run.backend")
    spot = Comparison(emulated=both["emulation"], simulated=both["spice"])
    for metric in ("control_error", "seconds"):
        print(
            f"{checked} samples in ngspice: {metric} differs by at most "
            f"{spot.off(metric).max():.2%}"
        )
    pictures = []
    if out is not None:
        path = Path(out) / "22_yield.png"
        pictures.append(plotting.save(picture(curves, spot, boards), path))
    return {"tables": tables, "curves": curves, "spot": spot, "figures": pictures}


def curve(name: str, table: Table) -> dict[float, Yield]:
    """Compute the yield at every value of a setting."""
    return {value: part.yield_of() for value, part in table.by(name).items()}


def picture(curves: dict, spot: Comparison, boards: int):
    """Draw five panels of yields with intervals, and the samples simulated in ngspice."""
    figure = plotting.new_figure(10.8, 6.4)
    panels = figure.subplots(2, 3).ravel()
    for axes, (label, settings) in zip(panels, PANELS.items()):
        found = [(name, look) for name, look in settings.items() if name in curves]
        for colour, (name, (legend, factor)) in zip(COLOURS, found):
            draw_yield(axes, curves[name], factor, colour, legend)
            axes.axvline(factor * float(BOARD[name]), color=style.GREY, lw=0.8, ls=":")
            axes.set_xscale("linear" if name in LINEAR else "log")
        axes.set(xlabel=label, ylim=(-3, 105))
        if len(found) > 1:
            axes.legend(frameon=False, fontsize=8)
    for axes in panels[::3]:
        axes.set_ylabel("yield (% of the samples)")
    draw_comparison(panels[5], spot)
    for axes in panels:
        plotting.quiet(axes)
    error, seconds = SPEC["control_error"], SPEC["slowest_mode_seconds"]
    plotting.headline(
        figure,
        f"{plotting.caption(ann_dc.plants.car())}: circuit instances with controls within "
        f"{error:.0%} after {1e6 * seconds:.0f} µs\n{boards} samples per value, equal seeds; "
        "bands: 95 % confidence intervals; dotted: value in the other panels",
    )
    return figure


def draw_yield(axes, found: dict[float, Yield], factor: float, colour: str, label: str) -> None:
    """Draw a yield curve with its 95 % confidence band."""
    values = factor * np.array([*found])
    low, share, high = (
        [100 * getattr(each, name) for each in found.values()] for name in ("low", "share", "high")
    )
    axes.fill_between(values, low, high, color=colour, alpha=0.2, lw=0)
    axes.plot(values, share, "o-", color=colour, ms=4, lw=1.4, label=label)


def draw_comparison(axes, spot: Comparison) -> None:
    """Draw control error and settling time of every sample, emulated and in ngspice."""
    for metric, factor, colour, marker, label in (
        ("control_error", 1e3, style.GREEN, "o", "control error (1e-3 of largest)"),
        ("seconds", 1e6, style.PURPLE, "s", "settling time to 0.1 % (µs)"),
    ):
        axes.plot(
            factor * spot.emulated[metric], factor * spot.simulated[metric], marker,
            ms=6, mfc="none", color=colour, label=label,
        )  # fmt: skip
    axes.axline((1, 1), slope=1, color=style.GREY, lw=1, ls="--", zorder=0)
    axes.set(xscale="log", yscale="log", xlim=(1, 100), ylim=(1, 100))
    axes.set(xlabel="emulation", ylabel=f"ngspice, the same {len(spot.emulated)} samples")
    axes.legend(frameon=False, fontsize=8)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
