"""Schematic sheets: the parts of a cell with values, arranged in panels, as SVG and PDF.

Among parts that differ only in their values, the part with the most wires is drawn. Values are
those of a cell in the middle of the cell array. Elements that this cell lacks are omitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc import si_prefixes as prefixes
from ann_dc.errors import ExportError
from ann_dc.export.drawings.chain_diagram import fitted
from ann_dc.export.drawings.labels import cell_at
from ann_dc.export.drawings.page import GREY, LARGE, PLAIN, WIDTH, Page, Pen, told_of
from ann_dc.export.drawings.symbols import AMPLIFIER, Symbols
from ann_dc.export.netlists.build import LevelOrName, build, name_of
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.hardware.circuit.circuit import HOLD, Circuit
from ann_dc.hardware.parts import presets
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OpAmps
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
    Wire,
)
from ann_dc.hardware.schematic.preconditioner_wiring import OWN
from ann_dc.network.cell import ONE, Role
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.validation import checked

SIDE, TOP, TALLEST = 4.0, 16.0, 250.0
"""Lengths in mm: margin next to the panels, margin above the panels, largest sheet height."""
PANEL = (WIDTH - 2 * SIDE) / 2
HEAD, BOX_HEAD, ROW, FOOT = 19.0, 9.0, 5.4, 8.0
"""Heights in mm: panel above its first input, box head, input spacing, panel below its last input.
"""
MOST = 10
"""Maximum number of drawn inputs; the remaining inputs are counted."""


@checked
def schematic_files(
    network: Network, vector: ReferenceVector, *, level: LevelOrName = "behavioural"
) -> dict[str, bytes]:
    """Draw schematics of a cell's parts with schemdraw: one of each kind, with values.

    The level is ``behavioural``, ``macro``, the name of a part set, or a `Level` of op amps with
    resistors. The files are ``schematic_1.svg`` and ``schematic_1.pdf``, further sheets if needed,
    and ``reference_vector.json``.

    Raises `ExportError` with the reason if the level does not exist or cannot build the network,
    and `ExportPackageMissing` if schemdraw is not installed.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.export.reference import reference_vector
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> files = schematic_files(network, reference_vector(network))  # doctest: +SKIP
    >>> sorted(files)  # doctest: +SKIP
    ['reference_vector.json', 'schematic_1.pdf', 'schematic_1.svg']
    """
    known = "behavioural", "macro", *presets.names()
    if level not in known and not _is_drawable(level):
        raise ExportError(
            f"level: {name_of(level)!r} cannot be drawn; choose one of: {', '.join(known)}"
        )
    if network.preconditioner.kind is PreconditionerKind.RESISTIVE_GRID:
        primal = ", ".join(n.name for n in network.cell.neurons if n.role is Role.PRIMAL)
        raise ExportError(
            f"schematic: the resistors of a grid between {primal:.200} are not drawn; design the "
            "network with a diagonal, multilevel or cyclic-reduction preconditioner"
        )
    circuit = build(network, level, duration=vector.duration).circuit
    files, reported = {}, told_of(network, "schematic", name_of(level))
    for number, page in enumerate(circuit_sheets(circuit, name_of(level))):
        files |= page.files(f"schematic_{number + 1}", reported)
    return {**files, VECTOR: vector.as_json()}


def _is_drawable(level: LevelOrName) -> bool:
    return (
        isinstance(level, Level) and isinstance(level.technology, OpAmps) and not level.transistors
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Drawn:
    """Part to be drawn at a stage, parts that look the same, and existing inputs with ohms."""

    part: Part
    stage: int
    others: tuple[str, ...]
    inputs: list[tuple[Wire, float]]

    @property
    def count(self) -> int:
        """Number of drawn inputs."""
        if isinstance(self.part, (Multiplier, Generator)):
            return 2 if isinstance(self.part, Multiplier) else 1
        return min(len(self.inputs), MOST)

    @property
    def foot(self) -> float:
        """Height in mm of the panel above its foot."""
        if not self.inputs:
            return BOX_HEAD + ROW * self.count
        return HEAD + ROW * (max(self.count, 2) + (len(self.inputs) > self.count))


def circuit_sheets(circuit: Circuit, level: str) -> list[Page]:
    """Draw the schematic sheets of a circuit at a model level."""
    kinds = _kinds(circuit)
    pairs = [kinds[i : i + 2] for i in range(0, len(kinds), 2)]
    rows = [(max(drawn.foot for drawn in pair) + FOOT, pair) for pair in pairs]
    runs: list[list[tuple[float, list[Drawn]]]] = [[]]
    for row in rows:
        if TOP + sum(height for height, _ in [*runs[-1], row]) > TALLEST and runs[-1]:
            runs.append([])
        runs[-1].append(row)
    return [_sheet(circuit, level, run, (i + 1, len(runs))) for i, run in enumerate(runs)]


def _kinds(circuit: Circuit) -> list[Drawn]:
    """Return the part with the most wires of every kind; one-cell arrays lack some."""
    groups: dict[tuple, list[Part]] = {}
    for part in circuit.schematic.parts:
        if circuit.schematic.alive_at(part.name).any():
            groups.setdefault(_kind(part), []).append(part)
    found = []
    for parts in groups.values():
        best = max(parts, key=lambda part: len(getattr(part, "wires", ())))
        others, stage = tuple(p.name for p in parts if p is not best), _middle(circuit, best)
        inputs = _inputs(circuit, best, stage)
        found.append(Drawn(part=best, stage=stage, others=others, inputs=inputs))
    return sorted(found, key=lambda drawn: drawn.count, reverse=True)


def _kind(part: Part) -> tuple:
    if isinstance(part, Multiplier):
        return (Multiplier,)
    if isinstance(part, Generator):
        return Generator, part.function
    own = (
        isinstance(part, Integrator) and part.with_limits,
        isinstance(part, PICell) and part.rectified,
    )
    return type(part), part.name.rpartition(".")[0].partition(".")[0], own


def _middle(circuit: Circuit, part: Part) -> int:
    """Return the stage closest to the middle of the cell array that has the part."""
    stages = np.flatnonzero(circuit.schematic.alive_at(part.name))
    return int(stages[np.abs(stages - circuit.schematic.network.stages // 2).argmin()])


def _inputs(circuit: Circuit, part: Part, stage: int) -> list[tuple[Wire, float]]:
    if isinstance(part, (Multiplier, Generator)):
        return []
    return [
        (wire, float(ohms[stage]))
        for wire, ohms in zip(part.wires, circuit.resistors[part.name])
        if np.isfinite(ohms[stage]) and circuit.schematic.fed(wire, stage)
    ]


def _sheet(circuit: Circuit, level: str, run: list, number: tuple[int, int]) -> Page:
    height = TOP + sum(height for height, _ in run) + 3
    page = Page(WIDTH, height)
    title = fitted(circuit.schematic.network.title, 90.0)
    page.text((SIDE + 2, 5), f"{title}: parts of a cell, {level}", size=LARGE, bold=True)
    scaling = circuit.scaling
    said = (
        f"Sheet {number[0]} of {number[1]}. Full scale {scaling.full_scale:g} V; a unit of network "
        f"time is {engineering(scaling.time, 's')}. One part of every kind."
    )
    if any(part.name.startswith(OWN) for part in circuit.schematic.parts):
        said += f" {OWN}x integrates the net input of neuron x."
    page.text((SIDE + 2, 10.5), said, size=PLAIN)
    symbols, y = Symbols(page), TOP
    for tall, pair in run:
        for place, drawn in enumerate(pair):
            corner = (SIDE + place * PANEL, y)
            frame = Pen(color="#C8C8C8", width=0.5)
            page.box((corner[0] + 0.7, y + 0.7), (PANEL - 1.4, tall - 1.4), edge=frame)
            page.above()
            _Panel(circuit, drawn, symbols, corner).draw()
        y += tall
    symbols.finish()
    return page


class _Panel:
    """Panel with a part at its position."""

    def __init__(
        self, circuit: Circuit, drawn: Drawn, symbols: Symbols, corner: tuple[float, float]
    ) -> None:
        self.circuit, self.drawn, self.symbols = circuit, drawn, symbols
        self.x, self.y = corner
        self.page, self.part = symbols.page, drawn.part

    def draw(self) -> None:
        """Draw the part and its name."""
        part, name = self.part, self.part.name
        kind = {Integrator: "integrator", PICell: "PI amplifier", Adder: "adder"}
        kind |= {Multiplier: "multiplier", Generator: "generator"}
        words = kind[type(part)]
        if isinstance(part, PICell) and part.rectified:
            words = "rectifying multiplier"
        self.page.text(
            (self.x + 3, self.y + 4), fitted(f"{words} {name}", 46), bold=True, size=PLAIN
        )
        said = f"cell {self.drawn.stage}"
        if self.drawn.others:
            said += f"; {len(self.drawn.others)} equal ones"
        self.page.text((self.x + PANEL - 3, self.y + 4), said, align="right", color=GREY)
        if isinstance(part, (Multiplier, Generator)):
            self._draw_box(part)
        elif not isinstance(part, GridNode):
            self._draw_amplifier(part)

    def _draw_box(self, part: Multiplier | Generator) -> None:
        top = self.y + BOX_HEAD
        if isinstance(part, Multiplier):
            sources, sign = [part.a, part.b], "×"
        else:
            sources, sign = [part.x], part.function
        ends = (self.x + 40, self.x + 54)
        size = (ends[1] - ends[0], ROW * len(sources))
        self.page.box((ends[0], top), size, edge=Pen(width=0.8))
        middle = top + size[1] / 2
        self.page.text((self.x + 47, middle), sign, size=LARGE, align="center")
        for place, source in enumerate(sources):
            y = top + ROW * (place + 0.5)
            words = self._signed(source)
            self.page.text((self.x + 27, y), fitted(words, 23), align="right")
            self.symbols.wire([(self.x + 28, y), (ends[0], y)])
        self.symbols.wire([(ends[1], middle), (self.x + 61, middle)])
        self._out((self.x + 61, middle))
        if isinstance(part, Multiplier):
            self.page.text((self.x + 3, top + 2 * ROW + 4), self._product(part))

    def _product(self, part: Multiplier) -> str:
        """Return the voltage equation of a multiplier, whose differential inputs take any sign."""
        sign = self.circuit.schematic.sign
        swapped = sign(part.a) * sign(part.b) * sign(part.name) < 0
        lead = "−" if swapped else ""
        volts = engineering(self.circuit.scaling.full_scale, "V")
        return f"output = {lead}the product of the inputs / {volts}"

    def _draw_amplifier(self, part: Amplifier) -> None:
        count, rows = self.drawn.count, self.drawn.inputs
        first, bus = self.y + HEAD, self.x + 43.0
        heights = [first + ROW * place for place in range(max(count, 1))]
        for y, (wire, ohms) in zip(heights, rows):
            self.page.text((self.x + 26, y), fitted(self._source(part, wire), 23), align="right")
            self.symbols.part("Resistor", (self.x + 27, y), (bus, y), engineering(ohms, "Ω"))
        if len(rows) > count:
            words = f"and {len(rows) - count} more inputs"
            self.page.text((self.x + 26, heights[-1] + ROW), words, align="right")
        self.symbols.wire([(bus, heights[0]), (bus, heights[-1])])
        level = heights[(len(heights) - 1) // 2]
        minus = (self.x + 51.0, level)
        self.symbols.wire([(bus, level), minus])
        plus, out = self.symbols.amplifier(minus)
        left, right, over = self.x + 47.5, self.x + 70.0, first - 6.5
        corner = (plus[0] - 1.5, plus[1] + 1.5)
        self.symbols.wire([plus, (corner[0], plus[1]), corner])
        self.symbols.ground(corner)
        self.symbols.dot((left, level))
        self.symbols.wire([(left, level), (left, over)])
        self._feedback(part, (left, over), (right, over), out)
        self.symbols.wire([(right, over), (right, out[1])])
        self.symbols.dot((right, out[1]))
        self._out((right + 2, out[1]), start=out)
        self._notes()

    def _feedback(
        self,
        part: Amplifier,
        left: tuple[float, float],
        right: tuple[float, float],
        out: tuple[float, float],
    ) -> None:
        start, circuit = left, self.circuit
        if not isinstance(part, Integrator):
            start = ((left[0] + right[0]) / 2, left[1]) if isinstance(part, PICell) else right
            ohms = engineering(circuit.feedback[part.name], "Ω")
            self.symbols.part("Resistor", left, start, ohms)
        if not isinstance(part, Adder):
            farads = float(circuit.own_capacitors(part.name)[self.drawn.stage])
            self.symbols.part("Capacitor", start, right, engineering(farads, "F"))
        if isinstance(part, Integrator) and part.with_limits:
            self._limits(part, left, right)
        if isinstance(part, PICell) and part.rectified:
            self._diodes(out, right)
        else:
            self.symbols.wire([out, (right[0], out[1])])

    def _limits(
        self, part: Integrator, left: tuple[float, float], right: tuple[float, float]
    ) -> None:
        """Draw clamps across the capacitor, unless all limits exceed full scale."""
        if not np.isfinite(self.circuit.limits(part)).any():
            return
        over = left[1] - 5.0
        self.symbols.clamp((left[0], over), (right[0], over), self._rail_words(part))
        self.symbols.wire([left, (left[0], over)])
        self.symbols.wire([right, (right[0], over)])

    def _rail_words(self, part: Integrator) -> str:
        """Return both limits in volts; beyond full scale no clamp is built."""
        sign, volts = self.circuit.schematic.polarity[part.name], self.circuit.scaling.volts
        limits = (part.limiter.low, part.limiter.high)
        ends = sorted(float(sign * volts(part.name, end)) for end in limits)
        words = [
            engineering(end, "V") + ("" if np.isfinite(built) else " (beyond full scale)")
            for end, built in zip(ends, self.circuit.limits(part))
            if np.isfinite(end)
        ]
        return "rails " + ", ".join(words)

    def _diodes(self, out: tuple[float, float], right: tuple[float, float]) -> None:
        """Draw the output diode, and the diode that maintains the virtual ground meanwhile."""
        x, y = out
        self.symbols.part("Diode", (right[0], y), (x, y))
        below = y + 6.5
        self.symbols.wire([(x, y), (x, below)])
        ground = (self.x + 47.5, below)
        self.symbols.part("Diode", (x, below), ground)
        self.symbols.wire([ground, (ground[0], y - AMPLIFIER[1] / 2)])
        hold = engineering(HOLD * self.circuit.inverter, "Ω")
        self.symbols.part("Resistor", (right[0], y), (right[0], y + 6.5), hold)
        self.symbols.ground((right[0], y + 6.5))

    def _out(self, at: tuple[float, float], start: tuple[float, float] | None = None) -> None:
        name = self.part.name
        sign = "−" if self.circuit.schematic.polarity.get(name, 1) < 0 else ""
        if start is not None:
            self.symbols.wire([(at[0] - 2, at[1]), at])
        room = self.x + PANEL - 2 - at[0] - 1
        self.page.text((at[0] + 1, at[1]), fitted(sign + name, room))

    def _notes(self) -> None:
        """Draw notes on additional elements: an inverter."""
        name, schematic = self.part.name, self.circuit.schematic
        y = self.y + self.drawn.foot + FOOT - 4
        if schematic.collects(name):
            self.page.text((self.x + PANEL - 3, y), "one; inputs from every cell", align="right")
        if name in schematic.inverted:
            ohms = engineering(self.circuit.inverter, "Ω")
            sign = "" if schematic.polarity[name] < 0 else "−"
            words = f"an inverter of two {ohms} gives {sign}{name}"
            self.page.text((self.x + 3, y), fitted(words, 42))

    def _source(self, part: Amplifier, wire: Wire) -> str:
        """Return a source with its sign and its cell."""
        sign = self.circuit.schematic.reading(part, wire)[self.drawn.stage]
        lead = "−" if sign < 0 else ""
        whose = f" of {cell_at(wire.offset)}" if wire.offset else ""
        return f"{lead}{'bias 1' if wire.source == ONE else wire.source}{whose}"

    def _signed(self, source: str) -> str:
        return ("−" if self.circuit.schematic.sign(source) < 0 else "") + source


def engineering(value: float, unit: str) -> str:
    """Format a value with an SI prefix and typographic signs.

    Examples
    --------
    >>> engineering(15227.1, "Ω"), engineering(2e-5, "F"), engineering(-0.25, "V")
    ('15.23 kΩ', '20 µF', '−250 mV')
    """
    return prefixes.engineering(value, unit).replace("-", "−").replace(" u", " µ")
