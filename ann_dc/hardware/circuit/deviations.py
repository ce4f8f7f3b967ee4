"""How far the numbers of a circuit are off: drawn, given by a user, of a series, combined.

A *deviation* maps names of parameters to arrays (N,), one number a cell: relative for resistors,
capacitors and gains, in volts for offsets. Netlist, emulation, sensitivity and Monte Carlo all
speak of the same names, those of the parameters in the netlist.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.hardware.circuit.circuit import Circuit, Parameter, Quantity
from ann_dc.hardware.parts.datasheet import Kind, Tolerances
from ann_dc.hardware.parts.e_series import Series
from ann_dc.validation.checked import checked
from ann_dc.validation.values import FloatOrNan

Deviations: TypeAlias = Mapping[str, FloatOrNan | np.ndarray]
"""How far parameters are off, by name."""


@checked
def draw(known: Iterable[Parameter], tolerances: Tolerances, seed: int) -> dict[str, np.ndarray]:
    """Errors of the sizes of tolerances; the same seed gives the same errors.

    Those of resistors and capacitors are uniform within their bounds, all others normal. Every
    kind of parameter has a random stream of its own, and temperature coefficients have others: the
    errors of one kind stay as they are when the size of another changes, and parts are the same
    ones at every temperature.

    Parameters
    ----------
    known : iterable of Parameter
        Those of a circuit.
    tolerances : Tolerances
        Size and drift of each kind.
    seed : int

    Returns
    -------
    dict of parameter name to (N,) array
        Relative, or in volts; kinds whose size is zero are left out.

    Examples
    --------
    >>> from ann_dc.hardware.circuit import Parameter, Quantity
    >>> part = dict(part="x", alias="x", present=np.array([True]), owner="x", meaning="x")
    >>> known = [Parameter(quantity=Quantity.OFFSET, **part)]
    >>> drawn = draw(known, Tolerances(offset=1e-3), seed=0)
    >>> list(drawn), bool(abs(drawn["vos_x"][0]) < 0.01)
    (['vos_x'], True)
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
    """Errors of size one."""
    return stream.uniform(-1.0, 1.0, count) if kind.bounded else stream.standard_normal(count)


def combined(known: Iterable[Parameter], *errors: Deviations) -> dict[str, np.ndarray]:
    """Several deviations at once: relative ones multiply, volts add up.

    Parameters
    ----------
    known : iterable of Parameter
        Those of a circuit: they say which deviations are in volts.
    *errors : mapping of parameter name to (N,) array

    Returns
    -------
    dict of parameter name to (N,) array
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
    """Deviations as (N,) arrays.

    Parameters
    ----------
    known : iterable of Parameter
        Those of a circuit.
    given : mapping of parameter name to float or (N,) array
        Relative, or in volts.

    Returns
    -------
    dict of parameter name to (N,) array

    Raises
    ------
    UnknownNameError
        If no parameter has that name.
    NetworkError
        If a number is not finite, or makes a resistor, capacitor or gain vanish.
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
                f"deviation of {name}: expected one number or {len(parameter.present)} of them, "
                f"one a cell, got {value!r}"
            ) from None
        low = -1.0 if parameter.kind.unit == "1" else -np.inf
        if not (np.isfinite(array).all() and (array > low).all()):
            raise NetworkError(
                f"deviation of {name}: expected finite numbers above {low:g}, got {value!r}"
            )
        result[name] = array
    return result


@checked
def snapped(circuit: Circuit, series: Series) -> dict[str, np.ndarray]:
    """Deviations of all resistors when they are taken from a series, and of all capacitors with it.

    Parameters
    ----------
    circuit : Circuit
    series : Series

    Returns
    -------
    dict of parameter name to (N,) array
        Relative; empty for a series that has every value.

    Examples
    --------
    >>> from ann_dc.hardware.parts import E24, E24_PAIRS
    >>> float(E24.nearest(10_400.0)), float(E24_PAIRS.nearest(10_400.0))
    (10000.0, 10400.0)
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
