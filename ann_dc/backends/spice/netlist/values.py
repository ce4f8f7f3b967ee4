"""Nodes of a netlist: names, values and signs.

Top-level nodes are ``<part>__<stage>``, and the inverted output of a part is
``<part>__<stage>__n``. A part that exists once for the row has ``<part>__bus``, a line to every
cell. Node names are lower-case letters, digits and single underscores, unique regardless of case in
the network. The double underscore is reserved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText
from ann_dc.hardware.circuit.circuit import Circuit, Quantity
from ann_dc.hardware.schematic.elements import Amplifier, Wire
from ann_dc.network.cell import ONE

NEGATIVE = "__n"
"""Suffix of the name of a node that carries the negative."""

BUS = "__bus"
"""Suffix of the name of a line to every cell."""

SOURCE = "src__"
"""Prefix of the name of a constant source's node."""


class Nodes:
    """Node names of one circuit, with the volts of every input and constant in use.

    ``sources`` has the volts at time zero by node, and ``driven`` the input and the volts per unit
    of its node's value, for nodes that follow an input over time.
    """

    def __init__(self, circuit: Circuit) -> None:
        self.circuit, self.alias = circuit, circuit.alias
        self.schematic, self.scaling = circuit.schematic, circuit.scaling
        self.network = circuit.schematic.network
        self.sources: dict[str, float] = {}
        self.driven: dict[str, tuple[str, int, float]] = {}

    def node(self, name: str, stage: int, sign: int) -> str:
        """Return the top-level node of ``sign`` times the value of a part, pin or input."""
        name = self.schematic.carrier(name)
        if name in self.network.cell.inputs or name == ONE:
            if name != ONE:
                return self._source(name, stage, sign, name)
            return self._constant(name, stage, sign * self.scaling.volts(name, 1.0))
        pinned = self.schematic.pins.get((name, stage))
        if pinned is not None:
            return self._source(name, stage, sign, pinned)
        if not self.schematic.alive(name, self.schematic.cell_of(name, stage)):
            return "0"
        plain = self.alias[name] + (BUS if name in self.schematic.shared else f"__{stage}")
        return plain if self.schematic.polarity[name] == sign else self.opposite(plain)

    def own(self, name: str, stage: int) -> str:
        """Return the node that is a part's direct output."""
        return self.node(name, stage, self.schematic.polarity[name])

    def summing(self, name: str) -> str:
        """Return a part's virtual ground: a node of its cell, or a line to its senders."""
        plain = f"s__{self.alias[name]}"
        return plain + BUS if self.schematic.collects(name) else "@" + plain

    def opposite(self, node: str) -> str:
        """Return the node with the negative of another node's voltage."""
        other = node.removesuffix(NEGATIVE) if node.endswith(NEGATIVE) else node + NEGATIVE
        if node.startswith(SOURCE):
            self.sources[other] = -self.sources[node]
            if node in self.driven:
                source, stage, per_value = self.driven[node]
                self.driven[other] = source, stage, -per_value
        return other

    def plain(self, node: str) -> str:
        """Return a node, or for a negative node its positive counterpart."""
        return self.opposite(node) if node.endswith(NEGATIVE) else node

    def sign(self, node: str) -> int:
        """Return -1 for the negative of another node, else 1."""
        return -1 if node.endswith(NEGATIVE) else 1

    def reading(self, part: Amplifier, wire: Wire, stage: int) -> str:
        """Return the node whose current has the sign needed by an inverting part, or ``0``."""
        sign = int(self.schematic.reading(part, wire)[stage])
        where = stage + wire.offset
        if sign == 0:
            return "0"
        if 0 <= where < self.network.stages:
            return self.node(wire.source, where, sign)
        entering = self.network.left_boundary.get(wire.source) if where < 0 else None
        if entering is None:
            return "0"
        return self._source(wire.source, where, sign, entering)

    def _source(self, name: str, stage: int, sign: int, source: str) -> str:
        """Return the node of ``sign`` times a node that has the value of an input at a stage."""
        place = max(stage, 0)
        per_value = sign * self.scaling.volts(name, 1.0)
        volts = per_value * float(self.network.input_values[source][place])
        if source not in self.network.waveforms:
            return self._constant(name, stage, volts)
        node = f"{SOURCE}{self.alias[name]}__{stage}" + (NEGATIVE if sign < 0 else "")
        self.sources[node], self.driven[node] = volts, (source, place, per_value)
        return node

    def _constant(self, name: str, stage: int, volts: float) -> str:
        node = f"{SOURCE}{self.alias[name]}__{stage}" + (NEGATIVE if volts < 0 else "")
        self.sources[node] = volts
        return node


@dataclass(frozen=True, kw_only=True)
class Resistor:
    """Resistor of ``ohms``, with its deviation, from a ``source`` node into a summing node.

    ``name`` is that of its parameter. The ``label`` is the common part of the names of its cards
    and values: the part's alias and the wire.
    """

    name: str
    label: str
    source: str
    ohms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Values:
    """Values of a circuit with the deviations of its parts.

    Deviations (N,) by parameter name are relative for resistors, capacitors and gains, and in volts
    for offsets.
    """

    circuit: Circuit
    deviations: Mapping[str, np.ndarray]

    def parameter(self, text: CellText, part: str, quantity: Quantity, nominal: float = 0.0) -> str:
        """Add a cell parameter and return the card's reference; errors are nominally zero."""
        name = self.circuit.parameter_name(part, quantity)
        return text.value(name, self._off(name, text.stage, nominal))

    def feedback(self, part: str, stage: int) -> float:
        """Return the feedback resistance of a part in ohms."""
        name = self.circuit.parameter_name(part, Quantity.FEEDBACK)
        return self._off(name, stage, self.circuit.feedback[part])

    def resistors(self, nodes: Nodes, part: Amplifier, stage: int) -> Iterator[Resistor]:
        """Yield every resistor into a part's summing node that has a source."""
        for position, wire in enumerate(part.wires):
            ohms = self.circuit.resistors[part.name][position, stage]
            source = nodes.reading(part, wire, stage)
            if source != "0" and np.isfinite(ohms):
                name = self.circuit.parameter_name(part.name, Quantity.INPUT, position)
                yield Resistor(
                    name=name,
                    label=f"{nodes.alias[part.name]}_{position}",
                    source=source,
                    ohms=self._off(name, stage, ohms),
                )

    def _off(self, name: str, stage: int, nominal: float) -> float:
        off = float(self.deviations[name][stage]) if name in self.deviations else 0.0
        return nominal * (1 + off) if nominal else off
