"""Boards and silicon: the effects that decide.

Question: Parts have capacitance, leakage, bias current and nonlinearity that op-amp models omit.
          Which of them cause errors or ringing, and what helps?
Answer:   On a board, static errors: bias currents of 1 uA make the controls 3 % wrong, multiplier
          feedthrough of 0.3 % makes them 1.3 % wrong, in ngspice as predicted. Capacitance costs no
          accuracy, but with resistors of 10 kohm 12 pF at every virtual ground cause ringing;
          smaller resistors, 0.63 to 4.2 kohm, are chosen, and the car settles in 36 us with 3 to 20
          pF. Part sets with the values of their datasheets settle in 7 to 115 us with control
          errors of 0.02 to 0.5 %. In silicon, matching: 8 % with the smallest gates, 1 % with gates
          36 times as large; gain under load and the multiplier law cost 0.25 %. If a circuit is
          barely stable, rely on ngspice: OPA192 with 10 kohm is predicted to settle after 178 us
          and rings there.
Figure:   out/demos/27_parasitics.png
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

import ann_dc
from ann_dc import plotting
from ann_dc.fidelity import CircuitInstance, LoopGain, loop_gains, predicted_errors, prediction_of
from ann_dc.fidelity.boards import (
    Effect,
    Found,
    effects_table,
    known_effects,
    with_parasitics,
)
from ann_dc.hardware.parts import Level, Tolerances
from ann_dc.plotting import style

SIMULATED = (
    "no effect",
    "3 pF at every ground",
    "8 pF at every ground",
    "bias current 10 nA",
    "bias current 1 uA",
    "multiplier nonlinearity 0.4 %",
    "feedthrough 0.3 %",
    "capacitor leakage time constant 0.1 s",
    "open switches 1 Gohm and 5 pF",
)
"""Effects that ngspice simulates in addition, about 1 s each."""
PICOFARADS = (0, 4, 8, 10, 11, 12)
"""Capacitances at every virtual ground (pF) for the loop gains."""
CURED = (3, 8, 20)
"""Capacitances at every virtual ground (pF) for which sizes are chosen."""
GROUND = " pF at every ground"
"""Suffix of effects with this capacitance."""
SILICON = ann_dc.levels.TRANSISTOR
"""Model level of transistors."""
AREAS = (1.0, 36.0)
"""Gate areas relative to the smallest; their offsets are 3.3 and 0.55 mV."""
DRAWN = 10
"""Number of circuit instances with these offsets."""
MARGIN, OHMS = 10.0, 10e3
"""Bandwidth margin and resistance (ohm) of the circuits with effects."""
PF, US = 1e12, 1e6
"""Picofarads per farad and microseconds per second."""


@dataclass(frozen=True, kw_only=True)
class Sizing:
    """Sizes that are chosen for a part set, with predicted errors; in SI units."""

    name: str
    ground: float
    ohms: float
    farads: float
    error: float
    settling: float

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table."""
        return (
            self.name,
            f"{self.ground * PF:.3g}",
            f"{self.ohms:.5g}",
            f"{self.farads * PF:.3g}",
            f"{self.error:.1e}",
            f"{self.settling * US:.3g}",
        )


HEADS = (
    "part set", "ground\npF", "resistors\nohm", "smallest\npF", "control\nerror", "settling\nus"
)  # fmt: skip
"""Heads of the table of sizes."""


def main(
    out: Path | None = None,
    problem: ann_dc.OptimalControlProblem | None = None,
    simulated: Sequence[str] = SIMULATED,
    presets: Sequence[str] | None = None,
    picofarads: Sequence[float] = PICOFARADS,
) -> dict:
    """Evaluate effects, capacitances and part sets; return results and the figure path."""
    problem = problem or ann_dc.plants.car()
    network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    rows = effects(network, simulated)
    rows += effects_table(network, in_silicon(), simulated=False)
    rows += [mismatched(network, area) for area in AREAS]
    print(*rows, sep="\n")
    margins = worst_loops(network, picofarads)
    print("\nloop of smallest phase margin with resistors of 10 kohm")
    print(*(f"{pf:4g} pF: {loop}" for pf, loop in margins.items()), sep="\n")
    cured = [
        sizes(network, f"{pf} pF", with_ground_capacitance(ann_dc.levels.macro(), pf))
        for pf in CURED
    ]
    names = presets or ann_dc.presets.names()
    shelf = [sizes(network, name, ann_dc.presets.get(name)) for name in names]
    print("\n" + " ".join(f"{head.replace(chr(10), ', '):>18}" for head in HEADS))
    print(*(" ".join(f"{cell:>18}" for cell in one.cells()) for one in cured + shelf), sep="\n")
    figures = []
    if out is not None:
        figure = picture(problem, rows, margins, cured, shelf)
        figures.append(plotting.save(figure, Path(out) / "27_parasitics.png"))
    return {"rows": rows, "margins": margins, "cured": cured, "shelf": shelf, "figures": figures}


# ---- effects and sizes -----------------------------------------------------------------------


def effects(network: ann_dc.Network, simulated: Iterable[str]) -> list[Found]:
    """Predict every effect, and simulate some of them in ngspice."""
    known = known_effects()
    wanted = [effect for effect in known if effect.words in simulated]
    measured = {row.effect.words: row for row in effects_table(network, wanted)}
    others = [effect for effect in known if effect.words not in measured]
    predicted = {row.effect.words: row for row in effects_table(network, others, simulated=False)}
    found = measured | predicted
    return [found[effect.words] for effect in known]


def in_silicon() -> tuple[Effect, ...]:
    """Return effects of op amps and multipliers at the transistor level."""
    unloaded = replace(SILICON, datasheet=replace(SILICON.datasheet, stage_resistance=0.0))
    levels = {
        "open-loop gain 22 200": unloaded,
        "open-loop gain under load": SILICON,
    }
    return tuple(Effect(words=w, level=level, made_for=SILICON) for w, level in levels.items())


def mismatched(network: ann_dc.Network, area: float) -> Found:
    """Predict the median error by transistor mismatch over some circuit instances."""
    plain = ann_dc.levels.transistor(area=area)
    known = plain.tolerances
    offsets = Tolerances(offset=known.offset, product_offset=known.product_offset)
    level = replace(plain, datasheet=replace(plain.datasheet, tolerances=offsets))
    circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    errors = predicted_errors(circuit, level, probe, range(DRAWN))
    words = f"mismatch, gates {area:g} times as large" if area > 1 else "mismatch, smallest gates"
    return Found(
        effect=Effect(words=words, level=level, made_for=SILICON),
        predicted_error=float(np.median(errors)),
        predicted_stable=bool(np.isfinite(errors).all()),
    )


def with_ground_capacitance(level: Level, picofarads: float) -> Level:
    """Return a level with a capacitance at every virtual ground."""
    return with_parasitics(level, stray_capacitance=picofarads / PF)


def worst_loops(network: ann_dc.Network, picofarads: Iterable[float]) -> dict[float, LoopGain]:
    """Return the loop of smallest phase margin for every capacitance at virtual grounds."""
    plain = replace(ann_dc.levels.macro(), smallest_resistor=OHMS)
    circuit, probe = ann_dc.SpiceBackend(level=plain, bandwidth_margin=MARGIN).prepare(network)
    found = {}
    for pf in picofarads:
        level = with_ground_capacitance(plain, pf)
        made = CircuitInstance(circuit=circuit, level=level, probe=probe)
        found[pf] = loop_gains(made.emulation, level, made.settled)[0]
    return found


def sizes(network: ann_dc.Network, name: str, level: Level) -> Sizing:
    """Choose the sizes for a part set and predict its errors."""
    circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    found = prediction_of(CircuitInstance(circuit=circuit, level=level, probe=probe))
    return Sizing(
        name=name,
        ground=level.datasheet.parasitics.ground,
        ohms=circuit.inverter,
        farads=circuit.ranges[1][0],
        error=found.control_error,
        settling=found.settling_time,
    )


# ---- figure ----------------------------------------------------------------------------------


def picture(
    problem: ann_dc.OptimalControlProblem,
    rows: list[Found],
    margins: dict[float, LoopGain],
    cured: list[Sizing],
    shelf: list[Sizing],
):
    """Draw errors of all effects on the left; capacitances, loops and part sets on the right."""
    figure = plotting.new_figure(12.0, 8.6)
    left, right = figure.subfigures(1, 2, width_ratios=(6, 5))
    draw_effects(left, rows)
    over_grounds, over_margins, below = right.subplots(3, 1, height_ratios=(4, 4, 3))
    settling(over_grounds, rows, cured)
    loops(over_margins, margins)
    table(below, shelf)
    plotting.headline(
        figure,
        f"{plotting.caption(problem)}, diagonal preconditioner: parasitic effects that the design\n"
        "omits, one at a time; and the sizes that are chosen if the effect is given",
    )
    return figure


def kind_of(row: Found) -> str:
    """Return the group of an effect."""
    if row.effect.made_for.name == SILICON.name:
        return "transistors"
    words = row.effect.words
    if "ad73" in words or "ad83" in words:
        return "part sets with 10 kohm"
    apart = ("multiplier", "feedthrough", "leakage", "switch")
    return "multipliers, capacitors, switches" if any(w in words for w in apart) else "op amps"


COLOURS = {
    "op amps": style.BLUE,
    "part sets with 10 kohm": style.PURPLE,
    "multipliers, capacitors, switches": style.GREEN,
    "transistors": style.ORANGE,
}
"""Colours of the groups of effects."""
RINGS, RINGING = 0.3, 47.0
"""Positions of ringing circuits on the axes of control error and time (us)."""


def draw_effects(figure, rows: list[Found]) -> None:
    """Draw a line per effect: control error, or a cross if the circuit rings."""
    axes = figure.subplots()
    kinds = [kind_of(row) for row in rows]
    place = np.arange(len(rows)) + 0.8 * np.array([[*COLOURS].index(kind) for kind in kinds])
    for y, kind, row in zip(place, kinds, rows):
        colour = COLOURS[kind]
        if row.predicted_stable:
            axes.plot([1e-6, row.predicted_error], [y, y], color=colour, lw=0.8, alpha=0.4)
            axes.plot(row.predicted_error, y, "o", color=colour, ms=6)
        else:
            axes.plot(RINGS, y, "x", color=style.VERMILION, ms=7, mew=2)
        axes.plot(row.measured_error, y, "o", color=style.INK, mfc="none", ms=10)
    axes.set_yticks(place, [row.effect.words for row in rows])
    axes.set_ylim(place[-1] + 0.8, -0.8)
    axes.set(xscale="log", xlim=(1e-5, 0.6))
    axes.set_xlabel("control error (relative to the largest control)")
    handles = [
        Line2D([], [], color=colour, marker="o", ls="", ms=6, label=kind)
        for kind, colour in COLOURS.items()
    ]
    ring = {"color": style.INK, "marker": "o", "mfc": "none", "ls": "", "ms": 10}
    cross = {"color": style.VERMILION, "marker": "x", "ls": "", "ms": 7, "mew": 2}
    handles += [Line2D([], [], label="ngspice", **ring), Line2D([], [], label="rings", **cross)]
    plotting.quiet(axes)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)


WIDE = (-0.6, 21.5)
"""Limits of the capacitance axis (pF)."""


def settling(axes, rows: list[Found], cured: list[Sizing]) -> None:
    """Draw settling time over the capacitance, with 10 kohm and with chosen resistors."""
    made = {0.0: rows[0]} | {
        float(row.effect.words.removesuffix(GROUND)): row
        for row in rows
        if row.effect.words.endswith(GROUND) and kind_of(row) == "op amps"
    }
    at = np.array([*made])
    predicted = US * np.array([row.predicted_settling for row in made.values()])
    stable = np.array([bool(row.predicted_stable) for row in made.values()])
    measured = US * np.array([row.measured_settling for row in made.values()])
    axes.plot(at[stable], predicted[stable], color=style.BLUE, label="10 kohm, emulation")
    axes.plot(at, measured, "o", color=style.INK, mfc="none", ms=9, label="10 kohm, ngspice")
    axes.plot(at[~stable], np.full(sum(~stable), RINGING), "x", color=style.VERMILION, ms=8,
              mew=2, label="10 kohm, rings")  # fmt: skip
    for one in cured:
        axes.plot(one.ground * PF, one.settling * US, "s", color=style.GREEN, ms=6)
        axes.annotate(f"{one.ohms:g} ohm", (one.ground * PF, one.settling * US), (0, 8),
                      textcoords="offset points", ha="center", fontsize=8)  # fmt: skip
    axes.plot([], [], "s", color=style.GREEN, ms=6, label="chosen resistors")
    axes.set(ylim=(0, 52), xlim=WIDE, ylabel="settling time to 0.1 % (us)")
    axes.set_title("settling time: smaller resistors prevent ringing", fontsize=9, loc="left")
    axes.set_xlabel("capacitance at every virtual ground (pF)")
    plotting.quiet(axes)
    axes.legend(frameon=False, fontsize=8, loc="lower left", ncols=2)


def loops(axes, margins: dict[float, LoopGain]) -> None:
    """Draw the smallest phase margin over the capacitance at virtual grounds."""
    angles = [loop.phase_margin for loop in margins.values()]
    axes.plot([*margins], angles, "o-", color=style.BLUE, ms=5)
    for pf, loop in margins.items():
        if pf in (min(margins), max(margins)):
            axes.annotate(
                f"{loop.node}, {loop.crossover / 1e6:.2f} MHz", (pf, loop.phase_margin), (8, 2),
                textcoords="offset points", fontsize=8,
            )  # fmt: skip
    axes.set(ylim=(0, 60), xlim=WIDE, ylabel="phase margin (degrees)")
    axes.set_title(
        "smallest phase margin of all loops with 10 kohm, and its crossover",
        fontsize=9, loc="left",
    )  # fmt: skip
    axes.set_xlabel("capacitance at every virtual ground (pF)")
    plotting.quiet(axes)


def table(axes, shelf: list[Sizing]) -> None:
    """Draw the table of sizes for part sets with their parasitics."""
    axes.set_axis_off()
    axes.set_title("part sets with their parasitics: chosen sizes", fontsize=9, loc="left")
    shown = axes.table(
        [one.cells() for one in shelf], colLabels=HEADS, colWidths=(0.3, *[0.14] * 5),
        edges="horizontal", cellLoc="right", bbox=(0, 0, 1, 1),
    )  # fmt: skip
    shown.auto_set_font_size(False)
    shown.set_fontsize(8)
    for cell in shown.get_celld().values():
        cell.set_edgecolor("#E6E6E6")


if __name__ == "__main__":
    for path in main(Path("out/demos"))["figures"]:
        print(path)
