r"""The smallest resistor of a circuit, from what lies at its grounds and what op amps can drive.

With all resistors r times as large and a margin k, capacitors are k / r times as large, currents
1 / r, and the corner of a virtual ground against the op amp,

.. math:: 2 \pi\, GBW\, C_{in}\, (R_f \parallel R_1 \parallel R_2 \ldots) ,

r times. So r is the largest, up to `SMALLEST_RESISTOR`, that keeps this below `GROUND` and
capacitors above the level's smallest; it is not so small that an op amp has to give more than
`SHARE` of its output current, `CURRENT` where nobody says how much that is, nor smaller than
`STIFF` output resistances, because what goes past those through a capacitor is not emulated.
"""

from __future__ import annotations

import math

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.loads import heaviest
from ann_dc.hardware.parts.datasheet import SMALLEST_RESISTOR
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import Adder, PICell
from ann_dc.validation.checked import checked

GROUND = 0.4
"""Of the slowest virtual ground: the op amps' bandwidth over its corner, at most."""

SHARE = 0.7
"""Of its output current that an op amp gives at most; beyond, limits begin to show."""

CURRENT = 20e-3
"""Amperes that op amps give of which nobody says how much that is."""

STIFF = 10.0
"""The smallest resistor over the output resistance of op amps, at least."""


@checked
def fitting_resistor(circuit: Circuit, level: Level) -> float:
    """Ohms of the smallest resistor that suits a level's parts, with two digits.

    Parameters
    ----------
    circuit : Circuit
        With some smallest resistor or other.
    level : Level
    """
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
    """2 pi GBW C_in R of the slowest virtual ground that is there."""
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
    """The next number of two digits that is not larger.

    >>> two_digits(1170.0), -two_digits(-1170.0), -two_digits(-1000.0)
    (1100.0, 1200.0, 1000.0)
    """
    digit = 10.0 ** (math.floor(math.log10(abs(value))) - 1)
    return math.floor(value / digit + 1e-9) * digit
