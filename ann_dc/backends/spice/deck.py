"""A netlist from components: one cell subcircuit, N instances, a parameter for every component.

Top-level nodes are ``<part>__<stage>``, the inverted output of a part ``<part>__<stage>__n``. Names
of nodes are lower-case letters, digits and single underscores, unique whatever the case in the
network; the double underscore is ours. Same input, same bytes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.backends.spice.levels import Level
from ann_dc.errors import NetworkError
from ann_dc.network.cell import ONE
from ann_dc.network.components import Components
from ann_dc.network.functions import function_block
from ann_dc.network.scaling import OWN
from ann_dc.network.schematic import (
    Adder,
    Generator,
    Integrator,
    Multiplier,
    Part,
    PICell,
    needs,
)

LINE = 100
"""Longest line; longer ones are continued."""

RELEASE = 1e-3
"""Network time at which the reset switches open."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Deck:
    """A netlist, and where to find every node of the network in its results.

    Attributes
    ----------
    text : str
    signals : dict of (node name, stage) to str
        Top-level node of every part; pinned and absent ones are left out.
    release, end : float
        Seconds at which the reset switches open, and at which the run ends.
    """

    text: str
    signals: dict[tuple[str, int], str]
    release: float
    end: float


def deck(made: Components, level: Level, *, duration: float, points: int = 1000) -> Deck:
    """Write the netlist of a network.

    Parameters
    ----------
    made : Components
    level : Level
    duration : float
        In units of network time.
    points : int
        Largest step of the transient, as a share of the duration.
    """
    return _Writer(made, level).deck(duration, points)


class _CellText:
    """Cards of one cell, with its nodes seen from inside, and the values that cards refer to."""

    def __init__(self, stage: int) -> None:
        self.stage = stage
        self.lines: list[str] = []
        self.values: dict[str, float] = {}
        self.ports: dict[str, str] = {}

    def comment(self, text: str) -> None:
        """A line for the reader."""
        self.lines.append(f"* {_comment(text)}")

    def value(self, name: str, number: float) -> str:
        """A parameter of the cell, and how a card refers to it."""
        self.values[name] = number
        return f"{{{name}}}"

    def card(self, name: str, nodes: tuple[str, ...], kind: str, given: Mapping[str, str]) -> None:
        """One element: its nodes by their top-level names, ``@`` before those of the cell alone."""
        inside = " ".join(self._inside(node) for node in nodes)
        parameters = "".join(f" {key}={text}" for key, text in given.items())
        self.lines.append(_wrapped(f"{name} {inside} {kind}{parameters}"))

    def _inside(self, node: str) -> str:
        if node == "0":
            return node
        if node.startswith("@"):
            return node[1:]
        if node not in self.ports:
            self.ports[node] = self._local(node)
        return self.ports[node]

    def _local(self, node: str) -> str:
        where = re.fullmatch(r"(?P<name>.+?)__(?P<stage>-?\d+)(?P<sign>__n)?", node)
        if where is None:
            return node
        offset = int(where["stage"]) - self.stage
        side = {0: "", -1: "prev__", 1: "next__"}[offset]
        return side + where["name"] + (where["sign"] or "")

    @property
    def shape(self) -> tuple:
        """What two cells must share to be instances of one subcircuit."""
        return tuple(self.lines), tuple(self.values), tuple(self.ports.values())

    def subcircuit(self, name: str) -> list[str]:
        """The definition, with this cell's values as defaults."""
        given = " ".join(f"{key}={_number(value)}" for key, value in self.values.items())
        head = f".subckt {name} {' '.join(self.ports.values())} params: {given}"
        return [_wrapped(head), *self.lines, f".ends {name}", ""]

    def instance(self, card: str, name: str, first: _CellText) -> str:
        """This cell as an instance of a definition made from ``first``."""
        other = [
            f"{key}={_number(value)}"
            for key, value in self.values.items()
            if value != first.values[key]
        ]
        return _wrapped(" ".join([card, *self.ports, name, *other]))


class _Writer:
    def __init__(self, made: Components, level: Level) -> None:
        self.made, self.level = made, level
        self.schematic, self.scaling = made.schematic, made.scaling
        self.network = self.schematic.network
        self.inverted = needs(self.schematic)
        names = [*self.schematic.polarity, *self.network.cell.inputs, ONE]
        self.alias = _aliases(names)
        self.chained = [n for chain in self.network.cell.chains for n in chain]
        self.coupled = self.schematic.coupling is not None
        self.sources: dict[str, float] = {}

    # ---- names of nodes ----------------------------------------------------------------------

    def node(self, name: str, stage: int, sign: int) -> str:
        """Top-level node that carries ``sign`` times a part's, a pin's or an input's value."""
        if name in self.network.cell.inputs or name == ONE:
            value = 1.0 if name == ONE else float(np.asarray(self.network.inputs[name])[stage])
            return self._source(name, stage, sign * self.scaling.volts(name, value))
        pinned = self.pins.get((name, stage))
        if pinned is not None:
            value = float(np.asarray(self.network.inputs[pinned])[stage])
            return self._source(name, stage, sign * self.scaling.volts(name, value))
        if not self.alive(name, stage):
            return "0"
        own = self.schematic.polarity[name]
        return f"{self.alias[name]}__{stage}" + ("" if own == sign else "__n")

    @cached_property
    def pins(self) -> dict[tuple[str, int], str]:
        """Inputs that replace neurons, by (neuron, stage)."""
        return {(pin.neuron, pin.stage): pin.input for pin in self.network.pins}

    def alive(self, name: str, stage: int) -> bool:
        """Whether a part is there at a stage."""
        part = self.schematic.by_name.get(name)
        if isinstance(part, (Integrator, PICell)):
            return bool(part.rate[stage] > 0)
        if part is None:  # the adder of a t or q under coordinators
            return self.alive(OWN + name, stage)
        return True

    def _source(self, name: str, stage: int, volts: float) -> str:
        if volts == 0:
            return "0"
        node = f"src__{self.alias[name]}__{stage}" + ("__n" if volts < 0 else "")
        self.sources[node] = volts
        return node

    # ---- the cell ----------------------------------------------------------------------------

    def cell(self, stage: int) -> _CellText:
        """Cards and values of one cell."""
        text = _CellText(stage)
        for part in self.schematic.parts:
            if not self.alive(part.name, stage):
                continue
            text.comment(f"{part.name}: {_describe(part)}")
            if isinstance(part, Multiplier):
                self._multiplier(text, part, stage)
            elif isinstance(part, Generator):
                self._generator(text, part, stage)
            else:
                self._amplifier(text, part, stage)
            self._inverter(text, part.name, stage)
        return text

    def _inverter(self, text: _CellText, name: str, stage: int) -> None:
        if name in self.inverted:
            own = self.schematic.polarity[name]
            alias = self.alias[name]
            given = self.node(name, stage, own), self.node(name, stage, -own)
            text.card(f"Xn_{alias}", given, "inv", {"vos": text.value(f"vos_n_{alias}", 0.0)})

    def _amplifier(self, text: _CellText, part, stage: int) -> None:
        alias, made = self.alias[part.name], self.made
        summing = f"@s__{alias}"
        for number, wire in enumerate(part.wires):
            ohms = made.resistors[part.name][number, stage]
            source = self.reading(wire, stage, part.name)
            if source == "0" or not np.isfinite(ohms):
                continue
            value = text.value(f"r_{alias}_{number}", ohms)
            text.card(f"R_{alias}_{number}", (source, summing), value, {})
        out = self.node(part.name, stage, self.schematic.polarity[part.name])
        vos = {"vos": text.value(f"vos_{alias}", 0.0)}
        if isinstance(part, Adder):
            rf = {"rf": text.value(f"rf_{alias}", made.feedback[part.name])}
            text.card(f"X_{alias}", (summing, out), "sum", rf | vos)
            return
        held = {
            "c": text.value(f"c_{alias}", made.capacitors[part.name]),
            "v0": text.value(f"v0_{alias}", float(made.presets[part.name][stage])),
        }
        if isinstance(part, PICell):
            held = {"rf": text.value(f"rf_{alias}", made.feedback[part.name])} | held
        kind = "pi_cell" if isinstance(part, PICell) else "integ"
        text.card(f"X_{alias}", (summing, out, "rst"), kind, held | vos)

    def reading(self, wire, stage: int, target: str) -> str:
        """Node whose current has the sign that an inverting part needs."""
        sign = -int(np.sign(wire.weight[stage])) * self.schematic.polarity[target]
        where = stage + wire.offset
        if 0 <= where < self.network.stages:
            return self.node(wire.source, where, sign) if sign else "0"
        entering = self.network.left.get(wire.source) if where < 0 else None
        if entering is None or sign == 0:
            return "0"
        value = float(np.asarray(self.network.inputs[entering])[0])
        return self._source(wire.source, where, sign * self.scaling.volts(wire.source, value))

    def _multiplier(self, text: _CellText, part: Multiplier, stage: int) -> None:
        polarity = self.schematic.polarity
        signs = [polarity.get(name, 1) for name in (part.a, part.b)]
        a, b = (self.node(n, stage, s) for n, s in zip((part.a, part.b), signs))
        swap = signs[0] * signs[1] * polarity[part.name] < 0
        alias = self.alias[part.name]
        nodes = (
            *(("0", a) if swap else (a, "0")),
            b,
            "0",
            "0",
            self.node(part.name, stage, polarity[part.name]),
        )
        errors = {e: text.value(f"{e}_{alias}", 0.0) for e in ("ge", "ox", "oy", "oz")}
        text.card(f"X_{alias}", nodes, "mul4q", {"vm": f"{self.scaling.full_scale:.9g}"} | errors)

    def _generator(self, text: _CellText, part: Generator, stage: int) -> None:
        polarity, scaling = self.schematic.polarity, self.scaling
        sign = polarity.get(part.x, 1)
        low, high = _range(part, scaling)
        alias = self.alias[part.name]
        given = {
            "sx": f"{sign * scaling.unit[part.x] / scaling.full_scale:.9g}",
            "sy": f"{polarity[part.name] * scaling.unit[part.name] / scaling.full_scale:.9g}",
            "lo": f"{low:.9g}",
            "hi": f"{high:.9g}",
        }
        errors = {e: text.value(f"{e}_{alias}", 0.0) for e in ("ge", "oy")}
        nodes = (self.node(part.x, stage, sign), self.node(part.name, stage, polarity[part.name]))
        text.card(f"X_{alias}", nodes, f"func_{part.function}", given | errors)

    # ---- the coordinators --------------------------------------------------------------------

    def coordinators(self) -> list[str]:
        """The adders z = M D of all t and q, at top level."""
        if not self.coupled:
            return []
        made, stages = self.made, self.network.stages
        places = [
            (chain[p % 2], p // 2) for chain in self.network.cell.chains for p in range(2 * stages)
        ]
        lines = ["* coarse coordinators: every t and q is the weighted sum of the own integrators"]
        for row, (name, stage) in enumerate(places):
            if not self.alive(name, stage):
                continue
            alias, own = f"{self.alias[name]}__{stage}", self.schematic.polarity[name]
            for column, (source, where) in enumerate(places):
                ohms = made.coupling[row, column]  # pyright: ignore[reportOptionalSubscript]
                if not np.isfinite(ohms):
                    continue
                weight = self.schematic.coupling[row, column]  # pyright: ignore[reportOptionalSubscript]
                node = self.node(OWN + source, where, -int(np.sign(weight)) * own)
                lines.append(f"R_m__{row}__{column} {node} s__{alias} {_number(ohms)}")
            feedback = _number(made.coupling_feedback[row])  # pyright: ignore[reportOptionalSubscript]
            lines.append(f"X_m__{alias} s__{alias} {self.node(name, stage, own)} sum rf={feedback}")
            if name in self.inverted:
                nodes = f"{self.node(name, stage, own)} {self.node(name, stage, -own)}"
                lines.append(f"X_n__{alias} {nodes} inv")
        return lines

    # ---- the deck ----------------------------------------------------------------------------

    def deck(self, duration: float, points: int) -> Deck:
        T = self.scaling.time
        release = RELEASE * T
        end = release + duration * T
        stages = range(self.network.stages)
        cells = [self.cell(stage) for stage in stages]
        groups: dict[tuple, list[int]] = {}
        for stage, cell in zip(stages, cells):
            groups.setdefault(cell.shape, []).append(stage)
        body: list[str] = []
        instances: list[str] = []
        for number, members in enumerate(groups.values()):
            name, first = f"cell_{number}", cells[members[0]]
            body += first.subcircuit(name)
            instances += [
                cells[stage].instance(f"X_cell_{stage}", name, first) for stage in members
            ]
        coordinators = self.coordinators()
        signals = self._signals()
        saved = " ".join(f"v({node})" for node in signals.values())
        lines = [
            f"* {_comment(self.network.title)}: {self.network.stages} cells, "
            f"{self.level.name} level",
            f"* full scale {self.scaling.full_scale:g} V = the unit of a node; "
            f"network time 1 = {T:.6g} s",
            *(
                f"*   {_comment(name)} -> {self.alias[name]}_<stage>, unit "
                f"{self.scaling.unit[name]:.6g}, polarity {sign:+d}"
                for name, sign in self.schematic.polarity.items()
            ),
            self.level.text(),
            "* ---- cells",
            *body,
            "* ---- the row",
            *instances,
            *coordinators,
            "* ---- inputs and reset",
            *(
                f"V_{node} {node} 0 {_number(volts)}"
                for node, volts in sorted(self.sources.items())
            ),
            f"V_rst rst 0 PWL(0 5 {_number(0.5 * release)} 5 {_number(release)} 0)",
            ".options method=trap reltol=1e-4 abstol=1e-12 vntol=1e-7",
            _wrapped(f".save {saved}"),
            f".tran {_number((end - release) / points)} {_number(end)} 0 "
            f"{_number((end - release) / points)}",
            ".end",
        ]
        return Deck(text="\n".join(lines) + "\n", signals=signals, release=release, end=end)

    def _signals(self) -> dict[tuple[str, int], str]:
        polarity = self.schematic.polarity
        return {
            (name, stage): self.node(name, stage, polarity[name])
            for name in polarity
            for stage in range(self.network.stages)
            if self.alive(name, stage) and (name, stage) not in self.pins
        }


def _aliases(names: list[str]) -> dict[str, str]:
    """A name for the netlist for every node: lower case, unique, no double underscore."""
    aliases: dict[str, str] = {}
    taken: set[str] = set()
    for name in names:
        if not name.isprintable() or len(name) > 200:
            raise NetworkError(f"circuit: {name!r} is no name that a netlist can carry")
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower().replace("*", "_x_")).strip("_") or "node"
        plain = plain[:40].strip("_") if plain[0].isalpha() else f"n_{plain[:40]}".strip("_")
        alias, number = plain, 2
        while alias in taken:
            alias, number = f"{plain}_v{number}", number + 1
        taken.add(alias)
        aliases[name] = alias
    return aliases


def _range(part: Generator, scaling) -> tuple[float, float]:
    """Where a function generator is built: the range that was seen and a quarter, in the domain."""
    peak = scaling.peaks[part.x]
    spare = 0.25 * max(peak.high - peak.low, 0.1)
    low, high = function_block(part.function).domain
    inside = 0.02 * min(high - low, 1.0)
    return max(peak.low - spare, low + inside), min(peak.high + spare, high - inside)


def _describe(part: Part) -> str:
    if isinstance(part, Multiplier):
        return f"{part.a} times {part.b}"
    if isinstance(part, Generator):
        return f"{part.function} of {part.x}"
    kind = {Integrator: "integrator", PICell: "PI dual", Adder: "adder"}[type(part)]
    return f"{kind} of " + ", ".join(
        wire.source + {-1: " (previous)", 0: "", 1: " (next)"}[wire.offset] for wire in part.wires
    )


def _comment(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _number(value: float) -> str:
    return f"{value:.9g}"


def _wrapped(line: str) -> str:
    """The line, continued with ``+`` where it is long."""
    rows, row = [], ""
    for word in line.split(" "):
        if row and len(row) + 1 + len(word) > LINE:
            rows.append(row)
            row = "+ " + word
        else:
            row = f"{row} {word}" if row else word
    return "\n".join([*rows, row])
