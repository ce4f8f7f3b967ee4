r"""Parts of an analog cell: op amps, multipliers, function generators and wiring.

A schematic is a network read as hardware, before any voltage or resistor is chosen. It differs from
the network's node list in three respects:

- A PI dual is one op amp. Its residual sum, integrator and proportional path form an amplifier with
  series R-C feedback and the residual's inputs at its virtual ground, m = mu + rho c. Two diodes
  around the amplifier make it a rectifying multiplier neuron, m = max(0, mu + rho c), whose
  capacitor discharges through the resistor while the output is zero.
- A preconditioner beyond a diagonal one needs no additional integrators. A separate integrator D of
  every reached neuron integrates its net input, D' = d. The neuron z, z' = M d, is the weighted sum
  z = M D. The sum has as many layers of adders as the preconditioner kind
  (`preconditioner_wiring`).
- Integrators and summing amplifiers invert. A source of polarity :math:`\sigma` and weight w
  reaches a part at polarity p with the right sign if :math:`p\,\sigma\,w < 0`; an inverter makes
  the other sign. Polarities are chosen so that few inverters are needed. Multipliers have
  differential inputs, so products have no sign constraint, and a differential circuit has both
  signs of every node. A rectifying multiplier neuron has the sign of its diodes, which is not
  changed.

A sum that only multiplies a node is not a part (`plain_sums`). Nodes shared by all cells are placed
in the last cell. On one line along the cell array the currents of all cells add up at the virtual
ground of the shared integrator; another carries its output, which every cell reads. Blocks that
depend only on shared neurons, for an objective z + r (J - E) and its rectifier, are placed there
once, each with a line.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.schematic.buildable import limited_neurons
from ann_dc.hardware.schematic.elements import (
    Adder,
    Amplifier,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
    Wire,
    arguments,
    connections_by_target,
    plain_sums,
)
from ann_dc.hardware.schematic.pi_cells import Wires, fused_cells, rates_of, wires_of
from ann_dc.hardware.schematic.preconditioner_wiring import OWN, preconditioner_parts, wiring_of
from ann_dc.network.cell import ONE, Product, Sum
from ann_dc.network.network import Network
from ann_dc.network.selection import clamped_rows


def polarities(parts: Sequence[Part]) -> dict[str, int]:
    """Return polarities (+1 or -1), flipped one by one while this saves an inverter."""
    ordered = sorted(parts, key=lambda part: isinstance(part, Multiplier))  # free of sign: last
    # a dual's output is inverted: primal and dual read each other with opposite signs
    polarity = {part.name: -1 if isinstance(part, PICell) else 1 for part in ordered}
    readings = _Readings(parts, list(polarity))
    signs = np.array(list(polarity.values()))
    best = readings.inverted(signs).sum()
    turned = [i for i, p in enumerate(ordered) if not (isinstance(p, PICell) and p.rectified)]
    improved = True
    while improved:
        improved = False
        for part in turned:
            signs[part] *= -1
            count = readings.inverted(signs).sum()
            if count < best:
                best, improved = count, True
            else:
                signs[part] *= -1
    return dict(zip(polarity, signs.tolist()))


def inverted(parts: Sequence[Part], polarity: Mapping[str, int]) -> set[str]:
    """Return the parts that need an inverter per cell for the other sign."""
    names = list(polarity)
    found = _Readings(parts, names).inverted(np.array(list(polarity.values())))
    return {names[part] for part in np.flatnonzero(found)}


class _Readings:
    """Readers and sources with signs: every sign of every wire once."""

    def __init__(self, parts: Sequence[Part], names: list[str]) -> None:
        self.count = len(names)
        place = {name: i for i, name in enumerate(names)}
        found = {
            (place[wire.source], place[part.name], sign)
            for part in parts
            if isinstance(part, Amplifier)
            for wire in part.wires
            if wire.source in place  # an input comes with both signs
            for sign in np.unique(np.sign(wire.weight)).astype(int).tolist()
            if sign
        }
        found |= {  # a pair of nodes takes its integrator with both signs
            (place[wire.source], place[part.name], sign)
            for part in parts
            if isinstance(part, GridNode)
            for wire in part.wires
            if wire.source.startswith(OWN)
            for sign in (1, -1)
        }
        self.table = np.array(sorted(found), int).reshape(-1, 3)

    def inverted(self, signs: np.ndarray) -> np.ndarray:
        """Return a mask (parts,) of the parts needed with both signs, for signs (parts,)."""
        sources, targets, sign = self.table.T
        wrong = sign * signs[sources] * signs[targets] > 0
        return np.bincount(sources[wrong], minlength=self.count) > 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Schematic:
    """Parts of a cell that occurs N times.

    All cells have equal parts, except for the ends and preconditioner nodes. The polarity (+1 or
    -1) is the sign of a part's output relative to its node; inputs come with both signs. In a
    differential schematic every output exists with both signs, so no inverter is needed. ``plain``
    maps sums without a part to wires from the nodes whose voltages carry them.
    """

    network: Network
    parts: tuple[Part, ...]
    polarity: dict[str, int]
    differential: bool = False
    plain: Mapping[str, Wire] = field(default_factory=dict)

    @cached_property
    def by_name(self) -> dict[str, Part]:
        """Parts by the name of their node."""
        return {part.name: part for part in self.parts}

    def count(self, kind: type) -> int:
        """Return the number of parts of a kind over all cells, fixed neurons included."""
        return sum(self._cells(part) for part in self.parts if isinstance(part, kind))

    def _cells(self, part: Part) -> int:
        if part.name in self.shared or isinstance(part, (Adder, GridNode)):
            return int(self.alive_at(part.name).sum())
        return self.network.stages

    @cached_property
    def shared(self) -> frozenset[str]:
        """Nodes that exist only in the last cell and are read by all cells."""
        return _shared_nodes(self.network)

    @cached_property
    def pins(self) -> dict[tuple[str, int], str]:
        """Inputs that replace neurons, by (neuron, stage)."""
        return {(pin.neuron, pin.stage): pin.input for pin in self.network.fixed}

    @cached_property
    def limited(self) -> tuple[Integrator, ...]:
        """Integrators with saturation limits, realised by clamps."""
        return tuple(p for p in self.parts if isinstance(p, Integrator) and p.with_limits)

    @cached_property
    def rectified(self) -> tuple[PICell, ...]:
        """Rectifying multiplier neurons, whose outputs are not driven while inactive."""
        return tuple(p for p in self.parts if isinstance(p, PICell) and p.rectified)

    @cached_property
    def diode_neurons(self) -> frozenset[str]:
        """Names of the rectifying multiplier neurons."""
        return frozenset(part.name for part in self.rectified)

    @cached_property
    def inverted(self) -> set[str]:
        """Parts with an inverter in every cell."""
        if self.differential:
            return set()
        return inverted(self.parts, self.polarity)

    def carrier(self, name: str) -> str:
        """Return the node that carries a node's voltage: itself or a plain sum's source."""
        return self.plain[name].source if name in self.plain else name

    def sign(self, name: str) -> int:
        """Return the sign with which a node is carried; an input comes with both."""
        return self.polarity.get(self.carrier(name), 1)

    def cell_of(self, name: str, stage: int) -> int:
        """Return the cell of a node read at a stage: the last cell if the node is shared."""
        return self.network.stages - 1 if name in self.shared else stage

    def alive(self, name: str, stage: int) -> bool:
        """Return True if a part is present at a stage."""
        if stage != self.cell_of(name, stage):
            return False
        part = self.by_name[name]
        present = None if isinstance(part, (Multiplier, Generator)) else part.present
        return present is None or bool(present[stage])

    def fed(self, wire: Wire, stage: int) -> bool:
        """Return True if a wire has a source at a stage; otherwise it has no resistor."""
        where = self.cell_of(wire.source, stage + wire.offset)
        if not 0 <= where < self.network.stages:
            return where < 0 and wire.source in self.network.left_boundary
        given = wire.source not in self.polarity or (wire.source, where) in self.pins
        return given or self.alive(wire.source, where)

    def alive_at(self, name: str) -> np.ndarray:
        """Return a mask (N,) of the stages at which a part is present."""
        return np.array([self.alive(name, stage) for stage in range(self.network.stages)])

    def fed_at(self, wire: Wire) -> np.ndarray:
        """Return a mask (N,) of the stages at which a wire has a source."""
        return np.array([self.fed(wire, stage) for stage in range(self.network.stages)])

    def collects(self, name: str) -> bool:
        """Return True if all cells send to a part, as to a shared integrator."""
        part = self.by_name[name]
        return isinstance(part, Integrator) and part.shared

    def reading(self, part: Part, wire: Wire) -> np.ndarray:
        """Return the sign -w p (N,) with which a part reads a source: currents then add."""
        return -np.sign(wire.weight).astype(int) * self.polarity[part.name]


def schematic_of(network: Network, *, differential: bool = False) -> Schematic:
    """Read a network as parts.

    Outputs have both signs if ``differential`` is true. Raises `NetworkError` if a neuron has
    limits that its part cannot realise, because only separate integrators have limits,
    and none in a differential circuit.
    """
    wires = wires_of(network)
    cells, inside = fused_cells(network, wires, differential=differential)
    _check_limits(network, inside, differential=differential)
    wiring, plain = wiring_of(network), plain_sums(network.cell)
    parts = (
        *cells,
        *_integrators(network, wires, inside),
        *(() if wiring is None else preconditioner_parts(wiring, network.stages)),
        *_blocks(network, wires, inside | set(plain)),
    )
    polarity = polarities(parts)
    return Schematic(
        network=network,
        parts=parts,
        polarity=dict.fromkeys(polarity, 1) if differential else polarity,
        differential=differential,
        plain=plain,
    )


def _check_limits(network: Network, fused: Container[str], *, differential: bool) -> None:
    """Raise `NetworkError` if a neuron has limits that its part cannot realise.

    Only a separate integrator has limits. A neuron merged with other nodes (``fused``), any neuron
    of a differential circuit, and a neuron that the preconditioner couples to others have none. The
    message names the neurons.
    """
    coupled = [network.cell.neurons[row].name for row in clamped_rows(network)]
    names = [n for n in limited_neurons(network) if differential or n in coupled or n in fused]
    if names:
        why = "only a separate integrator has limits, a dual neuron does not"
        if differential:
            why = "differential parts have no clamps"
        elif coupled:
            kind = network.preconditioner.kind.value
            why = (
                f"a clamp holds one integrator, and the {kind} couples {', '.join(coupled)} to "
                "others; use the circuit of SpiceBackend.prepare, whose network replaces such "
                "limits by inequalities"
            )
        raise NetworkError(
            f"circuit: saturation limits of {', '.join(names)} cannot be built: {why}"
        )


def _shared_nodes(network: Network) -> frozenset[str]:
    """Return the nodes that exist once: shared neurons and blocks of shared nodes."""
    arriving = connections_by_target(network.cell)
    found = {neuron.name for neuron in network.cell.neurons if neuron.shared}
    for block in network.cell.blocks if found else ():
        wires = arriving.get(block.name, [])
        same = all(np.ptp(np.asarray(wire.weight, float)) == 0 for wire in wires)
        read = set(arguments(block)) or {wire.source for wire in wires}
        if same and read & found and read <= found | {ONE}:
            found.add(block.name)
    return frozenset(found)


def _integrators(network: Network, wires: Wires, inside: set[str]) -> Iterator[Integrator]:
    """Yield the remaining neurons; a neuron in the preconditioner has rate one."""
    rates = rates_of(network)
    for neuron, own in zip(network.cell.neurons, network.preconditioner.reach(network.layout)):
        if neuron.name in inside:
            continue
        rate = rates[neuron.name]
        yield Integrator(
            name=OWN + neuron.name if own else neuron.name,
            wires=wires.get(neuron.name, ()),
            rate=(rate > 0).astype(float) if own else rate,
            limiter=neuron.limiter,
            shared=neuron.shared,
        )


def _blocks(network: Network, wires: Wires, inside: set[str]) -> Iterator[Part]:
    for block in network.cell.blocks:
        if block.name in inside:
            continue
        if isinstance(block, Sum):
            yield Adder(name=block.name, wires=wires.get(block.name, ()))
        elif isinstance(block, Product):
            yield Multiplier(name=block.name, a=block.a, b=block.b)
        else:
            yield Generator(name=block.name, function=block.function, x=block.x)
