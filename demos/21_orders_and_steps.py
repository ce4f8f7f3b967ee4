"""Update orders and step rules over a hundred samples.

Question: Which order and step rule settles in fewest steps, and is the limit of the spectrum the
          actual limit?
Answer:   With multilevel gains orders hardly differ: 175 to 205 steps with the best fixed step at
          which all of 100 cars settle, 190 to 210 with the adaptive step. With a resistive grid
          they differ by a factor of ten: two-phase takes 95 steps (110 adaptive), simultaneous and
          stage-by-stage 275 and more (1020 adaptive), because slow modes of the grid oscillate. The
          limit 2a / (a^2 + b^2) holds for the simultaneous order at the equilibrium of each sample,
          which is 0.8 to 1.7 of that of the designed network with a grid; some samples are lost
          slightly before it. Stage-by-stage is similar. Two-phase has another limit: multilevel, 19
          of 100 fail at 0.6 of it and 99 at 0.7; with a grid 98 settle at 1.5 times it. With
          multilevel gains 0.7 of the limit is fastest.
Figure:   out/demos/21_orders_and_steps.png
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ann_dc import plotting
from ann_dc.plotting import style
from ann_dc.study import Table
from ann_dc.study.library import SHARES, settling_against_steps

CARS = {
    "input.q_0.x": (-0.5, 0.5),
    "input.q_0.y": (-0.5, 0.5),
    "input.q_0.phi": (-0.2, 0.2),
    "input.q_d.x": (4.0, 6.0),
    "input.q_d.y": (4.0, 6.0),
}
"""Ranges of initial and terminal positions (m) and of the initial heading (rad)."""
KINDS = {"multilevel": "multilevel", "resistive-grid": "resistive grid"}
"""Labels of the preconditioners."""
ORDERS = {
    "simultaneous": ("simultaneous", style.BLUE),
    "two-phase": ("two-phase", style.ORANGE),
    "stage-by-stage": ("stage-by-stage", style.GREEN),
}
"""Labels and colours of the update orders: Jacobi, primal-then-dual, Gauss-Seidel over stages."""


class OrderResult(NamedTuple):
    """Steps and settled fraction of the samples of one update order.

    Attributes
    ----------
    shares : (S,) array
        Fixed steps, relative to the limit of the designed network.
    steps : (S, 3) array
        Percentiles 10, 50 and 90 of the number of steps of the settled samples.
    settled : (S,) array
        Fraction of the samples that settled.
    adaptive : float
        Median number of steps with the adaptive step rule.
    adaptive_settled : float
        Fraction of the samples that settled with the adaptive step rule.
    """

    shares: np.ndarray
    steps: np.ndarray
    settled: np.ndarray
    adaptive: float
    adaptive_settled: float


def settled_fraction(table: Table) -> float:
    """Return the fraction of the samples that settled."""
    return float(np.mean(table["outcome"] == "settled"))


def percentiles(table: Table) -> np.ndarray:
    """Return percentiles of the steps of settled samples; nan if fewer than half settled."""
    if settled_fraction(table) < 0.5:
        return np.full(3, np.nan)
    return np.nanpercentile(table["settling_steps"], [10, 50, 90])


def order_result(limit: float, adaptive: Table, fixed: Table) -> OrderResult:
    """Compute the result of one update order from the cases of both studies."""
    tables = fixed.by("run.step")
    return OrderResult(
        shares=np.array([*tables]) / limit,
        steps=np.array([percentiles(table) for table in tables.values()]),
        settled=np.array([settled_fraction(table) for table in tables.values()]),
        adaptive=float(np.nanmedian(adaptive["settling_steps"])),
        adaptive_settled=settled_fraction(adaptive),
    )


def main(
    out: Path | None = None,
    subject: str = "car",
    ranges: Mapping[str, tuple[float, float]] = CARS,
    kinds: Sequence[str] = tuple(KINDS),
    samples: int = 100,
    shares: Sequence[float] = SHARES,
) -> dict:
    """Run every order with every step; return results, limits and the figure path."""
    found: dict[str, dict[str, OrderResult]] = {}
    limits: dict[str, np.ndarray] = {}
    for kind in kinds:
        studies = settling_against_steps(
            subject, vary=ranges, preconditioner=kind, samples=samples, shares=shares
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # steps above the limit are intended
            adaptive, fixed = (s.run(workers=0) for s in (studies.adaptive, studies.fixed))
        of_order = adaptive.by("run.order")
        found[kind] = {
            order: order_result(studies.limit, of_order[order], table)
            for order, table in fixed.by("run.order").items()
        }
        own = of_order["simultaneous"]["largest_step"] / studies.limit
        limits[kind] = own[of_order["simultaneous"]["outcome"] == "settled"]
        print(as_text(kind, studies.limit, found[kind], limits[kind]))
    figures = []
    if out is not None:
        figure = picture(subject, found, limits, samples)
        figures.append(plotting.save(figure, Path(out) / "21_orders_and_steps.png"))
    return {"found": found, "limits": limits, "figures": figures}


def as_text(kind: str, limit: float, found: dict[str, OrderResult], own: np.ndarray) -> str:
    """Return the best fixed step and the adaptive step rule of every order as text."""
    low, high = own.min(), own.max()
    lines = [
        f"{KINDS[kind]}: limit {limit:.3f} unit time constants at the designed equilibrium, "
        f"{low:.2f} to {high:.2f} times as large at those of the samples"
    ]
    for order, one in found.items():
        whole = np.where(one.settled == 1, one.steps[:, 1], np.inf)
        best = int(np.argmin(whole))
        lines.append(
            f"  {ORDERS[order][0]:20} adaptive {one.adaptive:5.0f} steps, "
            f"{100 * one.adaptive_settled:.0f} % settled; best fixed step at which all settle: "
            f"{one.shares[best]:.2f} of the limit, {whole[best]:.0f} steps"
        )
    return "\n".join(lines)


def picture(subject: str, found: dict, limits: dict, samples: int):
    """Draw the number of steps and the settled fraction over the length of the fixed step."""
    figure = plotting.new_figure(10.4, 6.0)
    panels = figure.subplots(2, len(found), sharex=True, sharey="row", height_ratios=(3, 2))
    panels = np.reshape(panels, (2, -1))
    for (above, below), (kind, of) in zip(panels.T, found.items()):
        for order, one in of.items():
            label, colour = ORDERS[order]
            above.plot(one.shares, one.steps[:, 1], "o-", color=colour, ms=4, label=label)
            above.fill_between(one.shares, *one.steps[:, [0, 2]].T, color=colour, alpha=0.15, lw=0)
            above.axhline(one.adaptive, color=colour, ls="--", lw=1, label=f"{label}, adaptive")
            below.plot(one.shares, 100 * one.settled, "o-", color=colour, ms=4)
        ends = np.sort(limits[kind])
        stable = 100 * (1 - np.arange(len(ends) + 1) / len(ends))
        below.step([0, *ends], stable, where="post", color=style.INK, lw=1, ls=":",
                   label="stable by sample spectrum, simultaneous")  # fmt: skip
        for axes in (above, below):
            axes.axvline(1, color=style.INK, lw=1, ls="--", label="limit 2a/(a²+b²)")
            plotting.quiet(axes)
        above.set(yscale="log", title=KINDS[kind])
        above.title.set_fontsize(9)
        below.set(xlabel="fixed step (relative to the limit of the designed network)")
    panels[0, 0].set_ylabel("steps to 1e-6: median,\npercentiles 10 to 90")
    panels[1, 0].set_ylabel(f"settled (% of {samples})")
    handles = {}
    for axes in panels[:, 0]:
        for handle, label in zip(*axes.get_legend_handles_labels()):
            handles.setdefault(label, handle)
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4,
                  frameon=False, fontsize=8)  # fmt: skip
    plotting.headline(
        figure,
        f"{subject}: recurrent steps, {samples} samples of initial state and target in every case",
    )
    return figure


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
