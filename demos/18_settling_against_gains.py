"""Settling against every gain, over four decades.

Question: How good are the designed gains, how much slower is a wrong one, and does the spectrum
          predict it?
Answer:   On all eighteen curves (rho and the time constants of five populations, three
          preconditioners, thirteen factors each) the designed value settles first: 51 tau_min with
          a resistive grid, 153 multilevel, 347 diagonal. States or targets twice as slow as
          designed cost the grid a factor of nine to eleven and multilevel 5 %; a hundred times as
          slow, 40 %. Measured settling is 0.59 to 1.13 of the spectrum's prediction, half of the
          runs within 11 %. The spectrum also predicts where the optimum becomes unstable: below
          0.03 of rho with multilevel or diagonal gains, below 0.48 with a grid. It describes the
          neighbourhood of the optimum only: with diagonal gains and targets 20 to 50 times as slow
          the optimum is stable, but the run from the straight line does not reach it. Runs above
          1e5 tau_min are ended.
Figure:   out/demos/18_settling_against_gains.png
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table
from ann_dc.study.library import FACTORS, boundaries, settling_against_gains

KINDS = {
    "resistive-grid": ("resistive grid", style.GREEN, "v"),
    "multilevel": ("multilevel", style.BLUE, "o"),
    "diagonal": ("diagonal", style.VERMILION, "s"),
}
"""Label, colour and marker of every preconditioner."""
NAMES = {
    "rho": "penalty rho",
    "tau.q": "time constants of q (states)",
    "tau.u": "time constants of u (controls)",
    "tau.t": "time constants of t (targets)",
    "tau.mu": "time constants of mu (multipliers of the dynamics)",
    "tau.beta": "time constants of beta (multipliers of the coupling)",
}
"""Labels of the gains."""
TOP = 1e5
"""Upper end of the settling-time axis (tau_min)."""


def main(
    out: Path | None = None,
    subject: str = "car",
    kinds: Sequence[str] = tuple(KINDS),
    factors: Sequence[float] = FACTORS,
    gains: Sequence[str] | None = None,
    workers: int | None = None,
) -> dict:
    """Run a study for every preconditioner and gain; return tables, boundaries, figure path."""
    tables: dict[str, dict[str, Table]] = {}
    found: dict[str, dict[str, tuple[float, ...]]] = {}
    for kind in kinds:
        studies = settling_against_gains(subject, preconditioner=kind, factors=factors, gains=gains)
        tables[kind] = {gain: study.run(workers=workers) for gain, study in studies.items()}
        found[kind] = {gain: boundaries(table, gain) for gain, table in tables[kind].items()}
        print(as_text(kind, tables[kind], found[kind]))
    figures = []
    if out is not None:
        figure = picture(subject, tables, found)
        figures.append(plotting.save(figure, Path(out) / "18_settling_against_gains.png"))
    return {"tables": tables, "boundaries": found, "figures": figures}


def as_text(kind: str, tables: dict[str, Table], found: dict[str, tuple[float, ...]]) -> str:
    """Return settling times, measured over predicted, and stability boundaries as text."""
    lines = [f"{KINDS[kind][0]}: settling time to 1e-6 (tau_min), designed gain and best factor"]
    for gain, table in tables.items():
        factors, times = table[f"gains.{gain}"], table["normalised_settling_time"]
        ratio = times / table["settling_by_spectrum"]
        ratio = ratio[np.isfinite(ratio)]
        best, designed = np.nanargmin(times), np.argmin(np.abs(np.log(factors)))
        edges = ", ".join(f"{edge:.3g}" for edge in found[gain])
        lines.append(
            f"  {NAMES.get(gain, gain):48} {times[designed]:6.0f} {times[best]:6.0f} at "
            f"{factors[best]:5.3g};  measured / predicted {ratio.min():.2f} to {ratio.max():.2f}, "
            f"{len(ratio)} of {len(table)} settled" + (f"; unstable below {edges}" if edges else "")
        )
    return "\n".join(lines)


def picture(subject: str, tables: dict, found: dict):
    """Draw a panel per gain: predicted lines, measured markers, crosses if not settled."""
    gains = [*next(iter(tables.values()))]
    figure = plotting.new_figure(11.0, 3.1 * -(-len(gains) // 3) + 0.8)
    panels = np.ravel(figure.subplots(-(-len(gains) // 3), 3, sharey=True, sharex=True))
    for unused in panels[len(gains) :]:
        unused.axis("off")
    for axes, gain in zip(panels, gains):
        for kind, of in tables.items():
            panel(axes, of[gain], gain, kind)
            for edge in found[kind][gain]:
                axes.axvline(edge, color=KINDS[kind][1], ls=":", lw=1.2)
        axes.set(xscale="log", yscale="log", ylim=(30, 1.6 * TOP))
        axes.set_title(NAMES.get(gain, gain), fontsize=9)
        plotting.quiet(axes)
    for axes in panels[-3:]:
        axes.set_xlabel("factor (relative to the designed value)")
    for axes in panels[::3]:
        axes.set_ylabel("settling time to 1e-6\n(tau_min)")
    axes = panels[0]
    axes.plot([], [], "x", color=style.INK, ms=6, label="not settled")
    axes.plot([], [], ":", color=style.INK, lw=1.2, label="optimum unstable to the left")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    plotting.headline(
        figure,
        f"{subject}: one gain at a time is multiplied, the others are as designed; "
        "lines: predicted by the spectrum, markers: measured",
    )
    return figure


def panel(axes, table: Table, gain: str, kind: str) -> None:
    """Draw predicted and measured settling over one gain, with one preconditioner."""
    label, colour, mark = KINDS[kind]
    factors, times = table[f"gains.{gain}"], table["normalised_settling_time"]
    axes.plot(
        factors, table["settling_by_spectrum"], color=colour, lw=1.3, label=f"predicted, {label}"
    )
    axes.plot(factors, times, mark, color=colour, ms=5, mec="white", label=f"measured, {label}")
    lost = factors[~np.isfinite(times)]
    height = TOP * 1.35 ** -[*KINDS].index(kind)
    axes.plot(lost, np.full(len(lost), height), "x", color=colour, ms=6)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
