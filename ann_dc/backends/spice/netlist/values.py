"""Values of a circuit's parts as a cell has them: nominal ones, off by their deviations.

Nodes of a netlist: which one carries a value, with which sign.

Top-level nodes are ``<part>__<stage>``, the inverted output of a part ``<part>__<stage>__n``; that
of a part which stands once for the row is ``<part>__bus``, a line to every cell. Names of nodes are
lower-case letters, digits and single underscores, unique whatever the case in the network; the
double underscore is ours.
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
"""Ends the name of a node that carries the negative."""

BUS = "__bus"
"""Ends the name of a line to every cell."""

SOURCE = "src__"
"""Starts the name of a constant source's node."""


class Nodes:
    """Names the nodes of one circuit, and remembers which constant sources were asked for.

    Attributes
    ----------
    circuit : Circuit
        Whose nodes they are.
    alias : mapping of part name to str
        Names that a netlist can carry.
    sources : dict of node to float
        Volts of every constant source that a card reads.
    """

    def __init__(self, circuit: Circuit) -> None:
        self.circuit, self.alias = circuit, circuit.alias
        self.schematic, self.scaling = circuit.schematic, circuit.scaling
        self.network = circuit.schematic.network
        self.sources: dict[str, float] = {}

    def node(self, name: str, stage: int, sign: int) -> str:
        """Top-level node that carries ``sign`` times a part's, a pin's or an input's value."""
        name = self.schematic.carrier(name)
        if name in self.network.cell.inputs or name == ONE:
            value = 1.0 if name == ONE else self._given(name, stage)
            return self._source(name, stage, sign * self.scaling.volts(name, value))
        pinned = self.schematic.pins.get((name, stage))
        if pinned is not None:
            volts = self.scaling.volts(name, self._given(pinned, stage))
            return self._source(name, stage, sign * volts)
        if not self.schematic.alive(name, self.schematic.cell_of(name, stage)):
            return "0"
        plain = self.alias[name] + (BUS if name in self.schematic.shared else f"__{stage}")
        return plain if self.schematic.polarity[name] == sign else self.opposite(plain)

    def own(self, name: str, stage: int) -> str:
        """The node that is a part's own output."""
        return self.node(name, stage, self.schematic.polarity[name])

    def summing(self, name: str) -> str:
        """The virtual ground of a part: a node of its cell, or a line to all that send to it."""
        plain = f"s__{self.alias[name]}"
        return plain + BUS if self.schematic.collects(name) else "@" + plain

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

    def reading(self, part: Amplifier, wire: Wire, stage: int) -> str:
        """Node whose current has the sign that an inverting part needs; ``0`` for no source."""
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

    def _given(self, name: str, stage: int) -> float:
        return float(self.network.input_values[name][stage])

    def _source(self, name: str, stage: int, volts: float) -> str:
        node = f"{SOURCE}{self.alias[name]}__{stage}" + (NEGATIVE if volts < 0 else "")
        self.sources[node] = volts
        return node


@dataclass(frozen=True, kw_only=True)
class Resistor:
    """A resistor into a part's summing node.

    Attributes
    ----------
    name : str
        Of its parameter.
    label : str
        What cards and values that stand for it have in common: the part's alias and the wire.
    source : str
        Node that it comes from.
    ohms : float
        With its deviation.
    """

    name: str
    label: str
    source: str
    ohms: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Values:
    """A circuit's values with the deviations of its parts.

    Attributes
    ----------
    circuit : Circuit
    deviations : mapping of parameter name to (N,) array
        Shares of resistors, capacitors and gains; volts of offsets.
    """

    circuit: Circuit
    deviations: Mapping[str, np.ndarray]

    def parameter(self, text: CellText, part: str, quantity: Quantity, nominal: float = 0.0) -> str:
        """A parameter of the cell, and how a card refers to it; errors are nominally zero."""
        name = self.circuit.parameter_name(part, quantity)
        return text.value(name, self._off(name, text.stage, nominal))

    def feedback(self, part: str, stage: int) -> float:
        """Ohms of a part's feedback resistor."""
        name = self.circuit.parameter_name(part, Quantity.FEEDBACK)
        return self._off(name, stage, self.circuit.feedback[part])

    def resistors(self, nodes: Nodes, part: Amplifier, stage: int) -> Iterator[Resistor]:
        """Every resistor into a part's summing node that has a source."""
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
