"""Conversion of analog-computer elements to tables in machine units, and back.

A table is converted to a `Machine` that can be run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ann_dc.errors import FileFormatError, UnknownNameError
from ann_dc.export.devices.elements import (
    CONSTANT,
    FUNCTION,
    INTEGRATOR,
    KINDS,
    PRODUCT,
    SUM,
    Element,
)
from ann_dc.export.devices.machine import Machine
from ann_dc.network.functions import function_block
from ann_dc.weights.manifest import Table

READS = {PRODUCT: 2, FUNCTION: 1}
"""Number of elements that an element of each kind reads."""
VALUES = {INTEGRATOR: "start", CONSTANT: "value"}
"""Name of the value of each kind."""
ROUNDING = 1e-12
"""Relative tolerance for the scale of a product."""


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
    """Build the machine that a table describes.

    The table has ``elements`` and ``matrix`` as in `table_of`, and ``largest_coefficient``. Raises
    `FileFormatError` if the table does not describe a machine.
    """
    rows = list(table.rows("elements"))
    elements: list[Element] = []
    for place, row in enumerate(rows):
        elements.append(_element(row, place, elements))
    wires: list[dict[int, float]] = [{} for _ in rows]
    largest = _number(table, "largest_coefficient")
    for target, source, weight in _matrix(table, elements, largest):
        wires[target][source] = weight
    elements = [replace(e, wires=own) for e, own in zip(elements, wires)]
    scales = np.array([_number(row, "scale") for row in rows])
    if not (scales > 0).all():
        raise FileFormatError(f"{table.place}.elements: a scale is not positive")
    for k, e in enumerate(elements):
        both = np.prod(scales[list(e.reads)]) if e.kind == PRODUCT else scales[k]
        if abs(both / scales[k] - 1) > ROUNDING:
            raise FileFormatError(f"{e.name}: its scale is not the product of what it reads")
    return Machine(elements, scales)


def _element(row: Table, place: int, before: Sequence[Element]) -> Element:
    kind = row.get("kind", str)
    if kind not in KINDS:
        raise FileFormatError(f"{row.place}.kind: {kind!r:.40} is none of {', '.join(KINDS)}")
    first = kind == INTEGRATOR
    if first and any(e.kind != INTEGRATOR for e in before):
        raise FileFormatError(f"{row.place}: integrators stand before all others")
    reads = row.get("reads", list) if kind in READS else []
    if len(reads) != READS.get(kind, 0) or not all(
        type(p) is int and 0 <= p < place for p in reads
    ):
        raise FileFormatError(f"{row.place}.reads: expected {READS.get(kind, 0)} earlier elements")
    return Element(
        name=row.get("name", str),
        kind=kind,
        reads=tuple(reads),
        function=_function(row) if kind == FUNCTION else "",
        value=_number(row, VALUES[kind]) if kind in VALUES else 0.0,
        low=_limit(row, "low", -np.inf),
        high=_limit(row, "high", np.inf),
    )


def _function(row: Table) -> str:
    try:
        return function_block(row.get("function", str)).name
    except UnknownNameError as error:
        raise FileFormatError(f"{row.place}.function: {error}") from error


def _number(row: Table, key: str) -> float:
    value = row.get(key, float)
    if not np.isfinite(value):
        raise FileFormatError(f"{row.place}.{key}: not finite")
    return value


def _limit(row: Table, key: str, none: float) -> float:
    return _number(row, key) if row.has(key) else none


def _matrix(
    table: Table, elements: Sequence[Element], largest: float
) -> Iterator[tuple[int, int, float]]:
    """Yield (target, source, coefficient times gain) of every row."""
    for row in table.get("matrix", list):
        if not isinstance(row, list) or len(row) != 4 or any(isinstance(v, bool) for v in row):
            raise FileFormatError(f"{table.place}.matrix: expected rows of four numbers")
        target, source, coefficient, gain = row
        if not (type(target) is type(source) is int and type(coefficient) is type(gain) is float):
            raise FileFormatError(f"{table.place}.matrix: expected two places and two numbers")
        if not (0 <= target < len(elements) and 0 <= source < len(elements)):
            raise FileFormatError(
                f"{table.place}.matrix: there is no element {max(target, source)}"
            )
        kind = elements[target].kind
        if kind not in (INTEGRATOR, SUM) or (kind == SUM and source >= target):
            raise FileFormatError(f"{elements[target].name}: it cannot read element {source}")
        if not abs(coefficient) <= 1:
            raise FileFormatError(f"{elements[target].name}: a coefficient is larger than 1")
        if gain not in (1.0, largest):
            raise FileFormatError(
                f"{elements[target].name}: an input has the gain {gain:.6g}, not 1 or {largest:.6g}"
            )
        yield target, source, coefficient * gain
