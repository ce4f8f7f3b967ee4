"""The bill of components: every part of every cell, with its value and what to buy for it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Parameter, parameters
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.e_series import Series
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OpAmps

COLUMNS = ("cell", "component", "count", "value", "unit", "to buy", "deviation", "what")


def bill_of(circuit: Circuit, level: Level, series: Series) -> str:
    """CSV text, one line a component of a cell.

    Resistors are bought from the series, two in series where it has pairs; capacitors as they are.
    Op amps, multipliers and function generators are listed without a value.

    Parameters
    ----------
    circuit : Circuit
    level : Level
    series : Series

    Raises
    ------
    NetworkError
        If the level is not one of op amps with resistors, or the circuit has coordinators.
    """
    check_level(level)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for parameter in parameters(circuit):
        writer.writerows(_lines(circuit, parameter, series))
    return stream.getvalue()


def check_level(level: Level) -> None:
    """Refuse a level of which there is no bill.

    Raises
    ------
    NetworkError
    """
    if not isinstance(level.technology, OpAmps):
        raise NetworkError(
            f"bill: level {level.name} is not built of op amps with resistors; take a macro level, "
            "parts by name or transistor"
        )


ACTIVE = {Kind.OFFSET: "op amp", Kind.GAIN: "multiplier or function generator"}
"""Parameters that stand for an active part: every op amp has one offset, and so on."""


def _lines(circuit: Circuit, parameter: Parameter, series: Series) -> Iterator[tuple]:
    cells = np.flatnonzero(parameter.present)
    name, meaning = parameter.name, parameter.meaning
    if parameter.kind in ACTIVE:
        part = ACTIVE[parameter.kind]
        meaning = meaning.partition(" of ")[2].removeprefix("the ")
        yield from ((int(cell), f"x_{name.partition('_')[2]}", 1, "", "", part, "", meaning)
                    for cell in cells)  # fmt: skip
        return
    nominal, count = _nominal(circuit, parameter)
    if nominal is None:
        return
    for cell in cells:
        value = float(nominal[cell])
        unit, bought = "F", (value,)
        if parameter.kind is Kind.RESISTOR:
            unit, bought = "ohm", series.parts(value)
        off = f"{sum(bought) / value - 1:+.2e}"
        buy = " + ".join(f"{each:.6g}" for each in bought)
        yield int(cell), name, count, f"{value:.6g}", unit, buy, off, meaning


def _nominal(circuit: Circuit, parameter: Parameter) -> tuple[np.ndarray | None, int]:
    """Values (N,) of a resistor or capacitor, and how often it is there in a cell."""
    stages, part = len(parameter.present), parameter.part
    alias = circuit.schematic.alias[part]
    twice = 2 if circuit.schematic.differential else 1
    if parameter.name == f"e_n_{alias}":
        return np.full(stages, circuit.inverter), 2
    if parameter.name == f"rf_{alias}":
        return np.full(stages, circuit.feedback[part]), twice
    if parameter.name == f"c_{alias}":
        return circuit.capacitors[part], twice
    if parameter.kind is Kind.RESISTOR:
        return circuit.resistors[part][int(parameter.name.rpartition("_")[2])], twice
    return None, 0
