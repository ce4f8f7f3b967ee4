r"""What the op amps of a circuit drive: the conductance from every output to virtual grounds.

An op amp of output resistance r has an open-loop gain of a0 / (1 + r G) into a conductance

.. math:: G = \sum_j 1 / R_j

of the resistors that read its output; those in series with a capacitor take no current once the
circuit has settled.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.schematic.elements import Adder, Generator, Multiplier, Wire
from ann_dc.hardware.schematic.schematic import Schematic


def loads(circuit: Circuit) -> Mapping[tuple[str, bool], np.ndarray]:
    """Conductances that the outputs of a circuit drive.

    Parameters
    ----------
    circuit : Circuit

    Returns
    -------
    mapping of (part name, whether its inverter) to (N,) array
        In siemens.
    """
    schematic, stages = circuit.schematic, circuit.schematic.network.stages
    found = {(part.name, False): np.zeros(stages) for part in schematic.parts}
    for name in schematic.inverted:  # reads the part by one resistor, and itself by another
        found[name, False] += 1 / circuit.inverter
        found[name, True] = np.full(stages, 1 / circuit.inverter)
    for part in schematic.parts:
        if isinstance(part, Adder):
            found[part.name, False] += 1 / circuit.feedback[part.name]
        if not isinstance(part, (Multiplier, Generator)):
            for number, wire in enumerate(part.wires):
                siemens = 1 / circuit.resistors[part.name][number]
                _read(schematic, found, wire, siemens, schematic.reading(part, wire))
    return found


def _read(
    schematic: Schematic,
    found: dict[tuple[str, bool], np.ndarray],
    wire: Wire,
    siemens: np.ndarray,
    signs: np.ndarray,
) -> None:
    """Add the resistors of a wire to what its source, or the inverter behind it, drives."""
    source = schematic.carrier(wire.source)
    if (source, False) not in found:
        return  # an input
    for stage in np.flatnonzero(siemens * schematic.fed_at(wire)).tolist():
        where = schematic.cell_of(source, stage + wire.offset)
        if 0 <= where < schematic.network.stages and (source, where) not in schematic.pins:
            direct = schematic.differential or signs[stage] == schematic.polarity[source]
            found[source, not direct][where] += siemens[stage]

