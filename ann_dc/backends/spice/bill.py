"""The bill of components: every resistor and capacitor of every cell, with its value."""

from __future__ import annotations

import csv
import io

import numpy as np

from ann_dc.network.components import Components
from ann_dc.network.e_series import Series
from ann_dc.network.parameters import Kind, Parameter, parameters

COLUMNS = ("cell", "component", "value", "unit", "to buy", "deviation", "what")


def bill_of(made: Components, series: Series) -> str:
    """CSV text, one line a component.

    Parameters
    ----------
    made : Components
    series : Series
        What resistors are bought from.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for parameter in parameters(made):
        nominal = _nominal(made, parameter)
        if nominal is None:
            continue
        unit = "ohm" if parameter.kind is Kind.RESISTOR else "F"
        bought = series.nearest(nominal) if unit == "ohm" else nominal
        for cell in np.flatnonzero(parameter.there):
            value, real = float(nominal[cell]), float(bought[cell])
            writer.writerow(
                (
                    int(cell),
                    parameter.name,
                    f"{value:.6g}",
                    unit,
                    f"{real:.6g}",
                    f"{real / value - 1:+.2e}",
                    parameter.told,
                )
            )
    return stream.getvalue()


def _nominal(made: Components, parameter: Parameter) -> np.ndarray | None:
    """Values (N,) of a resistor or capacitor; None for what is no component by itself."""
    stages, part = len(parameter.there), parameter.part
    alias = made.schematic.alias[part]
    if parameter.name == f"rf_{alias}":
        return np.full(stages, made.feedback[part])
    if parameter.name == f"c_{alias}":
        return made.capacitors[part]
    if parameter.name.startswith(f"r_{alias}_"):
        return made.resistors[part][int(parameter.name.rpartition("_")[2])]
    return None
