r"""What the diode behind the op amp of a diode neuron does to its speed.

The drop of the diode grows with its current: for a volt at the far end, x, the op amp moves by

.. math:: 1 + \frac{V_T}{x} \approx 1 + \frac{V_T}{x + V_T / 2} ,

so that x follows at the pace p = (x + V_T / 2) / (x + 3 V_T / 2) of an op amp without a diode.
On the other side of the knee nothing has to follow, and p is soon 1. Meanwhile the diode of the
virtual ground is a junction of capacitance C_j, whose current R_f has to bring, too:

.. math:: \Big(1 + \frac{R_f C_j\, \Omega}{T\, (1 + \Gamma)}\Big) \dot x
          = p\, \Omega\, (o - e - x / A_0) .
"""

from __future__ import annotations

import numpy as np

from ann_dc.hardware.circuit.circuit import JUNCTION, THERMAL
from ann_dc.hardware.emulation.assembly import Assembly
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.network.cell import ONE

STEEP = 10.0
"""How much faster the pace comes back to 1 on the side of the knee where the diode is off."""


def add_pace(assembly: Assembly, part: PICell) -> None:
    """Add p of a diode neuron.

    Parameters
    ----------
    assembly : Assembly
    part : PICell
    """
    nodes, op_amp = AmplifierNodes(part.name), AmplifierNodes(part.name, rectified=True)
    thermal = THERMAL * abs(assembly.circuit.value_of(part.name))
    away, above, inverse = (f"{name}.{op_amp.pace}" for name in ("away", "above", "inverse"))
    assembly.sum(away)
    assembly.connect(op_amp.output, away, -1.0)
    assembly.function(op_amp.beyond, "rectify", away)
    assembly.sum(above)
    weights = {nodes.output: 1 / thermal, op_amp.beyond: STEEP / thermal, ONE: 1.5}
    for source, weight in weights.items():
        assembly.connect(source, above, weight)
    assembly.function(inverse, "reciprocal", above)
    assembly.sum(op_amp.pace)
    assembly.connect(ONE, op_amp.pace, 1.0)
    assembly.connect(inverse, op_amp.pace, -1.0)


def paced(
    assembly: Assembly, op_amp: AmplifierNodes, neuron: str, slower: float | np.ndarray
) -> str:
    """Let a neuron follow at the pace of its diode.

    Parameters
    ----------
    assembly : Assembly
    op_amp : AmplifierNodes
        Before the diode.
    neuron : str
        Of its pole.
    slower : float or (N,) array
        By how much the junction slows it.

    Returns
    -------
    str
        The node that its drives go to.
    """
    assembly.sum(op_amp.open_drive)
    assembly.product(op_amp.paced, op_amp.open_drive, op_amp.pace)
    assembly.connect(op_amp.paced, neuron, 1 / slower)
    return op_amp.open_drive


def slowed(assembly: Assembly, part: PICell, ohms: np.ndarray) -> np.ndarray:
    """By how much the junction slows a diode neuron (N,): 1 on a chip, where it is much smaller.

    Parameters
    ----------
    assembly : Assembly
    part : PICell
    ohms : (N,) array
        Of its feedback resistor and its inputs side by side.
    """
    farads = 0.0 if assembly.transistors else JUNCTION
    return 1 + ohms * farads / assembly.scaling.time / assembly.outputs.lag(part.name)
