"""Conversion of analog-computer elements to tables in machine units, and back.

A table is converted to a `Machine` that can be run.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ann_dc.export.devices.elements import (
    CONSTANT,
    FUNCTION,
    INTEGRATOR,
    Element,
)
from ann_dc.export.devices.machine import Machine
from ann_dc.weights.manifest import Table

VALUES = {INTEGRATOR: "start", CONSTANT: "value"}
"""Name of the value of each kind."""


def table_of(elements: Sequence[Element], scales: np.ndarray, beta: float, largest: float) -> dict:
    """Convert elements from network units to tables in machine units.

    The tables are ``elements`` and ``matrix``.

    Parameters
    ----------
    scales : (E,) array
        Value that one machine unit of every element represents.
    beta : float
        Ratio of machine time to network time.
    largest : float
        Gain of the inputs with a coefficient above 1.
    """
    rows, matrix = [], []
    for k, e in enumerate(elements):
        rows.append(_row(e, float(scales[k])))
        slower = beta if e.kind == INTEGRATOR else 1.0
        for place, weight in e.wires.items():
            coefficient = float(weight * scales[place] / scales[k] / slower)
            gain = 1.0 if abs(coefficient) <= 1 else largest
            matrix.append([k, place, coefficient / gain, gain])
    return {"elements": rows, "matrix": matrix}


def _row(e: Element, scale: float) -> dict:
    row = {"name": e.name, "kind": e.kind, "scale": scale}
    if e.kind in VALUES:
        row[VALUES[e.kind]] = e.value / scale
    if e.kind == INTEGRATOR:
        ends = {"low": e.low / scale, "high": e.high / scale}
        row |= {name: float(end) for name, end in ends.items() if np.isfinite(end)}
    if e.kind == FUNCTION:
        row["function"] = e.function
    if e.reads:
        row["reads"] = list(e.reads)
    return row


def machine_of(table: Table) -> Machine:
    """Build the machine that a table with the entries of `table_of` describes."""
    rows = list(table.rows("elements"))
    wires: list[dict[int, float]] = [{} for _ in rows]
    for target, source, coefficient, gain in table.get("matrix", list):
        wires[target][source] = coefficient * gain
    elements = [_element(row, own) for row, own in zip(rows, wires)]
    return Machine(elements, np.array([row.get("scale", float) for row in rows]))


def _element(row: Table, wires: dict[int, float]) -> Element:
    kind = row.get("kind", str)
    return Element(
        name=row.get("name", str),
        kind=kind,
        wires=wires,
        reads=tuple(row.given.get("reads", ())),
        function=row.given.get("function", ""),
        value=row.get(VALUES[kind], float) if kind in VALUES else 0.0,
        low=row.given.get("low", -np.inf),
        high=row.given.get("high", np.inf),
    )
