r"""The parts of an analog cell: which op amps, multipliers and function generators, wired how.

A schematic is a network read as hardware, before any voltage or resistor is chosen. Three things
are different from the network's own list of nodes:

- a PI dual is one op amp: its residual sum, its integrator and its proportional path together are
  an amplifier with series R-C feedback that takes the residual's inputs at its virtual ground,
  m = mu + rho c; two diodes around it make it a diode neuron, m = max(0, mu + rho c), whose
  capacitor discharges through the resistor where the output is zero;
- a metric beyond time constants needs no integrators of its own. An own integrator D of every
  neuron that it reaches sums up its drive, D' = d, and what the network calls z, z' = M d, is the
  weighted sum z = M D, in as many layers of adders as the metric's kind has (`metric_wiring`);
- integrators and summing amplifiers invert. Each node is carried with a polarity, chosen so that
  few sources are needed with both signs; an inverter makes the other one. Multipliers have
  differential inputs, which makes products free of sign.

A sum that only multiplies a node is no part at all (`plain_sums`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.elements import (
    Adder,
    Generator,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
    Wire,
)
from ann_dc.hardware.schematic.metric_parts import metric_parts
from ann_dc.hardware.schematic.metric_wiring import OWN, wiring_of
from ann_dc.hardware.schematic.plain_sums import plain_sums
from ann_dc.hardware.schematic.polarity import inverted, polarities
from ann_dc.hardware.schematic.rails import check_parts, check_shared
from ann_dc.network.cell import Function, Product, Sum
from ann_dc.network.duals import DiodeDual, PIDual
from ann_dc.network.network import Network


@dataclass(frozen=True, kw_only=True, eq=False)
class Schematic:
    """The parts of a cell, N times.

    Attributes
    ----------
    network : Network
        What was read.
    parts : tuple of Part
        Of one cell; all cells have the same, except for the ends and the nodes of a metric.
    polarity : dict of node name to +1 or -1
        Sign with which the output of a part carries its node. Inputs come with both signs.
    differential : bool
        Every output is there with both signs, so that no inverter is needed.
    plain : mapping of node name to Wire
        Sums that are no part, and the nodes whose voltages carry them.
    """

    network: Network
    parts: tuple[Part, ...]
    polarity: dict[str, int]
    differential: bool = False
    plain: Mapping[str, Wire] = field(default_factory=dict)

    @cached_property
    def by_name(self) -> dict[str, Part]:
        """The parts, by the name of their node."""
        return {part.name: part for part in self.parts}

    def count(self, kind: type) -> int:
        """Number of parts of a kind, over all cells that have one or its pin."""
        stages = self.network.stages
        return sum(
            stages if present is None else int(present.sum())
            for part in self.parts
            if isinstance(part, kind)
            for present in [part.present if isinstance(part, (Adder, GridNode)) else None]
        )

    @cached_property
    def pins(self) -> dict[tuple[str, int], str]:
        """Inputs that replace neurons, by (neuron, stage)."""
        return {(pin.neuron, pin.stage): pin.input for pin in self.network.pins}

    @cached_property
    def inverted(self) -> set[str]:
        """Parts with an inverter in every cell."""
        if self.differential:
            return set()
        return inverted(self.parts, self.polarity)

    def carrier(self, name: str) -> str:
        """The node whose voltage carries a node: itself, or what a plain sum multiplies."""
        return self.plain[name].source if name in self.plain else name

    def sign(self, name: str) -> int:
        """Sign with which a node is carried; an input comes with both."""
        return self.polarity.get(self.carrier(name), 1)

    def alive(self, name: str, stage: int) -> bool:
        """Whether a part is there at a stage."""
        part = self.by_name[name]
        present = None if isinstance(part, (Multiplier, Generator)) else part.present
        return present is None or bool(present[stage])

    def fed(self, wire: Wire, stage: int) -> bool:
        """Whether a wire has a source at a stage; where it has none, its resistor is left out."""
        where = stage + wire.offset
        if not 0 <= where < self.network.stages:
            return where < 0 and wire.source in self.network.left
        given = wire.source not in self.polarity or (wire.source, where) in self.pins
        return given or self.alive(wire.source, where)

    def alive_at(self, name: str) -> np.ndarray:
        """(N,) booleans: at which stages a part is there."""
        return np.array([self.alive(name, stage) for stage in range(self.network.stages)])

    def fed_at(self, wire: Wire) -> np.ndarray:
        """(N,) booleans: at which stages a wire has a source."""
        return np.array([self.fed(wire, stage) for stage in range(self.network.stages)])

    def reading(self, part: Part, wire: Wire) -> np.ndarray:
        """Sign (N,) with which an inverting part reads a source: -w p, so that currents add."""
        return -np.sign(wire.weight).astype(int) * self.polarity[part.name]


def schematic_of(network: Network, *, differential: bool = False) -> Schematic:
    """Read a network as parts.

    Parameters
    ----------
    network : Network
    differential : bool
        Whether outputs come with both signs.

    Returns
    -------
    Schematic

    Raises
    ------
    NetworkError
        If a neuron has rails that these parts do not have: only integrators of their own neurons
        have some, and none in a differential circuit. Or if all cells share one, since a circuit's
        cells talk to their neighbours.

    Examples
    --------
    Constraints become PI cells, states and controls integrators:

    >>> from ann_dc import plants, synthesize
    >>> schematic = schematic_of(synthesize(plants.double_integrator(N=5)))
    >>> schematic.count(PICell), schematic.count(Integrator), schematic.count(Multiplier)
    (20, 25, 0)
    """
    check_shared(network)
    wires = _arriving(network)
    fused = _fused(network, wires)
    diodes = [] if differential else _fused_diodes(network, wires)
    inside = _inside(fused) | {n for d in diodes for n in (d.neuron, *d.nodes)}
    check_parts(network, inside, differential=differential)
    wiring, plain = wiring_of(network), plain_sums(network.cell)
    parts = (
        *_pi_cells(network, wires, fused),
        *_diode_cells(network, wires, diodes),
        *_integrators(network, wires, inside),
        *(() if wiring is None else metric_parts(wiring, network.stages)),
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


Wires: TypeAlias = Mapping[str, tuple[Wire, ...]]
"""What arrives at a node, by its name."""


def _arriving(network: Network) -> Wires:
    arriving: dict[str, list[Wire]] = {}
    for c in network.cell.connections:
        weight = np.broadcast_to(np.asarray(c.weight, float), network.stages)
        wire = Wire(source=c.source, offset=int(c.template), weight=weight)
        arriving.setdefault(c.target, []).append(wire)
    return {name: tuple(found) for name, found in arriving.items()}


def _fused(network: Network, wires: Wires) -> list[PIDual]:
    """PI duals that one op amp can be: c is read by mu and m only, mu by m only."""
    readers = _readers(network, wires)
    return [
        dual
        for dual in network.cell.duals
        if readers[dual.residual] == 2
        and readers[dual.neuron] == 1
        and _is_proportional_integral(dual, wires)
    ]


def _fused_diodes(network: Network, wires: Wires) -> list[DiodeDual]:
    """Diode neurons that one op amp can be: z + w g is read by the rectifier only, z by its own."""
    readers, found = _readers(network, wires), []
    for diode in network.cell.diodes:
        own = sum(w.source == diode.neuron for w in wires.get(diode.residual, ()))
        read = readers[diode.residual], readers[diode.sum], readers[diode.neuron] - own
        if read == (1, 1, 2) and _is_rectified(diode, wires) and _leaks_little(diode, wires):
            found.append(diode)
    return found


def _weight(wires: Wires, source: str, target: str) -> np.ndarray | float:
    """Of what arrives at a node from another one of its cell."""
    found = [w.weight for w in wires.get(target, ()) if w.source == source and not w.offset]
    return np.sum(found, axis=0) if found else 0.0


def _leaks_little(diode: DiodeDual, wires: Wires) -> bool:
    """Whether g reads z as -d z at most, with 0 <= w d < 1: then it may read m instead."""
    d = -_weight(wires, diode.neuron, diode.residual)
    w = _weight(wires, diode.residual, diode.sum)
    return bool(np.all((d >= 0) & (w * d < 1)))


def _readers(network: Network, wires: Wires) -> Counter[str]:
    """How often every node is read."""
    readers: Counter[str] = Counter(w.source for found in wires.values() for w in found)
    for block in network.cell.blocks:
        if isinstance(block, Product):
            readers.update((block.a, block.b))
        elif isinstance(block, Function):
            readers.update((block.x,))
    return readers


def _is_rectified(diode: DiodeDual, wires: Wires) -> bool:
    """Whether z' is a positive share of m - z and m that of z + w g with w > 0, in one cell."""
    into_z = {w.source: w for w in wires.get(diode.neuron, ())}
    into_sum = {w.source: w for w in wires.get(diode.sum, ())}
    if set(into_z) != {diode.multiplier, diode.neuron}:
        return False
    if set(into_sum) != {diode.neuron, diode.residual}:
        return False
    pull, leak = into_z[diode.multiplier].weight, into_z[diode.neuron].weight
    one, w = into_sum[diode.neuron].weight, into_sum[diode.residual].weight
    own_cell = all(wire.offset == 0 for wire in (*into_z.values(), *into_sum.values()))
    return own_cell and bool(((pull > 0) & (leak == -pull) & (one == 1) & (w > 0)).all())


def _is_proportional_integral(dual: PIDual, wires: Wires) -> bool:
    """Whether mu' is a positive share of c and m = mu + rho c with rho > 0, in the same cell."""
    into_mu, into_m = wires.get(dual.neuron, ()), wires.get(dual.multiplier, ())
    return (
        [w.source for w in into_mu] == [dual.residual]
        and {w.source for w in into_m} == {dual.neuron, dual.residual}
        and all(w.offset == 0 and (w.weight > 0).all() for w in (*into_mu, *into_m))
        and all((w.weight == 1).all() for w in into_m if w.source == dual.neuron)
    )


def _inside(fused: Iterable[PIDual]) -> set[str]:
    """Nodes that have no part of their own."""
    return {name for dual in fused for name in (dual.neuron, dual.residual, dual.multiplier)}


def _rates(network: Network) -> dict[str, np.ndarray]:
    """1 / tau (N,) of every neuron, zero where it is pinned or absent."""
    return dict(zip((n.name for n in network.cell.neurons), evaluator(network).tape.rates))


def _pi_cells(network: Network, wires: Wires, fused: Iterable[PIDual]) -> Iterator[PICell]:
    rates = _rates(network)
    for dual in fused:
        gain = wires[dual.neuron][0].weight
        yield PICell(
            name=dual.multiplier,
            dual=dual.neuron,
            wires=wires.get(dual.residual, ()),
            rate=rates[dual.neuron] * gain,
            rho=next(w.weight for w in wires[dual.multiplier] if w.source == dual.residual),
        )


def _diode_cells(network: Network, wires: Wires, diodes: Iterable[DiodeDual]) -> Iterator[PICell]:
    rates = _rates(network)
    for diode in diodes:
        w = next(wire.weight for wire in wires[diode.sum] if wire.source == diode.residual)
        pull = next(wire.weight for wire in wires[diode.neuron] if wire.weight.max() > 0)
        # m = z + w (g - d z), z' = (g - d z) / tau: m = z + rho (g - d m), z' = rate (g - d m)
        own, rest = wires.get(diode.residual, ()), 1.0
        if any(wire.source == diode.neuron for wire in own):
            rest = 1.0 + w * _weight(wires, diode.neuron, diode.residual)
            own = tuple(
                replace(wire, source=diode.multiplier) if wire.source == diode.neuron else wire
                for wire in own
            )
        yield PICell(
            name=diode.multiplier,
            dual=diode.neuron,
            wires=own,
            rate=rates[diode.neuron] * pull * w / rest,
            rho=w / rest,
            rectified=True,
        )


def _integrators(network: Network, wires: Wires, inside: set[str]) -> Iterator[Integrator]:
    """All other neurons; one that a metric reaches has an own integrator of rate one."""
    rates = _rates(network)
    for neuron, own in zip(network.cell.neurons, network.metric.reach(network.row)):
        if neuron.name in inside:
            continue
        rate = rates[neuron.name]
        yield Integrator(
            name=OWN + neuron.name if own else neuron.name,
            wires=wires.get(neuron.name, ()),
            rate=(rate > 0).astype(float) if own else rate,
            limiter=neuron.limiter,
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
