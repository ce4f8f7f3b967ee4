"""Values of a circuit's parts as a cell has them: nominal ones, off by their deviations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.netlist.cell_text import CellText
from ann_dc.backends.spice.netlist.nodes import Nodes
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.parameters import Quantity
from ann_dc.hardware.schematic.elements import Amplifier


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
