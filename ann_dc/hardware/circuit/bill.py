"""Bill of materials: every component of every cell with its value and order value."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import (
    CLAMP_LAG,
    CLAMP_REFERENCE,
    CLAMP_SHARE,
    HOLD,
    Circuit,
    Parameter,
    Quantity,
)
from ann_dc.hardware.circuit.deviations import rounded_to_series
from ann_dc.hardware.circuit.scaling import begins, to_ground
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.e_series import Series
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import GridNode, Integrator, PICell
from ann_dc.validation import checked

COLUMNS = ("cell", "component", "count", "value", "unit", "to buy", "deviation", "what")


@checked
def bill_of(circuit: Circuit, level: Level, series: Series) -> str:
    """Return the bill of materials as CSV, one line per component of a cell.

    The first line is a header. Resistors are ordered from the series, as two in series if the
    series has pairs. Capacitors are ordered from E24, or from the series if it is coarser. Op amps,
    multipliers and function generators are listed without a value. Raises `NetworkError` if the
    level is not one of op amps with resistors.
    """
    check_level(level)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for parameter in circuit.parameters:
        writer.writerows(_lines(circuit, parameter, series))
    for part in circuit.schematic.parts:
        if isinstance(part, GridNode):
            writer.writerows(_of_grid(circuit, part, series))
        elif isinstance(part, Integrator) and part.with_limits:
            writer.writerows(_of_rails(circuit, part, level, series))
        elif isinstance(part, PICell) and part.rectified:
            writer.writerows(_of_diodes(circuit, part, series))
    return stream.getvalue()


def check_level(level: Level) -> None:
    """Raise `NetworkError` if a level has no bill of materials.

    Only levels of op amps with resistors have one.
    """
    if not level.technology.has_resistors:
        raise NetworkError(
            f"bill: level {level.name} has no op amps with resistors; use a macro level, parts "
            "by name or transistor"
        )


ACTIVE = {
    Quantity.OFFSET: ("x", "op amp"),
    Quantity.INVERTER_OFFSET: ("x_n", "op amp"),
    Quantity.GAIN: ("x", "multiplier or function generator"),
}
"""Quantities that identify an active part, with its name prefix and order description.

Every op amp has one offset, every multiplier and function generator one gain.
"""


def _lines(circuit: Circuit, parameter: Parameter, series: Series) -> Iterator[tuple]:
    cells = np.flatnonzero(parameter.present)
    if parameter.quantity in ACTIVE:
        letters, part = ACTIVE[parameter.quantity]
        name = f"{letters}_{parameter.alias}"
        for cell in cells:
            yield int(cell), name, 1, "", "", part, "", parameter.owner
    elif parameter.kind in (Kind.RESISTOR, Kind.CAPACITOR):
        nominal, count = _nominal(circuit, parameter)
        for cell in cells:
            bought = _bought(parameter.kind, float(nominal[cell]), series)
            yield int(cell), parameter.name, count, *bought, parameter.meaning


def _of_grid(circuit: Circuit, part: GridNode, series: Series) -> Iterator[tuple]:
    """Yield the components of a grid pair: two each, or one negative resistance."""
    alias, ohms = circuit.alias[part.name], circuit.resistors[part.name]
    missing = to_ground(circuit.conductances[part.name], ohms)
    farads = circuit.conductances[part.name] * circuit.lag * circuit.scaling.time
    order = list(circuit.schematic.by_name)
    for cell in np.flatnonzero(part.present).tolist():
        for number, wire in enumerate(part.wires):
            if wire.weight[cell] and begins(part, wire, order):
                bought = _bought(Kind.RESISTOR, float(ohms[number, cell]), series)
                meaning = f"resistor from {wire.source} to {part.name}"
                yield cell, f"rg_{alias}_{number}", 2, *bought, meaning
        siemens = float(missing[cell])
        count, meaning = 2, f"resistor from {part.name} to ground"
        if siemens < 0:
            count, siemens, meaning = 1, -siemens / 2, f"negative resistance across {part.name}"
        yield cell, f"rg_{alias}", count, *_bought(Kind.RESISTOR, 1 / siemens, series), meaning
        bought = _bought(Kind.CAPACITOR, float(farads[cell]), series)
        yield cell, f"cg_{alias}", 2, *bought, f"capacitor of {part.name}'s node"


def _of_rails(circuit: Circuit, part: Integrator, level: Level, series: Series) -> Iterator[tuple]:
    """Yield clamps: op amp, three diodes, three resistors, capacitor, reference."""
    alias = circuit.alias[part.name]
    taken = rounded_to_series(circuit, series).get(Quantity.CAPACITOR.named(alias), 0.0)
    whole = circuit.capacitors[part.name] * (1 + taken)  # of which the deck gives clamps a share
    for rail, volts in zip(("lo", "hi"), circuit.limits(part)):
        for cell in np.flatnonzero(part.present & np.isfinite(volts)).tolist():
            owner, farads = f"clamp of {part.name}", float(whole[cell])
            yield cell, f"x_{rail}_{alias}", 1, "", "", "op amp", "", owner
            yield cell, f"d_{rail}_{alias}", 3, "", "", "diode", "", owner
            yield cell, f"v_{rail}_{alias}", 1, f"{volts:.6g}", "V", "reference, shared", "", owner
            held = _bought(Kind.RESISTOR, CLAMP_REFERENCE / level.datasheet.gbw, series)
            yield cell, f"rr_{rail}_{alias}", 1, *held, owner
            siemens = 2 * np.pi * level.datasheet.gbw * farads
            carrying, damping = CLAMP_LAG / siemens, 1 / (CLAMP_SHARE * siemens)
            for name, ohms in (("rd", carrying), ("rc", damping + level.datasheet.rout)):
                bought = _bought(Kind.RESISTOR, ohms, series)
                yield cell, f"{name}_{rail}_{alias}", 1, *bought, owner
            share = _bought(Kind.CAPACITOR, CLAMP_SHARE * farads, series)
            yield cell, f"c_{rail}_{alias}", 1, *share, owner


def _of_diodes(circuit: Circuit, part: PICell, series: Series) -> Iterator[tuple]:
    """Yield the rectifier of a PI cell: two diodes and the resistor to ground."""
    alias, owner = circuit.alias[part.name], f"rectifier of {part.name}"
    for cell in np.flatnonzero(part.present).tolist():
        yield cell, f"d_{alias}", 2, "", "", "diode", "", owner
        ohms = HOLD * circuit.inverter
        yield cell, f"rp_{alias}", 1, *_bought(Kind.RESISTOR, ohms, series), owner


def _bought(kind: Kind, value: float, series: Series) -> tuple[str, str, str, str]:
    """Return value, unit, order value and relative error of the order value."""
    resistor = kind is Kind.RESISTOR
    parts = (series if resistor else series.capacitors).parts(value)
    return (
        f"{value:.6g}",
        "ohm" if resistor else "F",
        " + ".join(f"{each:.6g}" for each in parts),
        f"{sum(parts) / value - 1:+.2e}",
    )


def _nominal(circuit: Circuit, parameter: Parameter) -> tuple[np.ndarray, int]:
    """Return the values (N,) of a resistor or capacitor, and its number in a cell."""
    stages, part = len(parameter.present), parameter.part
    halves = 2 if circuit.schematic.differential else 1
    match parameter.quantity:
        case Quantity.INVERTER:
            return np.full(stages, circuit.inverter), 2
        case Quantity.FEEDBACK:
            return np.full(stages, circuit.feedback[part]), halves
        case Quantity.CAPACITOR:
            return circuit.own_capacitors(part), halves
        case _:
            return circuit.resistors[part][parameter.wire], halves
