r"""Smallest resistor of a circuit, from ground capacitances and op-amp currents.

With all resistors r times as large and a bandwidth margin k, capacitors are k / r times as large
and currents 1 / r. The corner of a virtual ground relative to the op amp,

.. math:: 2 \pi\, GBW\, C_{in}\, (R_f \parallel R_1 \parallel R_2 \ldots) ,

is r times as large. So r is the largest value, up to `SMALLEST_RESISTOR`, with this corner below
`GROUND` and capacitors above the smallest one of the level. Two lower bounds take precedence. An op
amp supplies at most the fraction `SHARE` of its output current (`CURRENT` if unknown). The resistor
is at least `STIFF` output resistances, because the feedthrough past those via a capacitor is not
emulated.
"""

from __future__ import annotations

import math

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import Adder, PICell
from ann_dc.validation import checked

GROUND = 0.4
"""Largest ratio of op-amp bandwidth to the corner of the slowest virtual ground."""

SHARE = 0.7
"""Largest used fraction of an op amp's output current; limiting begins beyond."""

CURRENT = 20e-3
"""Assumed output current in amperes of op amps with unknown output current."""

STIFF = 10.0
"""Smallest ratio of the smallest resistor to the output resistance of op amps."""


@checked
def fitting_resistor(circuit: Circuit, level: Level) -> float:
    """Return the smallest resistor in ohms that suits the parts, with two digits."""
    ohms = circuit.inverter
    most = [SMALLEST_RESISTOR]
    corner = _corner(circuit, level)
    if corner:
        most.append(ohms * GROUND / corner)
    if level.smallest_capacitor:
        most.append(ohms * circuit.ranges[1][0] / level.smallest_capacitor)
    limit = level.datasheet.parasitics.output_current
    known = limit if math.isfinite(limit) else CURRENT
    driven = ohms * heaviest(circuit).amperes / (SHARE * known)
    least = max(driven, STIFF * level.datasheet.rout)
    return two_digits(min(most)) if min(most) > least else -two_digits(-least)


def _corner(circuit: Circuit, level: Level) -> float:
    """Return 2 pi GBW C_in R of the slowest virtual ground in the circuit."""
    schematic = circuit.schematic
    parallel = [circuit.inverter / 2] if schematic.inverted else []
    for part in schematic.parts:
        if isinstance(part, (PICell, Adder)):
            siemens = (1 / circuit.resistors[part.name]).sum(axis=0)
            siemens = siemens + 1 / circuit.feedback[part.name]
            ohms = np.where(schematic.alive_at(part.name), 1 / siemens, 0.0)
            parallel.append(float(ohms.max()))
    ground = level.datasheet.parasitics.ground
    return 2 * math.pi * level.datasheet.gbw * ground * max(parallel, default=0.0)


def two_digits(value: float) -> float:
    """Return the largest number of two digits that does not exceed ``value``.

    >>> two_digits(1170.0), -two_digits(-1170.0), -two_digits(-1000.0)
    (1100.0, 1200.0, 1000.0)
    """
    digit = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    return math.floor(value / digit + 1e-9) * digit
