"""Every number of a circuit that can be off: resistors, capacitors, offsets, gains, by name.

A *deviation* maps names to arrays (N,), one number a cell: relative for resistors, capacitors and
gains, in volts for offsets. Netlist, emulation, sensitivity and Monte Carlo all speak of the same
names, those of the parameters in the netlist.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ann_dc.errors import NetworkError, UnknownNameError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.elements import Adder, Generator, Integrator, Multiplier, Part, PICell
from ann_dc.hardware.parts.datasheet import Kind, Tolerances
from ann_dc.hardware.parts.e_series import Series

Deviations: TypeAlias = Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """A number of a cell.

    Attributes
    ----------
    name : str
        In the netlist, for instance ``r_m_phi_2`` or ``vos_q_x``.
    part : str
        The part it belongs to.
    kind : Kind
    present : (N,) array of bool
        In which cells there is one.
    meaning : str
        What it does, in words.
    """

    name: str
    part: str
    kind: Kind
    present: np.ndarray
    meaning: str


def parameters(circuit: Circuit) -> tuple[Parameter, ...]:
    """All parameters of a circuit, in the order of its parts.

    Raises
    ------
    NetworkError
        If the circuit has coordinators, whose resistor matrix has none.
    """
    schematic = circuit.schematic
    if schematic.coupling is not None:
        raise NetworkError(
            "parameters: the resistor matrix of coarse coordinators is not listed part by part; "
            "errors, bills and series are for circuits without coordinators"
        )
    found: list[Parameter] = []
    for part in schematic.parts:
        alive = schematic.alive_at(part.name)
        for name, kind, meaning, present in _of_part(circuit, part):
            present = alive & present
            if present.any():
                found.append(
                    Parameter(
                        name=name, part=part.name, kind=kind, present=present, meaning=meaning
                    )
                )
    return tuple(found)


Row: TypeAlias = tuple[str, Kind, str, "np.ndarray | bool"]


def _of_part(circuit: Circuit, part: Part) -> Iterator[Row]:
    """Name, kind, words and cells of the parameters of a part."""
    name, alias = part.name, circuit.schematic.alias[part.name]
    if isinstance(part, Multiplier):
        yield f"ge_{alias}", Kind.GAIN, f"gain of the multiplier {name}", True
        yield f"ox_{alias}", Kind.PRODUCT_OFFSET, f"offset of {name} at {part.a}", True
        yield f"oy_{alias}", Kind.PRODUCT_OFFSET, f"offset of {name} at {part.b}", True
        yield f"oz_{alias}", Kind.PRODUCT_OFFSET, f"offset of {name} at its output", True
    elif isinstance(part, Generator):
        yield f"ge_{alias}", Kind.GAIN, f"gain of the function generator {name}", True
        yield f"oy_{alias}", Kind.PRODUCT_OFFSET, f"offset of {name} at its output", True
    else:
        yield from _of_amplifier(circuit, part, alias)
    if name in circuit.schematic.inverted:
        yield f"e_n_{alias}", Kind.RESISTOR, f"resistors of {name}'s inverter", True
        yield f"vos_n_{alias}", Kind.OFFSET, f"offset of {name}'s inverter", True


def _of_amplifier(circuit: Circuit, part: Integrator | PICell | Adder, alias: str) -> Iterator[Row]:
    name = part.name
    for number, wire in enumerate(part.wires):
        meaning = f"resistor from {wire.source} to {name}"
        present = np.isfinite(circuit.resistors[name][number]) & circuit.schematic.fed_at(wire)
        yield f"r_{alias}_{number}", Kind.RESISTOR, meaning, present
    if name in circuit.feedback:
        yield f"rf_{alias}", Kind.RESISTOR, f"feedback resistor of {name}", True
    if name in circuit.capacitors:
        yield f"c_{alias}", Kind.CAPACITOR, f"capacitor of {name}", True
    yield f"vos_{alias}", Kind.OFFSET, f"offset of {name}'s op amp", True


def draw(known: Iterable[Parameter], tolerances: Tolerances, seed: int) -> dict[str, np.ndarray]:
    """Normal errors of the sizes of a spread; the same seed gives the same errors.

    Every kind of parameter has a random stream of its own: the errors of one kind stay as they
    are when the size of another changes.
    """
    streams = {kind: np.random.default_rng([seed, n]) for n, kind in enumerate(Kind)}
    drawn = {}
    for parameter in known:
        errors = streams[parameter.kind].standard_normal(len(parameter.present))
        size = getattr(tolerances, parameter.kind.value)
        if size > 0:
            drawn[parameter.name] = np.where(parameter.present, size * errors, 0.0)
    return drawn


def combined(known: Iterable[Parameter], *errors: Deviations) -> dict[str, np.ndarray]:
    """Several deviations at once: relative ones multiply, volts add up."""
    total: dict[str, np.ndarray] = {}
    volts = {parameter.name for parameter in known if parameter.kind.unit == "V"}
    for error in errors:
        for name, off in error.items():
            before = total.get(name, np.zeros(np.shape(off)))
            both = before + off if name in volts else (1 + before) * (1 + np.asarray(off)) - 1
            total[name] = both
    return total


def checked(known: Iterable[Parameter], given: Deviations) -> dict[str, np.ndarray]:
    """Deviations as (N,) arrays.

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
                f"deviation of {name}: expected one number or {len(parameter.present)} of them, one "
                f"a cell, got {value!r}"
            ) from None
        low = -1.0 if parameter.kind.unit == "1" else -np.inf
        if not (np.isfinite(array).all() and (array > low).all()):
            raise NetworkError(
                f"deviation of {name}: expected finite numbers above {low:g}, got {value!r}"
            )
        result[name] = array
    return result


def snapped(circuit: Circuit, series: Series) -> dict[str, np.ndarray]:
    """Deviations of all resistors when they are taken from a series.

    Raises
    ------
    NetworkError
        If the circuit has coordinators.

    Examples
    --------
    >>> float(E24.nearest(10_400.0)), float(E24_PAIRS.nearest(10_400.0))
    (10000.0, 10400.0)
    """
    if not series.mantissas:
        return {}
    alias, names = circuit.schematic.alias, {p.name for p in parameters(circuit)}
    deviations = {}
    for part, ohms in circuit.resistors.items():
        present = np.isfinite(ohms)
        off = np.where(present, series.nearest(ohms) / np.where(present, ohms, 1.0) - 1, 0.0)
        for number, row in enumerate(off):
            if f"r_{alias[part]}_{number}" in names and row.any():
                deviations[f"r_{alias[part]}_{number}"] = row
    for part, ohms in circuit.feedback.items():
        off = float(series.nearest(np.array(ohms))) / ohms - 1
        if off:
            deviations[f"rf_{alias[part]}"] = np.full(circuit.schematic.network.stages, off)
    return deviations
