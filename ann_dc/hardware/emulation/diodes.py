r"""Slowdown of a rectifying multiplier neuron by the diode behind its op amp.

The drop of the diode grows with its current. For a volt at the far end, x, the op amp moves by

.. math:: 1 + \frac{V_T}{x} \approx 1 + \frac{V_T}{x + V_T / 2} ,

so x follows at the pace p = (x + V_T / 2) / (x + 3 V_T / 2) of an op amp without a diode. On the
other side of the knee no part has to follow, and p quickly reaches 1. Meanwhile the diode of the
virtual ground is a junction of capacitance C_j, whose current R_f must also supply:

.. math:: \Big(1 + \frac{R_f C_j\, \Omega}{T\, (1 + \Gamma)}\Big) \dot x
          = p\, \Omega\, (o - e - x / A_0) .

In a transient p is a node. At rest p moves no equilibrium, and Newton's method is more robust
without p, with net inputs that are linear on either side of the knee. `paced_at` gives the modes at
rest.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ann_dc.hardware.circuit.circuit import JUNCTION, THERMAL
from ann_dc.hardware.emulation.assembly import Coupling, Piece, weighted_sum
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.emulation import Emulation, slower_network
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.network.cell import ONE, Function, Product, Sum
from ann_dc.network.network import Network

AT_KNEE = 1.5
"""1 / (1 - p) at the knee."""

STEEP = 10.0
"""Factor on the distance from the knee while the diode is off; the pace quickly reaches 1."""


def pace(built: BuiltCircuit, op_amp: AmplifierNodes, neuron: str) -> Iterator[Piece]:
    """Yield the pace of the diode behind an op amp, from its net inputs to its pole ``neuron``.

    The net inputs add up at the node ``drop_free``.
    """
    thermal = THERMAL * abs(built.circuit.value_of(op_amp.part))
    away, above, inverse = (f"{name}.{op_amp.pace}" for name in ("away", "above", "inverse"))
    yield from weighted_sum(away, {op_amp.output: -1.0})
    yield Function(name=op_amp.beyond, function="rectify", x=away)
    weights = {op_amp.part: 1 / thermal, op_amp.beyond: STEEP / thermal, ONE: AT_KNEE}
    yield from weighted_sum(above, weights)
    yield Function(name=inverse, function="reciprocal", x=above)
    yield from weighted_sum(op_amp.pace, {ONE: 1.0, inverse: -1.0})
    yield Sum(name=op_amp.drop_free)
    yield Product(name=op_amp.paced, a=op_amp.drop_free, b=op_amp.pace)
    yield Coupling(op_amp.paced, neuron, 1.0)


def paced_at(emulation: Emulation, x: np.ndarray) -> Network:
    """Return the emulation's network with the paces of a state in its time constants.

    The emulation has no paces as nodes, and ``x`` (n,) is its state at rest.
    """
    circuit, network = emulation.circuit, emulation.network
    values, slower = network.unpack(x), dict[str, np.ndarray]()
    for part in circuit.schematic.rectified:
        op_amp = AmplifierNodes(part.name, rectified=True)
        if op_amp.pace not in network.node_index:
            thermal = THERMAL * abs(circuit.value_of(part.name))
            y = values[network.neuron_index[op_amp.output]] / thermal
            pace = 1 - 1 / (AT_KNEE + np.where(y > 0, y, -STEEP * y))
            pole = op_amp.first if op_amp.first in network.neuron_index else op_amp.output
            slower[pole] = 1 / pace
    return slower_network(network, slower) if slower else network


def slowed(built: BuiltCircuit, part: PICell, ohms: np.ndarray) -> np.ndarray:
    """Return the slowdown (N,) of a rectifying neuron by the junction: 1 on a chip.

    ``ohms`` (N,) is the parallel resistance of the feedback resistor and the inputs.
    """
    farads = 0.0 if built.level.transistors else JUNCTION
    return 1 + ohms * farads / built.scaling.time / built.outputs.lag(part.name)
