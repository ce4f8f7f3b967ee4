"""What all cells share: a neuron that stands once, in the last cell, and is wired to all of them.

Two lines lead along the row for each. On one the currents of all cells add up at the virtual ground
of its integrator; the other one carries its output, which every cell reads. What is computed of
such neurons alone, the same in every cell, stands beside them once and has a line of its own: of an
objective, z + r (J - E) and its rectifier.
"""

from __future__ import annotations

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OpAmps
from ann_dc.network.cell import ONE, Block, Connection, Function, Product
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked


def shared_nodes(network: Network) -> frozenset[str]:
    """Nodes that stand once for the row: shared neurons, and blocks of nothing else.

    Parameters
    ----------
    network : Network

    Returns
    -------
    frozenset of str

    Examples
    --------
    >>> from ann_dc.network import Cell, Connection, Neuron, Product, Sum
    >>> wires = (Connection(source="x", target="twice", weight=2.0),)
    >>> blocks = (Sum(name="twice"), Product(name="own", a="y", b="twice"))
    >>> neurons = Neuron(name="x", shared=True), Neuron(name="y")
    >>> row = Network(stages=3, cell=Cell(neurons=neurons, blocks=blocks, connections=wires))
    >>> sorted(shared_nodes(row))
    ['twice', 'x']
    """
    arriving: dict[str, list[Connection]] = {}
    for connection in network.cell.connections:
        arriving.setdefault(connection.target, []).append(connection)
    found = {neuron.name for neuron in network.cell.neurons if neuron.shared}
    for block in network.cell.blocks if found else ():
        wires = arriving.get(block.name, [])
        same = all(np.ptp(np.asarray(wire.weight, float)) == 0 for wire in wires)
        read = _read_by(block, wires)
        if same and read & found and read <= found | {ONE}:
            found.add(block.name)
    return frozenset(found)


def _read_by(block: Block, wires: list[Connection]) -> set[str]:
    if isinstance(block, Product):
        return {block.a, block.b}
    return {block.x} if isinstance(block, Function) else {wire.source for wire in wires}


@checked
def check_shared(network: Network, level: Level) -> None:
    """Refuse a network whose cells share a neuron, where a level has no lines for it.

    Parameters
    ----------
    network : Network
    level : Level

    Raises
    ------
    NetworkError
        If cells share a neuron, and the level is not one of single-ended op amps.

    Examples
    --------
    >>> from ann_dc import levels
    >>> from ann_dc.network import Cell, Neuron
    >>> row = Network(cell=Cell(neurons=(Neuron(name="x", shared=True),)), stages=3)
    >>> check_shared(row, levels.macro())
    >>> check_shared(row, levels.ota_c())  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ann_dc.errors.NetworkError: circuit: x: a neuron shared ... is not built at level ota-c; ...
    """
    names = ", ".join(neuron.name for neuron in network.cell.neurons if neuron.shared)
    if names and not isinstance(level.technology, OpAmps):
        raise NetworkError(
            f"circuit: {names}: a neuron shared by all cells is not built at level {level.name}; "
            "take behavioural, macro or transistor op amps"
        )
