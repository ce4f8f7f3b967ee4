"""Circuit as built: nominal values, deviations, part data and loads."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit, Quantity
from ann_dc.hardware.circuit.loads import Outputs
from ann_dc.hardware.emulation.assembly import Coupling, Piece, Weight, clipped
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import Amplifier
from ann_dc.network.cell import ONE, Sum
from ann_dc.scale import IDENTITY, Scale


class BuiltCircuit:
    """Circuit with valid deviations of its parts, relative or in volts, each (N,).

    Clamps of limits move if ``moving`` is true. ``omega`` is the gain-bandwidth product of the op
    amps, in radians per unit of network time.
    """

    def __init__(
        self,
        circuit: Circuit,
        level: Level,
        deviations: Mapping[str, np.ndarray],
        moving: bool,
    ) -> None:
        self.circuit, self.level, self.datasheet = circuit, level, level.datasheet
        self.schematic, self.scaling = circuit.schematic, circuit.scaling
        self.ideal, self.stages = circuit.schematic.network, circuit.schematic.network.stages
        self.deviations, self.moving = deviations, moving
        self.outputs = Outputs(circuit, level)
        self.omega = self.outputs.omega

    def deviation(self, part: str, quantity: Quantity, wire: int | None = None) -> np.ndarray:
        """Return the deviation (N,) of a quantity of a part."""
        name = self.circuit.parameter_name(part, quantity, wire)
        return self.deviations.get(name, np.zeros(self.stages))

    def slope(
        self, slope: Weight, part: str, quantity: Quantity, wire: int | None = None
    ) -> tuple[str, Weight]:
        """Return the change of a coupling's weight with a quantity of a part, see `Coupling`."""
        return self.circuit.parameter_name(part, quantity, wire), slope

    def bias(
        self, target: str, per_volt: float, part: str, quantity: Quantity, known: Weight = 0.0
    ) -> Coupling:
        """Return the coupling of the constant one by a voltage error plus ``known`` volts."""
        volts = self.deviation(part, quantity) + known
        slopes = (self.slope(per_volt, part, quantity),)
        return Coupling(ONE, target, volts * per_volt, slopes=slopes)

    def slewing(self, drive: str, name: str, unit: float) -> tuple[str, float, Iterable[Piece]]:
        """Return node and weight of the net inputs of an op amp, and the pieces of its slew rate.

        The op amp is the node ``name``, of ``unit`` per volt. With a finite slew rate its net
        inputs add up at ``drive``, in multiples of the largest slope.
        """
        largest = self.datasheet.slew * self.scaling.time / self.omega * unit
        if math.isinf(largest):
            return name, 1.0, ()
        return drive, 1 / largest, (Sum(name=drive), *clipped(drive, name, largest))

    def scale_of(self, name: str) -> Scale:
        """Return the scale from a node to the user's value."""
        return self.ideal.neuron(name).scale if name in self.ideal.neuron_index else IDENTITY

    def conductance(self, part: Amplifier, scale: np.ndarray) -> np.ndarray:
        """Return Gamma (N,), the weight of the virtual ground relative to the output.

        Wires from all cells count in each cell.
        """
        units, total = self.scaling.unit, np.zeros(self.stages)
        for number, wire in enumerate(part.wires):
            share = np.abs(wire.weight) * units[wire.source] / units[part.name]
            off = self.deviation(part.name, Quantity.INPUT, number)
            total += self.schematic.fed_at(wire) * share / (1 + off)
        return (total.sum() if self.schematic.collects(part.name) else total) * scale
