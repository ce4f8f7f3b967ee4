"""Assembly of an emulation from the pieces of its parts.

Amplifiers, multipliers and function generators are described by pieces: `State` (a neuron),
`Coupling` (a weighted connection), and the blocks of a `Cell`. `assembled` makes one network of all
pieces. Connections keep the order of the pieces, which is the order of summation.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.nodes import Origin
from ann_dc.hardware.schematic.elements import UNLIMITED, arguments
from ann_dc.network.cell import (
    ONE,
    Block,
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Sum,
)
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network
from ann_dc.scale import IDENTITY, Scale

Weight: TypeAlias = float | np.ndarray
"""Weight of a coupling: one number, or one per cell (N,)."""


@dataclass(frozen=True, eq=False)
class State:
    """Neuron that represents a node; a node shared by all cells has one neuron."""

    name: str
    tau: Weight
    origin: Origin
    limiter: Limiter = UNLIMITED
    scale: Scale = IDENTITY


@dataclass(frozen=True, eq=False)
class Coupling:
    """Connection from the cell at ``offset``.

    Attributes
    ----------
    slopes : tuple of (parameter name, float or (N,) array)
        Change of the weight per deviation of a parameter.
    collected : bool
        True if a shared target receives from every cell and not only from its own, the last one.
    """

    source: str
    target: str
    weight: Weight
    offset: int = 0
    slopes: tuple[tuple[str, Weight], ...] = ()
    collected: bool = False


Piece: TypeAlias = State | Coupling | Block


def couplings(target: str, weights: Mapping[str, Weight]) -> Iterator[Coupling]:
    """Yield the connections into a node, with weights by source."""
    for source, weight in weights.items():
        yield Coupling(source, target, weight)


def weighted_sum(name: str, weights: Mapping[str, Weight]) -> Iterator[Piece]:
    """Yield a sum of nodes of its cell, with weights by source."""
    yield Sum(name=name)
    yield from couplings(name, weights)


def clipped(source: str, target: str, limit: float) -> Iterator[Piece]:
    """Yield ``limit`` times a source clipped to -1 .. 1: rectify(s + 1) - rectify(s - 1) - 1."""
    for sign in (1.0, -1.0):
        inner, outer = f"edge{sign:+.0f}.{target}", f"rectify{sign:+.0f}.{target}"
        yield from weighted_sum(inner, {source: 1.0, ONE: sign})
        yield Function(name=outer, function="rectify", x=inner)
        yield Coupling(outer, target, sign * limit)
    yield Coupling(ONE, target, -limit)


def assembled(
    circuit: Circuit, pieces_of_parts: Iterable[tuple[str, Iterable[Piece]]]
) -> Emulation:
    """Return the emulation of a circuit from the pieces of every part, without an initial state.

    Neurons are omitted in the cells without the part. An output with a fixed value there remains.
    """
    assembly = _Assembly(circuit)
    for part, pieces in pieces_of_parts:
        gone = np.flatnonzero(~circuit.schematic.alive_at(part)).tolist()
        for piece in pieces:
            if isinstance(piece, State):
                assembly.add_state(piece, gone)
            elif isinstance(piece, Coupling):
                assembly.couple(piece)
            else:
                assembly.blocks.append(piece)
    for name, wire in circuit.schematic.plain.items():
        assembly.blocks.append(Sum(name=name))
        assembly.couple(Coupling(wire.source, name, wire.weight))
    return Emulation(
        network=assembly.network(),
        circuit=circuit,
        origins=assembly.origins,
        slopes={name: tuple(found) for name, found in assembly.slopes.items()},
    )


class _Assembly:
    """Network under construction."""

    def __init__(self, circuit: Circuit) -> None:
        self.schematic, self.ideal = circuit.schematic, circuit.schematic.network
        self.blocks: list[Block] = []
        self.origins: dict[str, Origin] = {}
        self.slopes: dict[str, list[tuple[str, np.ndarray]]] = {}
        self._neurons: dict[str, Neuron] = {}
        self._connections: list[Connection] = []
        self._omitted: list[Omitted] = []

    def add_state(self, state: State, gone: Iterable[int]) -> None:
        """Add a neuron, omitted at the stages ``gone`` unless it is shared or fixed there."""
        shared = state.origin.node in self.schematic.shared
        self._neurons[state.name] = Neuron(
            name=state.name,
            tau=state.tau,
            scale=state.scale,
            limiter=state.limiter,
            shared=shared,
        )
        self.origins[state.name] = state.origin
        pins = self.schematic.pins
        self._omitted += [
            Omitted(neuron=state.name, stage=stage)
            for stage in gone
            if not shared and (state.name, stage) not in pins
        ]

    def couple(self, coupling: Coupling) -> None:
        """Add a connection, in the last cell only if its target is shared."""
        target = self._neurons.get(coupling.target)
        single = target is not None and target.shared and not coupling.collected
        here = np.arange(self.ideal.stages) >= (self.ideal.stages - 1 if single else 0)
        connection = Connection(
            source=coupling.source,
            target=coupling.target,
            weight=np.where(here, coupling.weight, 0.0),
            template=coupling.offset,
        )
        self._connections.append(connection)
        for parameter, slope in coupling.slopes:
            slopes = self.slopes.setdefault(parameter, [])
            slopes.append((connection.name, np.where(here, slope, 0.0)))

    def network(self) -> Network:
        """Return the complete network without an initial state."""
        return Network(
            cell=Cell(
                neurons=tuple(self._neurons.values()),
                inputs=self.ideal.cell.inputs,
                blocks=self._ordered(),
                connections=tuple(self._connections),
            ),
            stages=self.ideal.stages,
            inputs=self.ideal.inputs,
            input_scales=self.ideal.input_scales,
            fixed=self.ideal.fixed,
            omitted=tuple(self._omitted),
            left_boundary=self.ideal.left_boundary,
            title=f"{self.ideal.title}, as a circuit",
        )

    def _ordered(self) -> tuple[Block, ...]:
        """Return the blocks in topological order."""
        sources: dict[str, list[str]] = {}
        for connection in self._connections:
            sources.setdefault(connection.target, []).append(connection.source)
        by_name = {block.name: block for block in self.blocks}
        placed: dict[str, Block] = {}

        def place(name: str) -> None:
            block = by_name.get(name)
            if block is None or name in placed:
                return
            for source in arguments(block) or sources.get(name, ()):
                place(source)
            placed[name] = block

        for name in by_name:
            place(name)
        return tuple(placed.values())
