"""Sums without a part: one voltage represents any multiple of its value.

A sum of one node of its cell with a positive weight is the voltage of that node on another scale.
Multipliers and function generators, whose inputs draw no current, read that voltage directly. A sum
with a resistor as a reader needs an amplifier.
"""

from __future__ import annotations

import numpy as np

from ann_dc.hardware.schematic.elements import Wire, arguments, connections_by_target
from ann_dc.network.cell import ONE, Cell, Sum


def plain_sums(cell: Cell) -> dict[str, Wire]:
    """Return the sums of a cell without a part, each with the wire from its carrier.

    The order is that of the blocks. Weights are scalars, and no source is such a sum.

    Examples
    --------
    >>> from ann_dc.network import Neuron
    >>> wires = (Connection(source="x", target="twice", weight=2.0),)
    >>> blocks = (Sum(name="twice"), Function(name="sine", function="sin", x="twice"))
    >>> found = plain_sums(Cell(neurons=(Neuron(name="x"),), blocks=blocks, connections=wires))
    >>> found["twice"].source, float(found["twice"].weight)
    ('x', 2.0)
    """
    arriving = connections_by_target(cell)
    without_current = {node for block in cell.blocks for node in arguments(block)}
    read = without_current - {connection.source for connection in cell.connections}
    plain: dict[str, Wire] = {}
    for block in cell.blocks:
        wires = arriving.get(block.name, [])
        if isinstance(block, Sum) and block.name in read and len(wires) == 1:
            (wire,) = wires
            weight = np.asarray(wire.weight, float)
            if wire.template == 0 and wire.source != ONE and weight.ndim == 0 and weight > 0:
                plain[block.name] = Wire(source=wire.source, offset=0, weight=weight)
    return plain
