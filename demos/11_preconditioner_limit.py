"""Preconditioners on six plants: settling against wires.

Question: A preconditioner does not change the settled point. How much faster is settling, and for
          how many wires?
Answer:   The exact preconditioner has a stiffness ratio radius / |abscissa| of 2. The diagonal
          preconditioner needs no wire and exceeds 2 by a factor of 12 to 170; multilevel, with 60
          to 130 wires per cell, by 3.5 to 15; the resistive grid, with 10 to 30 resistors per cell
          between neighbours only, by at most 2.2: 30 to 60 tau_min from the straight line. Cyclic
          reduction is the same preconditioner as the grid without a loop that has to settle, for 40
          to 190 wires. All settle at the same optimum. The spectra show the slow modes: a long tail
          with the diagonal preconditioner, a short one with multilevel, none with the grid.
Figure:   out/demos/11_preconditioner_limit.png: settling and wires per preconditioner and plant;
          out/demos/11_spectra.png: spectra of car and pendulum, slow modes on the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ann_dc
from ann_dc import PreconditionerKind, plotting
from ann_dc.network.preconditioners import CyclicReduction, ResistiveGrid, Wires
from ann_dc.plotting import style

LIMIT = 2.0
"""Stiffness ratio of the exact preconditioner: every slow mode at Re s = -1/2."""
PLANTS = ("car", "unicycle", "van_der_pol", "cstr", "pendulum", "two_link_arm")
SPECTRA = ("car", "pendulum")
"""Plants whose spectra are drawn."""
MARKS = {
    PreconditionerKind.DIAGONAL: (style.GREY, "s"),
    PreconditionerKind.MULTILEVEL: (style.BLUE, "^"),
    PreconditionerKind.COUPLED_MULTILEVEL: (style.SKY, "v"),
    PreconditionerKind.RESISTIVE_GRID: (style.VERMILION, "o"),
    PreconditionerKind.CYCLIC_REDUCTION: (style.GREEN, "D"),
}
"""Colour and marker of every preconditioner."""
OFFSETS = {PreconditionerKind.MULTILEVEL: -0.1, PreconditionerKind.COUPLED_MULTILEVEL: 0.1}
"""Vertical offsets of preconditioners with the same number of wires."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Row:
    """Result of one preconditioner with one plant."""

    kind: PreconditionerKind
    solution: ann_dc.Solution
    wires: Wires

    @property
    def ratio(self) -> float:
        """Stiffness ratio radius / |abscissa| at the settled point."""
        return self.solution.spectrum.stiffness_ratio

    @property
    def settling(self) -> float:
        """Settling time from the straight line (tau_min)."""
        return self.solution.normalised_settling_time

    @property
    def per_cell(self) -> float:
        """Number of wires per cell, both directions counted."""
        ways = 2 if self.wires.both_ways else 1
        return ways * self.wires.per_cell(self.solution.network.stages)


def rows_of(problem: ann_dc.OptimalControlProblem) -> list[Row]:
    """Return a row per preconditioner, each designed with this preconditioner alone."""
    rows = [
        row_of(problem, kind)
        for kind in PreconditionerKind
        if kind is not PreconditionerKind.CYCLIC_REDUCTION
    ]
    grid = next(row for row in rows if row.kind is PreconditionerKind.RESISTIVE_GRID)
    return [*rows, as_cyclic_reduction(grid)]


def row_of(problem: ann_dc.OptimalControlProblem, kind: PreconditionerKind) -> Row:
    """Design with one preconditioner, run and certify."""
    solution = ann_dc.solve(problem, preconditioner=[kind], backend=ann_dc.OdeBackend(verify=False))
    network = solution.network
    return Row(kind=kind, solution=solution, wires=network.preconditioner.wires(network.layout))


def as_cyclic_reduction(grid: Row) -> Row:
    """Return the preconditioner of a grid as cyclic reduction: same M, other wires."""
    network, preconditioner = grid.solution.network, grid.solution.network.preconditioner
    assert isinstance(preconditioner, ResistiveGrid)
    reduction = CyclicReduction(own=preconditioner.own, following=preconditioner.following)
    return Row(
        kind=PreconditionerKind.CYCLIC_REDUCTION,
        solution=grid.solution,
        wires=reduction.wires(network.layout),
    )


def main(out: Path | None = None, names: tuple[str, ...] = PLANTS) -> dict:
    """Solve every plant with every preconditioner; return the table and figure paths."""
    table = {}
    for name in names:
        print(f"{name} ...", flush=True)
        table[name] = rows_of(ann_dc.plants.get(name)())
    print(as_text(table))
    figures = []
    if out is not None:
        figures = [
            plotting.save(costs(table), Path(out) / "11_preconditioner_limit.png"),
            plotting.save(spectra(table), Path(out) / "11_spectra.png"),
        ]
    return {"table": table, "figures": figures}


def as_text(table: dict[str, list[Row]]) -> str:
    """Return the table, with a line per plant and preconditioner."""
    lines = [
        f"{'':18}{'':34}{'ratio':>7}{'settling':>10}{'certified':>11}{'wires/cell':>12}{'nodes':>7}"
    ]
    for name, rows in table.items():
        for row in rows:
            certified = "yes" if row.solution.certified else "no"
            lines.append(
                f"{name:18}{row.kind.value:34}{row.ratio:7.3g}{row.settling:10.0f}"
                f"{certified:>11}{row.per_cell:12.0f}{row.wires.nodes:7}"
            )
    return "\n".join([*lines, f"(ratio: stiffness ratio, limit {LIMIT:g}; settling: tau_min)"])


def costs(table: dict[str, list[Row]]):
    """Draw settling times and wires, with a line per plant."""
    figure = plotting.new_figure(10.0, 4.6)
    settling, wires = figure.subplots(1, 2, sharey=True)
    for number, rows in enumerate(table.values()):
        for row in rows:
            colour, marker = MARKS[row.kind]
            place = number + OFFSETS.get(row.kind, 0.0)
            look = {"color": colour, "marker": marker, "ms": 7, "mec": "white", "ls": "none"}
            label = row.kind.value if number == 0 else None
            if row.kind is not PreconditionerKind.CYCLIC_REDUCTION:  # as its grid
                settling.plot(row.settling, place, **look)
            wires.plot(row.per_cell, place, **look, label=label)
    least = LIMIT * np.log(1e6)
    settling.axvline(least, color=style.INK, lw=1, ls="--")
    settling.text(1.06 * least, -0.45, "stiffness ratio 2", fontsize=8, color=style.INK)
    settling.set(xscale="log", xlabel="settling time to 1e-6 from the straight line (tau_min)")
    ticks = [30, 100, 300, 1000, 3000]
    settling.set_xticks(ticks, [str(tick) for tick in ticks])
    settling.minorticks_off()
    wires.set(xlabel="wires per cell besides neighbour connections (both directions)")
    wires.set_xscale("symlog", linthresh=10)
    ticks = [0, 5, 10, 20, 50, 100, 200, 500]
    wires.set_xticks(ticks, [str(tick) for tick in ticks])
    wires.minorticks_off()
    wires.set_xlim(left=-1)
    settling.set_yticks(range(len(table)), [caption_of(rows) for rows in table.values()])
    settling.set_ylim(len(table) - 0.4, -0.7)
    for axes in (settling, wires):
        plotting.quiet(axes)
    figure.legend(
        *wires.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False,
        fontsize=8,
    )  # fmt: skip
    figure.suptitle(
        "Settling time and wires of every preconditioner; cyclic reduction settles like its grid",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def caption_of(rows: list[Row]) -> str:
    """Return the name of a plant with N and dt on the next line."""
    return plotting.caption(rows[0].solution.problem).replace(": ", "\n")


def spectra(table: dict[str, list[Row]]):
    """Draw eigenvalues relative to the spectral radius, with slow modes on the right."""
    shown = [name for name in SPECTRA if name in table] or list(table)[:1]
    drawn = [
        row.kind for row in table[shown[0]] if row.kind is not PreconditionerKind.CYCLIC_REDUCTION
    ]
    figure = plotting.new_figure(11.0, 0.8 + 2.4 * len(shown))
    panels = figure.subplots(len(shown), len(drawn), sharex=True, sharey=True, squeeze=False)
    for name, line in zip(shown, panels):
        for axes, row in zip(line, table[name]):
            panel(axes, row)
            axes.set_title(f"{row.kind.value}: {row.ratio:.3g}", fontsize=8)
        line[0].set_ylabel(f"{caption_of(table[name])}\nimaginary part\n(relative to radius)")
    for axes in panels[-1]:
        axes.set_xlabel("decay rate\n(relative to spectral radius)")
    slowest = max(row.ratio for name in shown for row in table[name])
    panels[0, 0].set(xscale="log", xlim=(1.5, 0.5 / slowest), ylim=(-1.05, 1.05))
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3,
        frameon=False, fontsize=8,
    )  # fmt: skip
    figure.suptitle(
        "Spectra at the optimum, slow modes on the right; titles: ratio radius / |abscissa|",
        x=0.02, ha="left", fontsize=10,
    )  # fmt: skip
    return figure


def panel(axes, row: Row) -> None:
    """Draw one spectrum, its slowest mode and the limit."""
    spectrum = row.solution.spectrum
    scaled = spectrum.eigenvalues / spectrum.radius
    axes.plot(
        -scaled.real, scaled.imag, "o", color=MARKS[row.kind][0], ms=3, alpha=0.6, mew=0,
        label="eigenvalues",
    )  # fmt: skip
    axes.axvline(1 / row.ratio, color=style.INK, lw=1, label="slowest mode")
    axes.axvline(
        1 / LIMIT, color=style.INK, lw=1, ls="--", label=f"limit: stiffness ratio {LIMIT:g}"
    )
    plotting.quiet(axes)


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
