r"""Trim measurements of a part: test conditions, target voltage and deviation.

Offsets and gains are read at the part itself. The output of a multiplier of full scale F is

.. math:: o(x, y) = (1 + g) \, X(x + o_x) (y + o_y) / F + o_z + f \, (x + o_x + y + o_y) ,

where X is the bent first input and f the feedthrough. Half the difference of two outputs gives the
offset of an input. A quarter of a combination of four outputs gives the gain; all other errors
cancel:

.. math:: (o(F, F) - o(F, -F) - o(-F, F) + o(-F, -F)) / 4 = (1 + g) \, F (1 + d) .

The gain of a function generator is also read as a difference. Its offset is read after the gain is
trimmed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.circuit.circuit import CLAMP_OFFSETS, Parameter, Quantity
from ann_dc.hardware.schematic.elements import Generator, Multiplier, Part
from ann_dc.network.functions import function_block

HELD = {
    Quantity.GAIN: ((1, 1, 0.25), (1, -1, -0.25), (-1, 1, -0.25), (-1, -1, 0.25)),
    Quantity.OFFSET_X: ((0, 1, 0.5), (0, -1, -0.5)),
    Quantity.OFFSET_Y: ((1, 0, 0.5), (-1, 0, -0.5)),
    Quantity.OFFSET_Z: ((0, 0, 1.0),),
}
"""Multiplier inputs relative to full scale, and the weight of each output, by measured quantity."""

SMALL = 1e-6
"""Deviation with which the slope of a multiplier reading is computed."""

POINTS = 201
"""Number of input values over both full scales, searched for the gain reading of a generator."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """Trim measurement.

    ``measure`` describes the measured node and the applied inputs, ``volts`` is the target and
    ``spread`` the standard deviation before trimming in volts. ``slope`` has volts per unit of the
    trimmed quantity: per volt of an offset, per fraction of a gain.
    """

    measure: str
    volts: float
    spread: float
    slope: float

    def __str__(self) -> str:
        return f"{self.measure}: {_reported(self.volts)} V, before it +-{1e3 * self.spread:.3g} mV"


def reading_of(nominal: CircuitInstance, parameter: Parameter, stage: int) -> Reading:
    """Return the measurement for trimming an offset or a gain of a part in a cell."""
    part, quantity = _part(nominal, parameter), parameter.quantity
    volts, slope = 0.0, 1.0
    if isinstance(part, Multiplier):
        measure = _of_multiplier(nominal, part, quantity)
        volts = _multiplied(nominal, quantity, {})
        slope = (_multiplied(nominal, quantity, {quantity: SMALL}) - volts) / SMALL
    elif isinstance(part, Generator) and quantity is Quantity.GAIN:
        (low, high), volts = _apart(nominal, part, stage)
        measure = f"output of {part.name}, {part.x} held at {high:.5g} V less at {low:.5g} V"
        slope = volts
    elif isinstance(part, Generator):
        volts = _settled(nominal, part.name, stage)
        held = f"{part.x} held at {_reported(_settled(nominal, part.x, stage))} V"
        measure = f"output of {part.name}, its gain trimmed, {held}"
    elif quantity is Quantity.INVERTER_OFFSET:
        measure, slope = f"output of {part.name}'s inverter, its input grounded", 2.0
    elif quantity in CLAMP_OFFSETS:
        measure = f"between the inputs of {parameter.owner}, while it conducts"
    else:
        measure = f"between the inputs of {part.name}'s op amp, settled"
    size = nominal.level.tolerances.deviation(parameter.kind)
    return Reading(measure=measure, volts=volts, spread=abs(size * slope), slope=slope)


def misread(
    nominal: CircuitInstance, parameter: Parameter, stage: int, off: Mapping[Quantity, float]
) -> float:
    """Return the deviation in volts of a reading, with the errors of all its quantities."""
    part, quantity = _part(nominal, parameter), parameter.quantity
    if isinstance(part, Multiplier):
        return _multiplied(nominal, quantity, off) - _multiplied(nominal, quantity, {})
    found = off[quantity] * reading_of(nominal, parameter, stage).slope
    if isinstance(part, Generator) and quantity is not Quantity.GAIN:
        found += off.get(Quantity.GAIN, 0.0) * _settled(nominal, part.name, stage)
    return found


def _reported(volts: float) -> str:
    """Return a voltage as text, rounded to a microvolt and to five digits."""
    return f"{round(volts, 6) + 0.0:.5g}"


def _part(nominal: CircuitInstance, parameter: Parameter) -> Part:
    return nominal.circuit.schematic.by_name[parameter.part]


def _of_multiplier(nominal: CircuitInstance, part: Multiplier, quantity: Quantity) -> str:
    """Return the description of the inputs applied to a multiplier."""
    full = f"{nominal.circuit.scaling.full_scale:g} V"
    a, b, out = part.a, part.b, f"output of {part.name}"
    return {
        Quantity.GAIN: f"a quarter of the {out}, {a} and {b} held at {full} and at -{full}, less "
        f"the two with one of them at -{full}",
        Quantity.OFFSET_X: f"half of the {out}, {a} grounded, {b} held at {full} less at -{full}",
        Quantity.OFFSET_Y: f"half of the {out}, {b} grounded, {a} held at {full} less at -{full}",
        Quantity.OFFSET_Z: f"{out}, {a} and {b} grounded",
    }[quantity]


def _multiplied(
    nominal: CircuitInstance, quantity: Quantity, off: Mapping[Quantity, float]
) -> float:
    """Return the reading in volts of a multiplier with these errors."""
    full, parasitics = nominal.circuit.scaling.full_scale, nominal.level.datasheet.parasitics
    bend, through = parasitics.multiplier_nonlinearity, parasitics.multiplier_feedthrough
    gain, ox, oy, oz = (off.get(each, 0.0) for each in HELD)
    total = 0.0
    for a, b, weight in HELD[quantity]:
        x, y = a * full + ox, b * full + oy
        bent = x * (1 + bend * (4 * (x / full) ** 2 - 3))
        total += weight * ((1 + gain) * bent * y / full + oz + through * (x + y))
    return total


def _apart(
    nominal: CircuitInstance, part: Generator, stage: int
) -> tuple[tuple[float, float], float]:
    """Return the inputs of lowest and highest output, and the output difference."""
    schematic, scaling = nominal.circuit.schematic, nominal.circuit.scaling
    block, full = function_block(part.function), scaling.full_scale
    settled = _settled(nominal, part.x, stage)
    volts = np.linspace(-full, full, POINTS)
    x = schematic.sign(part.x) * scaling.value(part.x, volts)
    there = (x > block.domain[0]) & (x < block.domain[1])
    if block.has_pole:
        there &= volts * settled > 0
    volts, x = volts[there], x[there]
    out = schematic.sign(part.name) * scaling.volts(part.name, block.value(x))
    volts, out = volts[np.abs(out) <= full], out[np.abs(out) <= full]
    low, high = int(out.argmin()), int(out.argmax())
    return (float(volts[low]), float(volts[high])), float(out[high] - out[low])


def _settled(nominal: CircuitInstance, node: str, stage: int) -> float:
    """Return the signed voltage of a node at the equilibrium of the ideal network."""
    network, scaling = nominal.circuit.schematic.network, nominal.circuit.scaling
    values = evaluator(network).values(nominal.probe.final)[..., 1:-1]
    value = float(values[network.node_index[node], stage])
    return nominal.circuit.schematic.sign(node) * float(scaling.volts(node, value))
