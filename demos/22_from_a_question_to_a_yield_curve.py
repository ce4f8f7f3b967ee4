"""Yield curve of boards with part errors.

Question: A thousand boards have parts with errors. On how many are the controls within 2 % after 50
          us, and which figure decides?
Answer:   With errors of 0.1 % and 0.1 mV on all of 60. Resistors of 0.4 % lose no board, of 1 %
          half of them; multiplier gains of 1 % leave three of four, as do op-amp offsets of 1 mV.
          Speed is sharp: with op amps of 8.8 MHz every board is too slow, with 9 MHz none. The
          bandwidth margin may be 6.7 to 11.6: below, boards oscillate; above, they are slow. Eight
          boards in ngspice have the predicted errors to 0.01 % and settling times to 0.3 %; the
          slowest mode, used here without a run, is conservative by a quarter.
Figure:   out/demos/22_from_a_question_to_a_yield_curve.png
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table, Yield
from ann_dc.study.shipped import BOARD, FIGURES, SPEC, spot_check, yield_curves

BOARDS = 60
CHECKED = 8
"""Boards that ngspice runs, too."""
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
"""Figures that decide at once, looked at where they do."""
PANELS = {
    "errors of resistors and multipliers (%)": {
        "tolerance.resistor": ("resistors", 100),
        "tolerance.gain": ("multiplier gains", 100),
    },
    "offsets (mV)": {
        "tolerance.offset": ("of op amps", 1e3),
        "tolerance.product_offset": ("of multipliers", 1e3),
    },
    "open-loop gain of the op amps (1)": {"circuit.a0": ("", 1)},
    "gain-bandwidth product (MHz)": {"circuit.gbw": ("", 1e-6)},
    "bandwidth over the network's fastest rate (1)": {"circuit.bandwidth_margin": ("", 1)},
}
"""What stands on an axis: settings, their word in the legend, and the factor of the unit."""
LINEAR = ("circuit.gbw", "circuit.bandwidth_margin")
COLOURS = (style.BLUE, style.VERMILION)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """The same boards twice, a value each."""

    emulated: Table
    simulated: Table

    def off(self, metric: str) -> np.ndarray:
        """How far the emulation is from ngspice, relative."""
        return np.abs(self.emulated[metric] / self.simulated[metric] - 1)


def main(
    out: Path | None = None,
    boards: int = BOARDS,
    checked: int = CHECKED,
    figures: dict | None = None,
    workers: int | None = None,
) -> dict:
    """Draw boards for every figure, and a few for ngspice; return yields, boards, picture."""
    studies = yield_curves("car", samples=boards, figures=figures or FIGURES | CLOSER)
    tables = {}
    for name, study in studies.items():
        print(f"{name}: {len(study)} boards ...", flush=True)
        tables[name] = study.run(workers=workers)
    curves = {name: curve(name, table) for name, table in tables.items()}
    for name, found in curves.items():
        for value, share in found.items():
            print(f"{name:26} {value:8g}  {share}")
    both = spot_check("car", samples=checked).run(workers=workers).by("run.backend")
    spot = Spot(emulated=both["emulation"], simulated=both["spice"])
    for metric in ("control_error", "seconds"):
        print(f"{checked} boards in ngspice: {metric} at most {spot.off(metric).max():.2%} off")
    pictures = []
    if out is not None:
        path = Path(out) / "22_from_a_question_to_a_yield_curve.png"
        pictures.append(plotting.save(picture(curves, spot, boards), path))
    return {"tables": tables, "curves": curves, "spot": spot, "figures": pictures}


def curve(name: str, table: Table) -> dict[float, Yield]:
    """The yield at every value of a figure."""
    return {value: part.yield_of() for value, part in table.by(name).items()}


def picture(curves: dict, spot: Spot, boards: int):
    """Five panels of yields with their intervals, and the boards that ngspice ran."""
    figure = plotting.new_figure(10.8, 6.4)
    panels = figure.subplots(2, 3).ravel()
    for axes, (label, settings) in zip(panels, PANELS.items()):
        found = [(name, look) for name, look in settings.items() if name in curves]
        for colour, (name, (word, factor)) in zip(COLOURS, found):
            drawn(axes, curves[name], factor, colour, word)
            axes.axvline(factor * float(BOARD[name]), color=style.GREY, lw=0.8, ls=":")
            axes.set_xscale("linear" if name in LINEAR else "log")
        axes.set(xlabel=label, ylim=(-3, 105))
        if len(found) > 1:
            axes.legend(frameon=False, fontsize=8)
    for axes in panels[::3]:
        axes.set_ylabel("yield (% of the boards)")
    beside(panels[5], spot)
    for axes in panels:
        plotting.quiet(axes)
    error, seconds = SPEC["control_error"], SPEC["slowest_mode_seconds"]
    plotting.headline(
        figure,
        f"{plotting.caption(ann_dc.plants.car())}: boards whose controls are within {error:.0%} "
        f"after {1e6 * seconds:.0f} µs\n{boards} boards at every value, the same draws at each; "
        "bands: 95 % intervals; dotted: what the other panels have",
    )
    return figure


def drawn(axes, found: dict[float, Yield], factor: float, colour: str, word: str) -> None:
    """One yield curve with the band that its samples do not contradict."""
    values = factor * np.array([*found])
    low, share, high = (
        [100 * getattr(each, name) for each in found.values()] for name in ("low", "share", "high")
    )
    axes.fill_between(values, low, high, color=colour, alpha=0.2, lw=0)
    axes.plot(values, share, "o-", color=colour, ms=4, lw=1.4, label=word)


def beside(axes, spot: Spot) -> None:
    """Error and settling time of every board, emulated and in ngspice."""
    for metric, factor, colour, marker, word in (
        ("control_error", 1e3, style.GREEN, "o", "error of the controls (1e-3)"),
        ("seconds", 1e6, style.PURPLE, "s", "settling to 0.1 % (µs)"),
    ):
        axes.plot(
            factor * spot.emulated[metric], factor * spot.simulated[metric], marker,
            ms=6, mfc="none", color=colour, label=word,
        )  # fmt: skip
    axes.axline((1, 1), slope=1, color=style.GREY, lw=1, ls="--", zorder=0)
    axes.set(xscale="log", yscale="log", xlim=(1, 100), ylim=(1, 100))
    axes.set(xlabel="emulated", ylabel=f"ngspice, the same {len(spot.emulated)} boards")
    axes.legend(frameon=False, fontsize=8)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
