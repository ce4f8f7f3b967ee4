"""Every number of a circuit that can be off, and what it is called.

A parameter is a quantity of a part: the third input resistor of ``m.phi``, the offset of ``q.x``.
Its name, ``r_m_phi_2`` or ``vos_q_x``, is spelled here and nowhere else; netlist, emulation, bill,
noise and error budget ask for the quantity of a part.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    Generator,
    GridNode,
    Multiplier,
    Part,
    PICell,
)
from ann_dc.hardware.schematic.schematic import Schematic


class Quantity(enum.Enum):
    """What a number is at its part: the letters of its name, and its kind.

    Resistors of an amplifier are those of its wires, its feedback and its inverter; offsets those
    of its op amp, of its inverter, and of the clamps of its rails. A multiplier has offsets at its
    inputs x and y and at its output z, a function generator at its output y.
    """

    INPUT = "r", Kind.RESISTOR
    FEEDBACK = "rf", Kind.RESISTOR
    CAPACITOR = "c", Kind.CAPACITOR
    OFFSET = "vos", Kind.OFFSET
    LOW_OFFSET = "vos_lo", Kind.OFFSET
    HIGH_OFFSET = "vos_hi", Kind.OFFSET
    INVERTER = "e_n", Kind.RESISTOR
    INVERTER_OFFSET = "vos_n", Kind.OFFSET
    GAIN = "ge", Kind.GAIN
    OFFSET_X = "ox", Kind.PRODUCT_OFFSET
    OFFSET_Y = "oy", Kind.PRODUCT_OFFSET
    OFFSET_Z = "oz", Kind.PRODUCT_OFFSET

    @property
    def letters(self) -> str:
        """How names of such parameters begin."""
        return self.value[0]

    @property
    def kind(self) -> Kind:
        """Which tolerance it has."""
        return self.value[1]

    def named(self, alias: str, wire: int | None = None) -> str:
        """Name of this quantity of the part of that alias; an input is told by its wire.

        Parameters
        ----------
        alias : str
            What a netlist calls the part.
        wire : int, optional
            Which of the part's wires an input resistor ends.

        Returns
        -------
        str

        Examples
        --------
        >>> Quantity.INPUT.named("m_phi", 2), Quantity.OFFSET.named("q_x")
        ('r_m_phi_2', 'vos_q_x')
        """
        plain = f"{self.letters}_{alias}"
        return plain if wire is None else f"{plain}_{wire}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """A number of a cell.

    Attributes
    ----------
    part : str
        The part it belongs to.
    alias : str
        What a netlist calls that part.
    quantity : Quantity
        What it is at the part.
    wire : int or None
        Which of the part's wires an input resistor ends; None for other quantities.
    present : (N,) array of bool
        In which cells there is one.
    owner : str
        What has it, in words: what a bill lists for an offset or a gain.
    meaning : str
        What it is, in words.
    """

    part: str
    alias: str
    quantity: Quantity
    wire: int | None = None
    present: np.ndarray
    owner: str
    meaning: str

    @property
    def name(self) -> str:
        """In the netlist and in deviations, for instance ``r_m_phi_2`` or ``vos_q_x``."""
        return self.quantity.named(self.alias, self.wire)

    @property
    def kind(self) -> Kind:
        """Which tolerance it has."""
        return self.quantity.kind


@dataclass(frozen=True)
class _Entry:
    """A quantity of a part before it is known in which cells the part is."""

    quantity: Quantity
    meaning: str
    owner: str = ""
    wire: int | None = None
    present: np.ndarray | bool = True


def parameters_of(
    schematic: Schematic,
    alias: Mapping[str, str],
    resistors: Mapping[str, np.ndarray],
    rails: Mapping[str, tuple[float, float]],
) -> tuple[Parameter, ...]:
    """All parameters of a schematic, in the order of its parts.

    The resistors of a grid are not among them: each belongs to two nodes.

    Parameters
    ----------
    schematic : Schematic
    alias : mapping of part name to str
        What a netlist calls each part.
    resistors : mapping of part name to (wires, N) array
        Infinite where a wire has none.
    rails : mapping of part name to (float, float)
        Volts, low and high, of integrators that have any; infinite where none is.

    Returns
    -------
    tuple of Parameter
    """
    found: list[Parameter] = []
    for part in schematic.parts:
        alive = schematic.alive_at(part.name)
        wired = alive | schematic.collects(part.name)
        entries = _entries(schematic, part, resistors), _of_clamps(part, rails.get(part.name, ()))
        for entry in chain(*entries):
            present = entry.present & (alive if entry.wire is None else wired)
            if present.any():
                found.append(
                    Parameter(
                        part=part.name,
                        alias=alias[part.name],
                        quantity=entry.quantity,
                        wire=entry.wire,
                        present=present,
                        owner=entry.owner,
                        meaning=entry.meaning,
                    )
                )
    return tuple(found)


def _entries(
    schematic: Schematic, part: Part, resistors: Mapping[str, np.ndarray]
) -> Iterator[_Entry]:
    name = part.name
    if isinstance(part, Multiplier):
        yield from _of_multiplier(part)
    elif isinstance(part, Generator):
        yield from _of_generator(part)
    elif isinstance(part, GridNode):
        owner = f"{name}'s follower"
        yield _Entry(Quantity.OFFSET, f"offset of {owner}", owner)
    else:
        yield from _of_amplifier(schematic, part, resistors[name])
    if name in schematic.inverted:
        inverter = f"{name}'s inverter"
        yield _Entry(Quantity.INVERTER, f"resistors of {inverter}", inverter)
        yield _Entry(Quantity.INVERTER_OFFSET, f"offset of {inverter}", inverter)


def _of_multiplier(part: Multiplier) -> Iterator[_Entry]:
    name, owner = part.name, f"multiplier {part.name}"
    yield _Entry(Quantity.GAIN, f"gain of the {owner}", owner)
    yield _Entry(Quantity.OFFSET_X, f"offset of {name} at {part.a}", owner)
    yield _Entry(Quantity.OFFSET_Y, f"offset of {name} at {part.b}", owner)
    yield _Entry(Quantity.OFFSET_Z, f"offset of {name} at its output", owner)


def _of_generator(part: Generator) -> Iterator[_Entry]:
    name, owner = part.name, f"function generator {part.name}"
    yield _Entry(Quantity.GAIN, f"gain of the {owner}", owner)
    yield _Entry(Quantity.OFFSET_Y, f"offset of {name} at its output", owner)


def _of_amplifier(schematic: Schematic, part: Amplifier, resistors: np.ndarray) -> Iterator[_Entry]:
    name, owner = part.name, f"{part.name}'s op amp"
    for number, wire in enumerate(part.wires):
        meaning = f"resistor from {wire.source} to {name}"
        present = np.isfinite(resistors[number]) & schematic.fed_at(wire)
        yield _Entry(Quantity.INPUT, meaning, owner, number, present)
    if isinstance(part, (PICell, Adder)):
        yield _Entry(Quantity.FEEDBACK, f"feedback resistor of {name}", owner)
    if not isinstance(part, Adder):
        yield _Entry(Quantity.CAPACITOR, f"capacitor of {name}", owner)
    yield _Entry(Quantity.OFFSET, f"offset of {owner}", owner)


def _of_clamps(part: Part, rails: Iterable[float]) -> Iterator[_Entry]:
    for quantity, word, volts in zip(CLAMP_OFFSETS, ("lower", "upper"), rails):
        if np.isfinite(volts):
            owner = f"{part.name}'s {word} clamp"
            yield _Entry(quantity, f"offset of {owner}", owner)


CLAMP_OFFSETS = Quantity.LOW_OFFSET, Quantity.HIGH_OFFSET
"""Of the clamps of an integrator's rails, in volts; the lower one first."""

RESERVED = ("src", "gnd", "null", "rst", "p1", "p2", "s", "sp", "sn")
"""Names that a netlist needs for itself."""

LONGEST = 200
"""Letters of a name at most."""


def aliases(names: Iterable[str]) -> dict[str, str]:
    """Names that a netlist can carry: lower case, unique, without a double underscore.

    Parameters
    ----------
    names : iterable of str
        Of parts, neurons and inputs.

    Returns
    -------
    dict of str to str

    Raises
    ------
    NetworkError
        If a name has unprintable letters or is too long.

    Examples
    --------
    >>> aliases(["q.x", "Q X", "a*b"])
    {'q.x': 'q_x', 'Q X': 'q_x_v2', 'a*b': 'a_x_b'}
    """
    found: dict[str, str] = {}
    taken = set(RESERVED)
    for name in names:
        if not name.isprintable() or len(name) > LONGEST:
            raise NetworkError(f"circuit: {name!r} is no name that a netlist can carry")
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower().replace("*", "_x_")).strip("_") or "node"
        plain = plain[:40].strip("_") if plain[0].isalpha() else f"n_{plain[:40]}".strip("_")
        alias, number = plain, 2
        while not taken.isdisjoint({alias, f"n_{alias}"}):  # vos_n_x is that of x's inverter
            alias, number = f"{plain}_v{number}", number + 1
        taken |= {alias, f"n_{alias}"}
        found[name] = alias
    return found
