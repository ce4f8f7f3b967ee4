"""Basins of attraction of networks with fixed gains.

Question: From which initial guesses, and for which targets, does a network settle at the certified
          optimum, at another one, or nowhere?
Answer:   A unicycle settles at it from everywhere. A car settles from 3 % off the line; from 30 %
          off no run keeps tan(varphi) within its domain. A pendulum always settles at a certified
          optimum, but from 10 % off also at swing-ups of higher cost. One car with fixed gains
          finds the optimum of every target from three metres ahead on, and of half of those one
          metre ahead.
Figure:   out/demos/23_basins_of_attraction.png
"""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table

STUDY = Path(__file__).with_name("basin.toml")
ALIKE = 1e-3
"""Relative cost difference below which two optima count as equal."""


class End(enum.Enum):
    """Classification of the end of a run; the value is its description."""

    BEST = "best optimum"
    OTHER = "another optimum"
    NO_OPTIMUM = "settled, not an optimum"
    NOWHERE = "not settled"


COLOURS = {
    End.BEST: style.BLUE,
    End.OTHER: style.ORANGE,
    End.NO_OPTIMUM: style.PURPLE,
    End.NOWHERE: "#D9D9D9",
}
"""Colours of the results."""
PLANTS = ("car", "unicycle", "pendulum")
MAPS = {
    "car": (
        {"q_d.x": (1.0, 9.0), "q_d.y": (1.0, 9.0)},
        0.03,
        ("target x (m)", "target y (m)"),
        (5.0, 5.0),
    ),
    "pendulum": (
        {"q_0.theta": (1.0, 5.0), "q_0.omega": (-3.0, 3.0)},
        0.3,
        ("initial angle (rad, 0: upright)", "initial speed (rad/s)"),
        (np.pi, 0.0),
    ),
}
"""Ranges of two inputs, spread of the initial guesses, axis labels, designed inputs."""
SIDE = 9
"""Number of values of each input of a map."""
STARTS = 60
"""Number of initial guesses per spread."""
OF_A_MAP = 8
"""Number of initial guesses per point of a map."""


def main(
    out: Path | None = None,
    plants: Sequence[str] = PLANTS,
    starts: int = STARTS,
    side: int = SIDE,
    of_a_map: int = OF_A_MAP,
    workers: int | None = None,
) -> dict:
    """Run random initial guesses of the plants, and two maps; return tables and figure path."""
    study = replace(ann_dc.load_study(STUDY), samples=starts)
    bars = {name: replace(study, subject=name).run(workers=workers) for name in plants}
    for name, table in bars.items():
        for spread, share in shares(table).items():
            print(f"{name:10} spread {spread:<5g} " + summary(share))
    maps = {}
    for name, (ranges, spread, *_) in MAPS.items():
        places = {f"input.{n}": np.linspace(*ends, side).tolist() for n, ends in ranges.items()}
        vary = {**places, "initial_guess.spread": [spread]}
        map_of_ends = replace(study, subject=name, vary=vary, samples=of_a_map)
        maps[name] = map_of_ends.run(workers=workers)
        found = ends_of(maps[name])
        print(
            f"{name:10} map           "
            + summary({end: found.count(end) / len(found) for end in End})
        )
    figures = []
    if out is not None:
        path = Path(out) / "23_basins_of_attraction.png"
        figures.append(plotting.save(picture(bars, maps), path))
    return {"bars": bars, "maps": maps, "figures": figures}


def ends_of(table: Table) -> list[End]:
    """Classify the end of every run; the best optimum is that of least cost for equal inputs."""
    names = [name for name in table.columns if name.startswith("input.")]
    given = [*zip(*(table[name] for name in names))] or [()] * len(table)
    optimal, costs = table["certified"] == 1, table["objective"]
    best: dict[tuple, float] = {}
    for where, cost in zip(given, np.where(optimal, costs, np.inf)):
        best[where] = min(cost, best.get(where, np.inf))
    settled = table["outcome"] == "settled"
    runs = zip(settled, optimal, costs, (best[where] for where in given))
    return [end_of(*run) for run in runs]


def end_of(settled: bool, optimal: bool, cost: float, best: float) -> End:
    """Classify the end of a run by its cost and that of the best optimum."""
    if not settled:
        return End.NOWHERE
    if not optimal:
        return End.NO_OPTIMUM
    return End.BEST if cost <= best + ALIKE * max(abs(best), 1e-9) else End.OTHER


def shares(table: Table) -> dict[float, dict[End, float]]:
    """Return the fraction of the runs with each result, by spread of the initial guesses."""
    found: dict[float, list[End]] = {}
    for spread, end in zip(table["initial_guess.spread"], ends_of(table)):
        found.setdefault(float(spread), []).append(end)
    return {
        spread: {end: each.count(end) / len(each) for end in End} for spread, each in found.items()
    }


def summary(share: dict[End, float]) -> str:
    """Return the nonzero fractions as text."""
    return ", ".join(f"{value:.0%} {end.value}" for end, value in share.items() if value)


def picture(bars: dict[str, Table], maps: dict[str, Table]):
    """Draw bars over the spread of initial guesses, and maps of the best optimum below."""
    figure = plotting.new_figure(10.4, 6.6)
    upper, lower = figure.subfigures(2, 1, height_ratios=(2, 3))
    for axes, (name, table) in zip(upper.subplots(1, len(bars), sharey=True), bars.items()):
        draw_bars(axes, table)
        axes.set_title(plotting.caption(ann_dc.plants.get(name)()), fontsize=9)
    first, *_ = upper.axes
    first.set_ylabel("runs (%)")
    handles, labels = first.get_legend_handles_labels()
    upper.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=8)
    for axes, (name, table) in zip(lower.subplots(1, len(maps)), maps.items()):
        draw_map(lower, axes, name, table)
    plotting.headline(
        figure,
        "Results with fixed gains: random initial guesses around the straight line, "
        "and maps of targets and initial states",
    )
    return figure


def draw_bars(axes, table: Table) -> None:
    """Draw stacked fractions of the results over the spread."""
    found = shares(table)
    low = np.zeros(len(found))
    for end, colour in COLOURS.items():
        each = np.array([100 * share[end] for share in found.values()])
        axes.bar(range(len(found)), each, bottom=low, color=colour, width=0.8, label=end.value)
        low += each
    axes.set_xticks(range(len(found)), [f"{spread:g}" for spread in found])
    axes.set_xlabel("spread of initial guesses (network units)")
    plotting.quiet(axes)


def draw_map(figure, axes, name: str, table: Table) -> None:
    """Draw a map of the fraction of runs at the best optimum."""
    (across, up), spread, labels, designed = MAPS[name]
    x, y = (np.unique(table[f"input.{n}"]) for n in (across, up))
    found = np.array([end is End.BEST for end in ends_of(table)])
    share = 100 * found.reshape(len(x), len(y), -1).mean(axis=2)
    tiles = axes.pcolormesh(x, y, share.T, cmap="viridis", vmin=0, vmax=100)
    axes.plot(*designed, "o", color=style.VERMILION, ms=6, label="designed inputs")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.set_title(f"{name}, spread of initial guesses {spread:g}", fontsize=9)
    axes.tick_params(labelsize=8)
    axes.legend(frameon=True, fontsize=8, loc="lower right")
    figure.colorbar(tiles, ax=axes, label="best optimum (% of the runs)")


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
