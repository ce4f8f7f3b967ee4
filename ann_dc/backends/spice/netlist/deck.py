"""A netlist from components: one cell subcircuit, N instances, a parameter for every component.

Top-level nodes are ``<part>__<stage>``, the inverted output of a part ``<part>__<stage>__n``. Names
of nodes are lower-case letters, digits and single underscores, unique whatever the case in the
network; the double underscore is ours. Same input, same bytes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText, commented, number, wrapped
from ann_dc.backends.spice.netlist.timing import Timing
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Components
from ann_dc.hardware.circuit.cost import parts_of
from ann_dc.hardware.circuit.coupling import OWN
from ann_dc.hardware.circuit.deviations import Deviations, checked, parameters
from ann_dc.hardware.circuit.elements import Adder, Generator, Integrator, Multiplier, Part, PICell
from ann_dc.hardware.parts.levels import Level
from ann_dc.network.cell import ONE
from ann_dc.network.functions import function_block

NEGATIVE = "__n"
"""Ends the name of a node that carries the negative."""

SOURCE = "src__"
"""Starts the name of a constant source's node."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Deck:
    """A netlist, and where to find every node of the network in its results.

    Attributes
    ----------
    text : str
    signals : dict of (node name, stage) to str
        Top-level node of every part; pinned and absent ones are left out.
    timing : Timing
    parts : dict of str to int
        What it takes to build.
    """

    text: str
    signals: dict[tuple[str, int], str]
    timing: Timing
    parts: dict[str, int]

    @property
    def end(self) -> float:
        """Seconds at which the run ends."""
        return self.timing.end


def deck(
    made: Components,
    level: Level,
    *,
    duration: float,
    deviations: Deviations | None = None,
) -> Deck:
    """Write the netlist of a network.

    Parameters
    ----------
    made : Components
    level : Level
    duration : float
        In units of network time.
    deviations : mapping of parameter name to (N,) array, optional
        Which part is off by how much; see `ann_dc.hardware.circuit.deviations`.

    Raises
    ------
    UnknownNameError
        If a deviation names no parameter.
    NetworkError
        If the level's cells have no such error.
    """
    off = _deviations(made, level, deviations) if deviations else {}
    return Writer(made, level, off).deck(duration)


def _deviations(made: Components, level: Level, given: Deviations) -> dict[str, np.ndarray]:
    known = parameters(made)
    off = checked(known, given)
    for parameter in known:
        if parameter.kind in level.technology.without and off.pop(parameter.name, ZERO).any():
            raise NetworkError(
                f"deviation of {parameter.name}: {level.name} cells have no {parameter.told}; "
                "leave it out"
            )
    return off


ZERO = np.zeros(1)


class Writer:
    """Writes one deck; technologies ask it for nodes and values."""

    def __init__(self, made: Components, level: Level, deviations: Deviations) -> None:
        self.made, self.level, self.deviations = made, level, deviations
        self.schematic, self.scaling = made.schematic, made.scaling
        self.network = self.schematic.network
        self.alias = self.schematic.alias
        self.sources: dict[str, float] = {}
        self.inner = 0
        self.kinds: Counter[str] = Counter()

    # ---- nodes -------------------------------------------------------------------------------

    def node(self, name: str, stage: int, sign: int) -> str:
        """Top-level node that carries ``sign`` times a part's, a pin's or an input's value."""
        if name in self.network.cell.inputs or name == ONE:
            value = 1.0 if name == ONE else self._given(name, stage)
            return self._source(name, stage, sign * self.scaling.volts(name, value))
        pinned = self.schematic.pins.get((name, stage))
        if pinned is not None:
            volts = self.scaling.volts(name, self._given(pinned, stage))
            return self._source(name, stage, sign * volts)
        if not self.schematic.alive(name, stage):
            return "0"
        plain = f"{self.alias[name]}__{stage}"
        return plain if self.schematic.polarity[name] == sign else self.opposite(plain)

    def own(self, name: str, stage: int) -> str:
        """The node that is a part's own output."""
        return self.node(name, stage, self.schematic.polarity[name])

    def opposite(self, node: str) -> str:
        """The node with the negative of another one's voltage."""
        other = node.removesuffix(NEGATIVE) if node.endswith(NEGATIVE) else node + NEGATIVE
        if node.startswith(SOURCE):
            self.sources[other] = -self.sources[node]
        return other

    def plain(self, node: str) -> str:
        """A node, or the one that it is the negative of."""
        return self.opposite(node) if node.endswith(NEGATIVE) else node

    def sign(self, node: str) -> int:
        """-1 for the negative of another node, else 1."""
        return -1 if node.endswith(NEGATIVE) else 1

    def _given(self, name: str, stage: int) -> float:
        return float(np.asarray(self.network.inputs[name])[stage])

    def _source(self, name: str, stage: int, volts: float) -> str:
        node = f"{SOURCE}{self.alias[name]}__{stage}" + (NEGATIVE if volts < 0 else "")
        self.sources[node] = volts
        return node

    # ---- values ------------------------------------------------------------------------------

    def value(self, text: CellText, name: str, stage: int, nominal: float = 0.0) -> str:
        """A parameter of the cell, off by its deviation; errors have a nominal value of zero."""
        return text.value(name, self.off(name, stage, nominal))

    def off(self, name: str, stage: int, nominal: float = 0.0) -> float:
        """A parameter's value with its deviation."""
        off = float(self.deviations[name][stage]) if name in self.deviations else 0.0
        return nominal * (1 + off) if nominal else off

    def resistors(self, part, stage: int) -> Iterator[tuple[str, str, float]]:
        """Name, source node and ohms of every resistor into a part's summing node."""
        alias = self.alias[part.name]
        for position, wire in enumerate(part.wires):
            ohms = self.made.resistors[part.name][position, stage]
            source = self._reading(part, wire, stage)
            if source == "0" or not np.isfinite(ohms):
                continue
            name = f"r_{alias}_{position}"
            yield name, source, self.off(name, stage, ohms)

    def _reading(self, part, wire, stage: int) -> str:
        """Node whose current has the sign that an inverting part needs."""
        sign = int(self.schematic.reading(part, wire)[stage])
        where = stage + wire.offset
        if sign == 0:
            return "0"
        if 0 <= where < self.network.stages:
            return self.node(wire.source, where, sign)
        entering = self.network.left.get(wire.source) if where < 0 else None
        if entering is None:
            return "0"
        volts = self.scaling.volts(wire.source, self._given(entering, 0))
        return self._source(wire.source, where, sign * volts)

    def start_volts(self, name: str, stage: int) -> float:
        """Voltage of a node at the network's start."""
        program = self.network.program
        value = program.node(self.network.start_state, name)[stage]
        return self.schematic.polarity[name] * float(self.scaling.volts(name, value))

    # ---- the cell ----------------------------------------------------------------------------

    def cell(self, stage: int) -> CellText:
        """Cards and values of one cell."""
        text = CellText(stage)
        for part in self.schematic.parts:
            if not self.schematic.alive(part.name, stage):
                continue
            text.comment(f"{part.name}: {_describe(part)}")
            if isinstance(part, Multiplier):
                self._multiplier(text, part, stage)
            elif isinstance(part, Generator):
                self._generator(text, part, stage)
            else:
                self.level.technology.amplifier(self, text, part, stage)
            if part.name in self.schematic.inverted:
                self._inverter(text, part.name, stage)
        return text

    def _inverter(self, text: CellText, name: str, stage: int) -> None:
        alias, own = self.alias[name], self.own(name, stage)
        errors = {
            "r": number(self.made.inverter),
            "e": self.value(text, f"e_n_{alias}", stage),
            "vos": self.value(text, f"vos_n_{alias}", stage),
        }
        text.card(f"Xn_{alias}", (own, self.opposite(own)), "inv", errors)

    def _multiplier(self, text: CellText, part: Multiplier, stage: int) -> None:
        polarity, alias = self.schematic.polarity, self.alias[part.name]
        signs = [polarity.get(name, 1) for name in (part.a, part.b)]
        a, b = (self.node(n, stage, s) for n, s in zip((part.a, part.b), signs))
        swap = signs[0] * signs[1] * polarity[part.name] < 0
        inputs = (*(("0", a) if swap else (a, "0")), b, "0")
        errors = {e: self.value(text, f"{e}_{alias}", stage) for e in ("ge", "ox", "oy", "oz")}
        given = {"vm": number(self.scaling.full_scale)} | errors
        out = self.own(part.name, stage)
        if self.level.technology.both_signs:
            text.card(f"X_{alias}", (*inputs, out, self.opposite(out)), "mul4q_fd", given)
        else:
            text.card(f"X_{alias}", (*inputs, "0", out), "mul4q", given)

    def _generator(self, text: CellText, part: Generator, stage: int) -> None:
        alias = self.alias[part.name]
        errors = {e: self.value(text, f"{e}_{alias}", stage) for e in ("ge", "oy")}
        nodes = (
            self.node(part.x, stage, self.schematic.polarity.get(part.x, 1)),
            self.own(part.name, stage),
        )
        if self.level.functions is not None:
            text.card(f"X_{alias}", nodes, f"curve_{alias}", errors, counts_as="function")
            return
        low, high = built_range(part, self.scaling)
        sx, sy = self._slopes(part)
        given = {"sx": number(sx), "sy": number(sy), "lo": number(low), "hi": number(high)}
        kind = f"func_{part.function}"
        text.card(f"X_{alias}", nodes, kind, given | errors, counts_as="function")

    def _slopes(self, part: Generator) -> tuple[float, float]:
        """Values that a volt at a generator's input and at its output stand for."""
        polarity, scaling = self.schematic.polarity, self.scaling
        return (
            polarity.get(part.x, 1) * scaling.unit[part.x] / scaling.full_scale,
            polarity[part.name] * scaling.unit[part.name] / scaling.full_scale,
        )

    def curves(self) -> list[str]:
        """Function generators made of parts: one subcircuit for each of the cell's."""
        if self.level.functions is None:
            return []
        lines = []
        for part in self.schematic.parts:
            if isinstance(part, Generator):
                low, high = built_range(part, self.scaling)
                made = self.level.functions.generator(
                    f"curve_{self.alias[part.name]}", part.function, low, high, *self._slopes(part)
                )
                lines += [made.text.rstrip(), ""]
                self.inner += made.multipliers * self.network.stages
        return lines

    # ---- the coordinators --------------------------------------------------------------------

    def coordinators(self) -> list[str]:
        """The adders z = M D of all t and q, at top level."""
        if self.schematic.coupling is None:
            return []
        places = [
            (chain[p % 2], p // 2)
            for chain in self.network.cell.chains
            for p in range(2 * self.network.stages)
        ]
        lines = ["* coarse coordinators: every t and q is the weighted sum of the own integrators"]
        for row, (name, stage) in enumerate(places):
            if self.schematic.alive(name, stage):
                lines += self._coordinator(row, name, stage, places)
        return lines

    def _coordinator(self, row: int, name: str, stage: int, places) -> list[str]:
        made, schematic = self.made, self.schematic
        coupling, ohms = made.schematic.coupling, made.coupling
        feedback_ohms = made.coupling_feedback
        assert coupling is not None
        assert ohms is not None
        assert feedback_ohms is not None
        alias, own = f"{self.alias[name]}__{stage}", self.own(name, stage)
        lines = []
        for column, (source, where) in enumerate(places):
            if np.isfinite(ohms[row, column]):
                sign = -int(np.sign(coupling[row, column])) * schematic.polarity[name]
                given = self.node(OWN + source, where, sign)
                lines.append(
                    f"R_m__{alias}__{column} {given} s__{alias} {number(ohms[row, column])}"
                )
        self.kinds.update({"resistor": len(lines), "sum": 1})
        lines.append(f"X_m__{alias} s__{alias} {own} sum rf={number(feedback_ohms[row])}")
        if name in schematic.inverted:
            self.kinds["inv"] += 1
            given = f"r={number(made.inverter)}"
            lines.append(f"X_n__{alias} {own} {self.opposite(own)} inv {given}")
        return lines

    # ---- the deck ----------------------------------------------------------------------------

    def deck(self, duration: float) -> Deck:
        """The whole netlist."""
        timing = self.level.technology.timing(self.scaling.time, duration, self.level.points)
        cells = [self.cell(stage) for stage in range(self.network.stages)]
        body, instances = _instances(cells)
        coordinators = self.coordinators()
        used = sorted({node for cell in cells for node in cell.ports})
        signals = self._signals()
        saved = " ".join(f"v({node})" for node in signals.values())
        lines = [
            *self._head(),
            self.level.text(),
            *self.curves(),
            "* ---- cells",
            *body,
            "* ---- the row",
            *instances,
            *coordinators,
            *self._copies(used),
            "* ---- inputs and reset",
            *(f"V_{n} {n} 0 {number(self.sources[n])}" for n in used if n in self.sources),
            *self.level.technology.control(timing),
            f".options {self.level.options}",
            wrapped(f".save {saved}"),
            f".tran {number(timing.step)} {number(timing.end)} 0 {number(timing.step)}",
            ".end",
        ]
        text = "\n".join(lines) + "\n"
        return Deck(text=text, signals=signals, timing=timing, parts=self._parts(cells))

    def _parts(self, cells: list[CellText]) -> dict[str, int]:
        for cell in cells:
            self.kinds.update(cell.kinds)
        return parts_of(self.kinds, self.inner)

    def _head(self) -> list[str]:
        scaling = self.scaling
        return [
            f"* {commented(self.network.title)}: {self.network.stages} cells, "
            f"{self.level.name} level",
            "* run by hand: ngspice -b -r out.raw <this file>, or in ngspice: source, run, plot",
            *(f"* {commented(line)}" for line in str(scaling).splitlines()),
            *(
                f"*   {commented(name)} = {sign * self._per_volt(name):.6g} * "
                f"v({self.alias[name]}__<stage>)"
                for name, sign in self.schematic.polarity.items()
            ),
        ]

    def _per_volt(self, name: str) -> float:
        """The value that a volt of a node stands for, in the user's units."""
        neurons = self.network.neuron_index
        unit = self.network.neuron(name).unit if name in neurons else 1.0
        return unit * self.scaling.unit[name] / self.scaling.full_scale

    def _copies(self, used: list[str]) -> list[str]:
        """Negative outputs of parts that have none of their own, in a differential circuit."""
        made = self.level.technology
        if not made.differential:
            return []
        native = {Integrator, PICell, Adder, Multiplier} if made.both_signs else set()
        kinds = {self.alias[part.name]: type(part) for part in self.schematic.parts}
        lines = [
            f"E_{node} {node} 0 {node.removesuffix(NEGATIVE)} 0 -1"
            for node in used
            if node.endswith(NEGATIVE)
            and not node.startswith(SOURCE)
            and kinds[node.split("__")[0]] not in native
        ]
        return ["* negative copies, which a differential circuit has", *lines] if lines else []

    def _signals(self) -> dict[tuple[str, int], str]:
        return {
            (name, stage): self.own(name, stage)
            for name in self.schematic.polarity
            for stage in range(self.network.stages)
            if self.schematic.alive(name, stage) and (name, stage) not in self.schematic.pins
        }


def _instances(cells: list[CellText]) -> tuple[list[str], list[str]]:
    """Subcircuits of the cells that differ, and a card for every cell."""
    groups: dict[tuple, list[CellText]] = {}
    for cell in cells:
        groups.setdefault(cell.shape, []).append(cell)
    body: list[str] = []
    instances: list[str] = []
    for position, members in enumerate(groups.values()):
        name = f"cell_{position}"
        body += members[0].subcircuit(name)
        instances += [m.instance(f"X_cell_{m.stage}", name, members[0]) for m in members]
    return body, instances


def built_range(part: Generator, scaling) -> tuple[float, float]:
    """Where a function generator is built: the range that was seen and a quarter, in the domain.

    Towards an end of the domain it goes half of the way that is left at most.
    """
    peak = scaling.peaks[part.x]
    spare = 0.25 * max(peak.high - peak.low, 0.1 * peak.value, 1e-9)
    low, high = function_block(part.function).domain
    return (
        max(peak.low - spare, 0.5 * (peak.low + low)),
        min(peak.high + spare, 0.5 * (peak.high + high)),
    )


def _describe(part: Part) -> str:
    if isinstance(part, Multiplier):
        return f"{part.a} times {part.b}"
    if isinstance(part, Generator):
        return f"{part.function} of {part.x}"
    kind = {Integrator: "integrator", PICell: "PI dual", Adder: "adder"}[type(part)]
    return f"{kind} of " + ", ".join(
        wire.source + {-1: " (previous)", 0: "", 1: " (next)"}[wire.offset] for wire in part.wires
    )
