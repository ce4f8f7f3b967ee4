"""Sums that are no part: a voltage stands for any multiple of its value.

A sum of one node of its own cell with a positive weight is that node's voltage on another scale.
Multipliers and function generators, whose inputs draw no current, read it as it is; a sum that a
resistor reads keeps its amplifier.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ann_dc.hardware.schematic.elements import Wire
from ann_dc.network.cell import ONE, Cell, Connection, Function, Product, Sum


def plain_sums(cell: Cell) -> dict[str, Wire]:
    """The sums of a cell that are plain wires, each with what carries it.

    Parameters
    ----------
    cell : Cell

    Returns
    -------
    dict of str to Wire
        By the name of the sum, in the order of the blocks. Weights are single numbers; no source
        is a plain wire itself.

    Examples
    --------
    >>> from ann_dc.network import Neuron
    >>> wires = (Connection(source="x", target="twice", weight=2.0),)
    >>> blocks = (Sum(name="twice"), Function(name="sine", function="sin", x="twice"))
    >>> found = plain_sums(Cell(neurons=(Neuron(name="x"),), blocks=blocks, connections=wires))
    >>> found["twice"].source, float(found["twice"].weight)
    ('x', 2.0)
    """
    arriving: dict[str, list[Connection]] = {}
    for connection in cell.connections:
        arriving.setdefault(connection.target, []).append(connection)
    read = set(_read_without_current(cell)) - {connection.source for connection in cell.connections}
    plain: dict[str, Wire] = {}
    for block in cell.blocks:
        wires = arriving.get(block.name, [])
        if isinstance(block, Sum) and block.name in read and len(wires) == 1:
            (wire,) = wires
            weight = np.asarray(wire.weight, float)
            if wire.template == 0 and wire.source != ONE and weight.ndim == 0 and weight > 0:
                plain[block.name] = Wire(source=wire.source, offset=0, weight=weight)
    return plain


def _read_without_current(cell: Cell) -> Iterator[str]:
    """What multipliers and function generators read."""
    for block in cell.blocks:
        if isinstance(block, Product):
            yield from (block.a, block.b)
        elif isinstance(block, Function):
            yield block.x
