"""Assembly of an emulation from neurons, blocks and wires.

Functions, each for one technology, fill an assembly part by part, and the assembly becomes a
`Network`. It also records the node of the ideal network that every neuron represents, and the
change of weights with part errors.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit, Quantity
from ann_dc.hardware.circuit.loads import Outputs
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import DifferentialPairs
from ann_dc.hardware.schematic.elements import UNLIMITED, Amplifier
from ann_dc.network.cell import (
    ONE,
    Block,
    Cell,
    Connection,
    Function,
    Limiter,
    Neuron,
    Product,
    Sum,
)
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network
from ann_dc.scale import IDENTITY, Scale


class Assembly:
    """Network of a circuit under construction.

    Deviations (N,) by parameter name are already checked. Clamps of limits move if ``moving`` is
    true.

    Attributes
    ----------
    transistors : bool
        True if op amps and diodes are those of a chip.
    halves : float
        Number of op amps of a pair over which the offset is divided.
    outputs : Outputs
        Loaded outputs of the parts.
    omega : float
        Gain-bandwidth product of the op amps, in radians per unit of network time.
    slopes : dict of parameter name to list of (connection name, (N,) array)
        Change of connection weights per deviation of a parameter.
    """

    def __init__(
        self,
        circuit: Circuit,
        level: Level,
        deviations: Mapping[str, np.ndarray],
        moving: bool,
    ) -> None:
        self.moving = moving
        self.circuit, self.datasheet = circuit, level.datasheet
        self.transistors = level.transistors
        self.halves = 2.0 if isinstance(level.technology, DifferentialPairs) else 1.0
        self.schematic, self.scaling = circuit.schematic, circuit.scaling
        self.ideal = circuit.schematic.network
        self.stages = self.ideal.stages
        self.outputs = Outputs(circuit, level)
        self.omega = self.outputs.omega
        self.origins: dict[str, Origin] = {}
        self.slopes: dict[str, list[tuple[str, np.ndarray]]] = {}
        self._deviations = deviations
        self._neurons: list[Neuron] = []
        self._blocks: list[Block] = []
        self._connections: list[Connection] = []
        self._absent: list[Omitted] = []
        self._shared: set[str] = set()

    def neuron(
        self,
        name: str,
        tau: float | np.ndarray,
        origin: Origin,
        *,
        scale: Scale = IDENTITY,
        limiter: Limiter = UNLIMITED,
    ) -> None:
        """Add a neuron that represents a node; a node shared by all cells has one neuron."""
        shared = origin.node in self.schematic.shared
        if shared:
            self._shared.add(name)
        self._neurons.append(
            Neuron(name=name, tau=tau, scale=scale, limiter=limiter, shared=shared)
        )
        self.origins[name] = origin

    def sum(self, name: str) -> None:
        """Add a weighted sum."""
        self._blocks.append(Sum(name=name))

    def product(self, name: str, a: str, b: str) -> None:
        """Add the product of a and b."""
        self._blocks.append(Product(name=name, a=a, b=b))

    def function(self, name: str, function: str, x: str) -> None:
        """Add a function of x."""
        self._blocks.append(Function(name=name, function=function, x=x))

    def connect(self, source: str, target: str, weight: float | np.ndarray, offset: int = 0) -> str:
        """Add a wire from the cell at ``offset`` and return its name.

        A shared target is in the last cell.
        """
        weight = np.where(self._here(target), weight, 0.0)
        return self.collect(source, target, weight, offset)

    def collect(self, source: str, target: str, weight: float | np.ndarray, offset: int = 0) -> str:
        """Add a wire in every cell, weights summed at a shared target; return its name."""
        weight = np.broadcast_to(np.asarray(weight, float), self.stages)
        connection = Connection(source=source, target=target, weight=weight, template=offset)
        self._connections.append(connection)
        return connection.name

    def _here(self, target: str) -> np.ndarray:
        """Return a mask (N,) of the cells that contain a node."""
        return np.arange(self.stages) >= (self.stages - 1 if target in self._shared else 0)

    def leave_out(self, name: str, stages: Iterable[int]) -> None:
        """Omit a neuron at some stages; a shared neuron stays in the last cell."""
        if name not in self._shared:
            self._absent += [Omitted(neuron=name, stage=stage) for stage in stages]

    def leave_out_unpinned(self, name: str, present: np.ndarray) -> None:
        """Omit outputs in cells without the part (``present``) and without a fixed value."""
        gone = np.flatnonzero(~present).tolist()
        self.leave_out(name, [k for k in gone if (name, k) not in self.schematic.pins])

    def leave_out_inside(self, nodes: AmplifierNodes, stages: Iterable[int]) -> None:
        """Omit the existing inner neurons of an amplifier at some stages."""
        stages = tuple(stages)
        for name in (nodes.first, nodes.ground, nodes.lagging, nodes.trailing):
            if name in self.origins:
                self.leave_out(name, stages)

    def deviation(self, part: str, quantity: Quantity, wire: int | None = None) -> np.ndarray:
        """Return the deviation (N,) of a quantity of a part."""
        name = self.circuit.parameter_name(part, quantity, wire)
        return self._deviations.get(name, np.zeros(self.stages))

    def slope(
        self,
        connection: str,
        slope: float | np.ndarray,
        part: str,
        quantity: Quantity,
        wire: int | None = None,
    ) -> None:
        """Record the change of a connection's weight with a quantity of a part."""
        slope = np.broadcast_to(np.asarray(slope, float), self.stages)
        name = self.circuit.parameter_name(part, quantity, wire)
        self.slopes.setdefault(name, []).append((connection, slope))

    def bias(
        self,
        target: str,
        per_volt: float,
        part: str,
        quantity: Quantity,
        known: float | np.ndarray = 0.0,
    ) -> None:
        """Add a voltage error plus ``known`` volts as a weight of the constant one."""
        volts = self.deviation(part, quantity) + known
        connection = self.connect(ONE, target, volts * per_volt)
        self.slope(connection, np.where(self._here(target), per_volt, 0.0), part, quantity)

    def slewing(self, drive: str, name: str, unit: float) -> float:
        """Add a sum before a slew-limited op amp; return the weight of a net input of 1."""
        largest = self.datasheet.slew * self.scaling.time / self.omega * unit
        self.sum(drive)
        self.clip(drive, name, largest)
        return 1 / largest

    def add(self, blocks: Iterable[Block], wires: Iterable[Connection]) -> None:
        """Add blocks, and wires between them."""
        self._blocks += blocks
        for wire in wires:
            self.connect(wire.source, wire.target, wire.weight)

    def clip(self, source: str, target: str, limit: float) -> None:
        """Add ``limit`` times a source clipped to -1 .. 1.

        The clip is rectify(s + 1) - rectify(s - 1) - 1.
        """
        for sign in (1.0, -1.0):
            inner, outer = f"edge{sign:+.0f}.{target}", f"rectify{sign:+.0f}.{target}"
            self.sum(inner)
            self.function(outer, "rectify", inner)
            self.connect(source, inner, 1.0)
            self.connect(ONE, inner, sign)
            self.connect(outer, target, sign * limit)
        self.connect(ONE, target, -limit)

    def scale_of(self, name: str) -> Scale:
        """Return the scale from a node to the user's value."""
        return self.ideal.neuron(name).scale if name in self.ideal.neuron_index else Scale()

    def conductance(self, part: Amplifier, scale: np.ndarray) -> np.ndarray:
        """Return Gamma (N,), the weight of the virtual ground relative to the output.

        Wires from all cells count in each cell.
        """
        units, total = self.scaling.unit, np.zeros(self.stages)
        for number, wire in enumerate(part.wires):
            share = np.abs(wire.weight) * units[wire.source] / units[part.name]
            off = self.deviation(part.name, Quantity.INPUT, number)
            total += self.schematic.fed_at(wire) * share / (1 + off)
        return (total.sum() if self.schematic.collects(part.name) else total) * scale

    def network(self) -> Network:
        """Return the complete network without an initial state."""
        return Network(
            cell=Cell(
                neurons=tuple(self._neurons),
                inputs=self.ideal.cell.inputs,
                blocks=self._ordered(),
                connections=tuple(self._connections),
            ),
            stages=self.stages,
            inputs=self.ideal.inputs,
            input_scales=self.ideal.input_scales,
            fixed=self.ideal.fixed,
            omitted=tuple(self._absent),
            left_boundary=self.ideal.left_boundary,
            title=f"{self.ideal.title}, as a circuit",
        )

    def _ordered(self) -> tuple[Block, ...]:
        """Return the blocks in topological order."""
        arriving: dict[str, list[str]] = {}
        for connection in self._connections:
            arriving.setdefault(connection.target, []).append(connection.source)
        by_name = {block.name: block for block in self._blocks}
        placed: dict[str, Block] = {}

        def place(name: str) -> None:
            block = by_name.get(name)
            if block is None or name in placed:
                return
            for source in _read_by(block, arriving):
                place(source)
            placed[name] = block

        for name in by_name:
            place(name)
        return tuple(placed.values())


def _read_by(block: Block, arriving: Mapping[str, list[str]]) -> list[str]:
    """Return the input nodes of a block."""
    if isinstance(block, Product):
        return [block.a, block.b]
    return [block.x] if isinstance(block, Function) else arriving.get(block.name, [])
