"""Elements of a schematic: parts of one cell without voltages or resistances.

A sum of one node of its cell with a positive weight needs no part: it is the voltage of that node
on another scale. Multipliers and function generators, whose inputs draw no current, read that
voltage directly. A sum with a resistor as a reader needs an amplifier.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.network.cell import ONE, Block, Cell, Connection, Function, Limiter, Product, Sum

UNLIMITED = Limiter()
"""Limiter of integrators without limits."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Wire:
    """Weighted connection: weight (N,) times source.

    ``offset`` is the cell of the source relative to that of the wire: -1, 0 or 1 for wires of the
    problem, any number of cells for those of a preconditioner.
    """

    source: str
    offset: int
    weight: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Integrator:
    """Integrator x' = rate * sum of wires.

    The name is that of the neuron, or ``own.<neuron>`` for the separate integrator of a neuron that
    a preconditioner reaches. ``rate`` (N,) is in units of 1 / network time; zero for fixed or
    omitted cells. At the limits, in network units, the output stops, and leaves without delay. A
    ``shared`` integrator exists once, in the last cell, and receives from all cells. The weight of
    a wire at a stage is that of the sending cell.
    """

    name: str
    wires: tuple[Wire, ...]
    rate: np.ndarray
    limiter: Limiter = UNLIMITED
    shared: bool = False

    @property
    def with_limits(self) -> bool:
        """True if the integrator has a saturation limit."""
        return bool(np.isfinite([self.limiter.low, self.limiter.high]).any())

    @property
    def present(self) -> np.ndarray:
        """True for the cells (N,) that have the integrator."""
        return self.rate > 0

    @property
    def tau(self) -> np.ndarray:
        """1 / rate (N,) in network time; one for absent cells."""
        return 1.0 / np.where(self.present, self.rate, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class PICell:
    """PI cell m = mu + rho c, mu' = rate c, c the sum of wires; or rectifying neuron.

    A rectifying multiplier neuron has m = max(0, mu + rho c), and mu leaks while m is zero, mu' =
    -rate mu / rho. That of a compliant constraint has a wire from its output, -d m: a resistor
    across the entire feedback. The name is that of m, ``dual`` that of mu; if mu is omitted, so is
    m. ``rate`` (N,) is in units of 1 / network time; zero for omitted cells.
    """

    name: str
    dual: str
    wires: tuple[Wire, ...]
    rate: np.ndarray
    rho: np.ndarray
    rectified: bool = False

    @property
    def present(self) -> np.ndarray:
        """True for the cells (N,) that have the PI cell."""
        return self.rate > 0

    @property
    def compliance(self) -> np.ndarray:
        """Compliance d (N,), zero without a wire from the output."""
        own = [wire.weight for wire in self.wires if wire.source == self.name and not wire.offset]
        return -np.sum(own, axis=0) if own else np.zeros(len(self.rate))

    @property
    def tau(self) -> np.ndarray:
        """Time constant rho / rate (N,) in network time; one for absent cells."""
        return np.where(self.present, self.rho / np.where(self.present, self.rate, 1.0), 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Adder:
    """Adder y = sum of wires, in the cells ``present`` (N,); all cells by default."""

    name: str
    wires: tuple[Wire, ...]
    present: np.ndarray | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Multiplier:
    """Multiplier y = a b with differential inputs."""

    name: str
    a: str
    b: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Generator:
    """Function generator y = g(x), with g the name of a function block."""

    name: str
    function: str
    x: str


@dataclass(frozen=True, kw_only=True, eq=False)
class GridNode:
    """Pair of grid nodes v and -v with a follower: lag v' = sum of wires - v.

    Every resistor occurs twice: between nodes of equal sign for a positive weight, and crosswise
    for a negative weight. The network therefore needs no inverter. The follower carries the neuron
    of that name. Wires come from the integrators and from other nodes of the network, by the names
    of their neurons.
    """

    name: str
    wires: tuple[Wire, ...]
    present: np.ndarray


Part = Integrator | PICell | Adder | GridNode | Multiplier | Generator
Amplifier = Integrator | PICell | Adder
"""Parts with wires into a virtual ground."""


def connections_by_target(cell: Cell) -> dict[str, list[Connection]]:
    """Return the incoming connections of every node that has some."""
    arriving: dict[str, list[Connection]] = {}
    for connection in cell.connections:
        arriving.setdefault(connection.target, []).append(connection)
    return arriving


def arguments(block: Block) -> tuple[str, ...]:
    """Return the nodes that a product or a function reads; none for a sum."""
    if isinstance(block, Product):
        return block.a, block.b
    return (block.x,) if isinstance(block, Function) else ()


def plain_sums(cell: Cell) -> dict[str, Wire]:
    """Return the sums of a cell without a part, each with the wire from its carrier.

    The order is that of the blocks. Weights are scalars, and no source is such a sum.

    Examples
    --------
    >>> from ann_dc.network import Neuron
    >>> wires = (Connection(source="x", target="twice", weight=2.0),)
    >>> blocks = (Sum(name="twice"), Function(name="sine", function="sin", x="twice"))
    >>> found = plain_sums(Cell(neurons=(Neuron(name="x"),), blocks=blocks, connections=wires))
    >>> found["twice"].source, float(found["twice"].weight)
    ('x', 2.0)
    """
    arriving = connections_by_target(cell)
    without_current = {node for block in cell.blocks for node in arguments(block)}
    read = without_current - {connection.source for connection in cell.connections}
    plain: dict[str, Wire] = {}
    for block in cell.blocks:
        wires = arriving.get(block.name, [])
        if isinstance(block, Sum) and block.name in read and len(wires) == 1:
            (wire,) = wires
            weight = np.asarray(wire.weight, float)
            if wire.template == 0 and wire.source != ONE and weight.ndim == 0 and weight > 0:
                plain[block.name] = Wire(source=wire.source, offset=0, weight=weight)
    return plain
