"""Deviations of circuit parameters: drawn, prescribed, rounded or combined.

A *deviation* maps parameter names to arrays (N,), one number per cell. Values are relative for
resistors, capacitors and gains, and in volts for offsets. Netlist, emulation, sensitivity and Monte
Carlo analyses use the parameter names of the netlist.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.hardware.circuit.circuit import Circuit, Parameter, Quantity
from ann_dc.hardware.parts.datasheet import Kind, Tolerances
from ann_dc.hardware.parts.e_series import Series
from ann_dc.validation import FloatOrNan, checked

Deviations: TypeAlias = Mapping[str, FloatOrNan | np.ndarray]
"""Deviations of parameters by name."""


@checked
def draw(known: Iterable[Parameter], tolerances: Tolerances, seed: int) -> dict[str, np.ndarray]:
    """Draw errors within tolerances; equal seeds give equal errors.

    Errors of resistors and capacitors are uniform within their bounds; all others are normal. Every
    kind of parameter has a separate random stream, and temperature coefficients have further
    streams. The errors of one kind therefore do not depend on the tolerance of another kind, and
    parts are identical at every temperature. The result maps names to (N,) arrays, relative or in
    volts, without kinds of zero size.
    """
    streams = {kind: np.random.default_rng([seed, n]) for n, kind in enumerate(Kind)}
    drifts = {kind: np.random.default_rng([seed, len(Kind) + n]) for n, kind in enumerate(Kind)}
    drawn = {}
    for parameter in known:
        kind, count = parameter.kind, len(parameter.present)
        size, drift = getattr(tolerances, kind.value), tolerances.drift(kind)
        off = size * _errors(streams[kind], kind, count)
        if drift:
            off = off + drift * _errors(drifts[kind], kind, count)
        if size or drift:
            drawn[parameter.name] = np.where(parameter.present, off, 0.0)
    return drawn


def _errors(stream: np.random.Generator, kind: Kind, count: int) -> np.ndarray:
    """Return errors of unit size."""
    return stream.uniform(-1.0, 1.0, count) if kind.bounded else stream.standard_normal(count)


def combined(known: Iterable[Parameter], *errors: Deviations) -> dict[str, np.ndarray]:
    """Combine several deviations: relative ones multiply, volts add.

    The parameters ``known`` of the circuit determine which deviations are in volts.
    """
    total: dict[str, np.ndarray] = {}
    volts = {parameter.name for parameter in known if parameter.kind.unit == "V"}
    for error in errors:
        for name, off in error.items():
            before = total.get(name, np.zeros(np.shape(off)))
            both = before + off if name in volts else (1 + before) * (1 + np.asarray(off)) - 1
            total[name] = both
    return total


def checked_deviations(known: Iterable[Parameter], given: Deviations) -> dict[str, np.ndarray]:
    """Return deviations, relative or in volts, as (N,) arrays.

    Raises `UnknownNameError` if a parameter name is unknown. Raises `NetworkError` if a number is
    not finite or reduces a resistor, capacitor or gain to zero.
    """
    by_name = {parameter.name: parameter for parameter in known}
    result = {}
    for name, value in given.items():
        if name not in by_name:
            raise UnknownNameError.of("parameter of the circuit", name, by_name)
        parameter = by_name[name]
        try:
            array = np.broadcast_to(np.asarray(value, float), parameter.present.shape)
        except (TypeError, ValueError):
            raise NetworkError(
                f"deviation of {name}: expected one number or {len(parameter.present)} values, "
                f"one per cell, got {value!r}"
            ) from None
        low = -1.0 if parameter.kind.unit == "1" else -np.inf
        if not (np.isfinite(array).all() and (array > low).all()):
            raise NetworkError(
                f"deviation of {name}: expected finite numbers above {low:g}, got {value!r}"
            )
        result[name] = array
    return result


@checked
def rounded_to_series(circuit: Circuit, series: Series) -> dict[str, np.ndarray]:
    """Return relative deviations of resistors and capacitors rounded to a series.

    Capacitors follow the capacitor series that belongs to ``series``. The result is empty for a
    series with every value.
    """
    if not series.mantissas:
        return {}
    listed = {parameter.name for parameter in circuit.parameters}
    deviations = {}
    for part, ohms in circuit.resistors.items():
        present = np.isfinite(ohms)
        off = np.where(present, series.nearest(ohms) / np.where(present, ohms, 1.0) - 1, 0.0)
        for wire, row in enumerate(off):
            name = circuit.parameter_name(part, Quantity.INPUT, wire)
            if name in listed and row.any():
                deviations[name] = row
    for part, ohms in circuit.feedback.items():
        off = float(series.nearest(np.array(ohms))) / ohms - 1
        if off:
            name = circuit.parameter_name(part, Quantity.FEEDBACK)
            deviations[name] = np.full(circuit.schematic.network.stages, off)
    return deviations | _snapped_capacitors(circuit, series.capacitors)


def _snapped_capacitors(circuit: Circuit, series: Series) -> dict[str, np.ndarray]:
    deviations = {}
    for parameter in circuit.parameters:
        if parameter.quantity is Quantity.CAPACITOR:
            farads = np.where(parameter.present, circuit.own_capacitors(parameter.part), 1.0)
            off = series.nearest(farads) / farads - 1
            if off.any():
                deviations[parameter.name] = off
    return deviations
