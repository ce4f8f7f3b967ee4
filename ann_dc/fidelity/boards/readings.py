"""What to measure while a part is trimmed, and what to expect of it.

Offsets and gains are read at the part itself, with its inputs held where the reading is all error,
or all gain: grounded, at full scale, or where a function generator's input settles.
"""

from __future__ import annotations

from dataclasses import dataclass

from ann_dc.evaluation.reference import evaluator
from ann_dc.fidelity.specimen import Specimen
from ann_dc.hardware.circuit.parameters import Parameter, Quantity
from ann_dc.hardware.schematic.elements import Generator, Multiplier
from ann_dc.hints.checked import checked


@dataclass(frozen=True, kw_only=True)
class Reading:
    """What to measure.

    Attributes
    ----------
    measure : str
        Where, and how inputs are held, in a clause.
    volts : float
        What to set it to.
    spread : float
        Standard deviation of the reading before, in volts.

    Examples
    --------
    >>> print(Reading(measure="output of m, both inputs grounded", volts=0.0, spread=1e-3))
    output of m, both inputs grounded: 0 V, before it +-1 mV
    """

    measure: str
    volts: float
    spread: float

    def __str__(self) -> str:
        return f"{self.measure}: {self.volts:.5g} V, before it +-{1e3 * self.spread:.3g} mV"


@checked
def reading_of(nominal: Specimen, parameter: Parameter, stage: int) -> Reading:
    """What to measure while a part of a cell is trimmed.

    Parameters
    ----------
    nominal : Specimen
        The circuit as it should be.
    parameter : Parameter
        An offset or a gain.
    stage : int
        The cell, from 0.

    Returns
    -------
    Reading
    """
    size = nominal.level.tolerances.deviation(parameter.kind)
    part = next(p for p in nominal.circuit.schematic.parts if p.name == parameter.part)
    full = nominal.circuit.scaling.full_scale
    where, volts, per_unit = f"output of {parameter.part}", 0.0, 1.0
    if isinstance(part, Multiplier):
        held = {
            Quantity.GAIN: f"{part.a} and {part.b} held at {full:g} V",
            Quantity.OFFSET_X: f"{part.a} grounded, {part.b} held at {full:g} V",
            Quantity.OFFSET_Y: f"{part.b} grounded, {part.a} held at {full:g} V",
            Quantity.OFFSET_Z: f"{part.a} and {part.b} grounded",
        }[parameter.quantity]
        if parameter.quantity is Quantity.GAIN:
            volts, per_unit = full, full
    elif isinstance(part, Generator):
        held = f"{part.x} held at {_settled(nominal, part.x, stage):.5g} V"
        volts = _settled(nominal, part.name, stage)
        per_unit = abs(volts) if parameter.quantity is Quantity.GAIN else 1.0
    elif parameter.quantity is Quantity.INVERTER_OFFSET:
        where, held, per_unit = f"output of {parameter.part}'s inverter", "its input grounded", 2.0
    else:
        where, held = f"between the inputs of {parameter.part}'s op amp", "settled"
    return Reading(measure=f"{where}, {held}", volts=volts, spread=size * per_unit)


def _settled(nominal: Specimen, node: str, stage: int) -> float:
    """Volts at a node where the ideal network settles, with the sign that the circuit carries."""
    network, scaling = nominal.circuit.schematic.network, nominal.circuit.scaling
    values = evaluator(network).values(nominal.probe.final)[..., 1:-1]
    value = float(values[network.node_index[node], stage])
    return nominal.circuit.schematic.sign(node) * float(scaling.volts(node, value))
