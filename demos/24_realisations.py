"""One network in every realisation, sample by sample.

Question: Do integration, recurrence and circuit settle at the same controls, in the same time, for
          every target?
Answer:   The controls agree: to 1e-8 in numbers, 4e-7 with ideal parts in ngspice, 3e-5 with op
          amps of finite gain. Ideal parts settle with the ODE, to 1 %; the recurrence up to 11 %
          later, op amps of 10 MHz 15 to 29 % later. The emulation predicts the error to 0.6 %, and
          the time to 0.6 % for eleven targets and 7 % for one, whose last oscillation grazes the
          limit of 0.1 % that defines settling.
Figure:   out/demos/24_realisations.png
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table
from ann_dc.study.library import REALISATIONS, realisations

TARGETS = {"q_d.x": (4.5, 5.5), "q_d.y": (4.5, 5.5)}
"""Ranges of the terminal position (m)."""
SAMPLES = 12
"""Number of targets."""
STYLES = dict(
    zip(
        REALISATIONS,
        (
            (style.INK, "-"),
            (style.GREEN, "^"),
            (style.BLUE, "x"),
            (style.ORANGE, "s"),
            (style.VERMILION, "o"),
        ),
    )
)
"""Colour and marker of every realisation."""
UNSEEN = 1e-10
"""Control error below which errors are drawn at this value."""


def main(
    out: Path | None = None,
    samples: int = SAMPLES,
    chosen: dict | None = None,
    workers: int | None = None,
) -> dict:
    """Run the same samples in every realisation; return the tables and the figure path."""
    studies = realisations("car", TARGETS, samples=samples, chosen=chosen or REALISATIONS)
    tables = {}
    for name, study in studies.items():
        tables[name] = study.run(workers=workers)
        error, time = (
            tables[name][metric] for metric in ("control_error", "control_settling_time")
        )
        print(f"{name:22} {tables[name].outcomes}  control error at most {np.nanmax(error):.1e}, "
              f"unit time constants {np.nanmin(time):.1f} to {np.nanmax(time):.1f}")  # fmt: skip
    figures = []
    if out is not None:
        path = Path(out) / "24_realisations.png"
        figures.append(plotting.save(picture(tables), path))
    return {"tables": tables, "figures": figures}


def picture(tables: dict[str, Table]):
    """Draw settling time and control error of every sample, with a marker per realisation."""
    figure = plotting.new_figure(10.0, 4.2)
    times, errors = figure.subplots(1, 2)
    first = next(iter(tables.values()))
    order = np.argsort(first["control_settling_time"])
    place = np.arange(1, len(order) + 1)
    for name, table in tables.items():
        colour, marker = STYLES[name]
        look = {"color": colour, "ms": 6, "mfc": "none", "label": name}
        times.plot(place, table["control_settling_time"][order], marker, **look)
        errors.plot(place, np.maximum(table["control_error"][order], UNSEEN), marker, **look)
    times.set(ylabel="settling time to 0.1 % (unit time constants)", ylim=(0, None))
    errors.set(yscale="log", ylabel="control error\n(relative to the largest control)")
    for axes in (times, errors):
        axes.set_xlabel("sample, ordered by settling time of the ODE")
        plotting.quiet(axes)
    handles, labels = times.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    plotting.headline(
        figure,
        f"{plotting.caption(ann_dc.plants.car())}\n"
        f"{len(order)} random targets, equal in every realisation",
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
