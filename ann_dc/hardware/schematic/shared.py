"""Shared neurons: placed once, in the last cell, and connected to all cells.

Two lines along the cell array serve each shared neuron. On the first line the currents of all cells
add up at the virtual ground of the integrator. The second line carries the output, which every cell
reads. Blocks that depend only on shared neurons, and are therefore equal in every cell, are placed
next to the neuron once with a separate line. For an objective these are z + r (J - E) and its
rectifier.
"""

from __future__ import annotations

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import arguments, connections_by_target
from ann_dc.network.cell import ONE
from ann_dc.network.network import Network
from ann_dc.validation import checked


def shared_nodes(network: Network) -> frozenset[str]:
    """Return the nodes that exist once: shared neurons and blocks of shared nodes."""
    arriving = connections_by_target(network.cell)
    found = {neuron.name for neuron in network.cell.neurons if neuron.shared}
    for block in network.cell.blocks if found else ():
        wires = arriving.get(block.name, [])
        same = all(np.ptp(np.asarray(wire.weight, float)) == 0 for wire in wires)
        read = set(arguments(block)) or {wire.source for wire in wires}
        if same and read & found and read <= found | {ONE}:
            found.add(block.name)
    return frozenset(found)


@checked
def check_shared(network: Network, level: Level) -> None:
    """Raise `NetworkError` if a level has no lines for the network's shared neurons.

    Only levels of single-ended op amps have such lines.
    """
    names = ", ".join(neuron.name for neuron in network.cell.neurons if neuron.shared)
    if names and level.technology.differential:
        raise NetworkError(
            f"circuit: {names}: a neuron shared by all cells is not built at level {level.name}; "
            "take behavioural, macro or transistor op amps"
        )
