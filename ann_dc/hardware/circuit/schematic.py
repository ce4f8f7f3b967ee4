r"""The parts of an analog cell: which op amps, multipliers and function generators, wired how.

A schematic is a network read as hardware, before any voltage or resistor is chosen. Three things
are different from the network's own list of nodes:

- a PI dual is one op amp: its residual sum, its integrator and its proportional path together are
  an amplifier with series R-C feedback that takes the residual's inputs at its virtual ground,
  m = mu + rho c;
- coarse coordinators need no integrators of their own. An own integrator D of every t and q sums up
  its drive, D' = d, and what the network calls z, z' = M d, is the weighted sum z = M D, with the
  metric M of time constants and hats;
- integrators and summing amplifiers invert. Each node is carried with a polarity, chosen so that
  few sources are needed with both signs; an inverter makes the other one. Multipliers have
  differential inputs, which makes products free of sign.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.coupling import OWN, coupling_of
from ann_dc.hardware.circuit.elements import (
    Adder,
    Generator,
    Integrator,
    Multiplier,
    Part,
    PICell,
    Wire,
)
from ann_dc.hardware.circuit.polarity import inverted, polarities
from ann_dc.network.cell import ONE, Function, Product, Sum
from ann_dc.network.network import Network


@dataclass(frozen=True, kw_only=True, eq=False)
class Schematic:
    """The parts of a cell, N times, and the matrix of the coordinators.

    Attributes
    ----------
    network : Network
    parts : tuple of Part
    polarity : dict of node name to +1 or -1
        Sign with which the output of a part carries its node. Inputs come with both signs.
    coupling : (C * 2N, C * 2N) array or None
        z = coupling D over the positions q_0, t_0, q_1, ... of all chains, chain by chain; None
        without coordinators. D are the integrators ``own.<neuron>``.
    differential : bool
        Every output is there with both signs, so that no inverter is needed.
    """

    network: Network
    parts: tuple[Part, ...]
    polarity: dict[str, int]
    coupling: np.ndarray | None = None
    differential: bool = False
    by_name: dict[str, Part] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "by_name", {part.name: part for part in self.parts})

    def count(self, kind: type) -> int:
        """Number of parts of a kind, over all cells."""
        return sum(isinstance(part, kind) for part in self.parts) * self.network.stages

    @cached_property
    def pins(self) -> dict[tuple[str, int], str]:
        """Inputs that replace neurons, by (neuron, stage)."""
        return {(pin.neuron, pin.stage): pin.input for pin in self.network.pins}

    @cached_property
    def inverted(self) -> set[str]:
        """Parts with an inverter in every cell."""
        if self.differential:
            return set()
        return inverted(self.parts, self.polarity, self.coupling, self.network.cell.chains)

    @cached_property
    def alias(self) -> dict[str, str]:
        """Names that a netlist can carry, of every part, neuron and input.

        Lower case, unique, without a double underscore.

        Raises
        ------
        NetworkError
            If a name has unprintable letters or is too long.
        """
        return _aliases([*self.polarity, *self.network.cell.inputs, ONE])

    def alive(self, name: str, stage: int) -> bool:
        """Whether a part is there at a stage."""
        part = self.by_name.get(name)
        if isinstance(part, (Integrator, PICell)):
            return bool(part.rate[stage] > 0)
        if part is None:  # the adder of a t or q under coordinators
            return self.alive(OWN + name, stage)
        return True

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

    Raises
    ------
    NetworkError
        If a neuron has rails, which these parts do not have.
    """
    limited = [
        n.name for n in network.cell.neurons if np.isfinite([n.limiter.low, n.limiter.high]).any()
    ]
    if limited:
        raise NetworkError(
            f"circuit: rails of {', '.join(limited)} are not built yet; leave them out"
        )
    arriving: dict[str, list[Wire]] = {}
    for c in network.cell.connections:
        weight = np.broadcast_to(np.asarray(c.weight, float), network.stages)
        wire = Wire(source=c.source, offset=int(c.template), weight=weight)
        arriving.setdefault(c.target, []).append(wire)
    wires = {name: tuple(found) for name, found in arriving.items()}
    fused = _fused(network, wires)
    inside = {name for dual in fused for name in (dual.neuron, dual.residual, dual.multiplier)}
    rates = dict(zip((n.name for n in network.cell.neurons), evaluator(network).tape.rates))
    chained = {name for chain in network.cell.chains for name in chain}
    coupled = network.coordinators is not None
    parts: list[Part] = []
    for dual in fused:
        gain = wires[dual.neuron][0].weight
        rho = next(w.weight for w in wires[dual.multiplier] if w.source == dual.residual)
        parts.append(
            PICell(
                name=dual.multiplier,
                dual=dual.neuron,
                wires=wires.get(dual.residual, ()),
                rate=rates[dual.neuron] * gain,
                rho=rho,
            )
        )
    for neuron in network.cell.neurons:
        if neuron.name in inside:
            continue
        own = coupled and neuron.name in chained
        rate = (rates[neuron.name] > 0).astype(float) if own else rates[neuron.name]
        name = OWN + neuron.name if own else neuron.name
        parts.append(Integrator(name=name, wires=wires.get(neuron.name, ()), rate=rate))
    for block in network.cell.blocks:
        if block.name in inside:
            continue
        if isinstance(block, Sum):
            parts.append(Adder(name=block.name, wires=wires.get(block.name, ())))
        elif isinstance(block, Product):
            parts.append(Multiplier(name=block.name, a=block.a, b=block.b))
        else:
            parts.append(Generator(name=block.name, function=block.function, x=block.x))
    coupling = coupling_of(network)
    polarity = polarities(parts, coupling, network.cell.chains)
    return Schematic(
        network=network,
        parts=tuple(parts),
        polarity=dict.fromkeys(polarity, 1) if differential else polarity,
        coupling=coupling,
        differential=differential,
    )


def _fused(network: Network, wires: dict[str, tuple[Wire, ...]]):
    """PI duals that one op amp can be: c is read by mu and m only, mu by m only."""
    readers: Counter[str] = Counter(w.source for found in wires.values() for w in found)
    for block in network.cell.blocks:
        if isinstance(block, Product):
            readers.update((block.a, block.b))
        elif isinstance(block, Function):
            readers.update((block.x,))
    fused = []
    for dual in network.cell.duals:
        into_mu, into_m = wires.get(dual.neuron, ()), wires.get(dual.multiplier, ())
        local = all(w.offset == 0 for w in (*into_mu, *into_m))
        simple = (
            [w.source for w in into_mu] == [dual.residual]
            and {w.source for w in into_m} == {dual.neuron, dual.residual}
            and all((w.weight == 1).all() for w in into_m if w.source == dual.neuron)
            and all((w.weight > 0).all() for w in into_m)
            and (into_mu[0].weight > 0).all()
        )
        if local and simple and readers[dual.residual] == 2 and readers[dual.neuron] == 1:
            fused.append(dual)
    return fused


RESERVED = ("src", "gnd", "null", "rst", "p1", "p2", "s", "sp", "sn")
"""Names that a netlist needs for itself."""


def _aliases(names: list[str]) -> dict[str, str]:
    aliases: dict[str, str] = {}
    taken = set(RESERVED)
    for name in names:
        if not name.isprintable() or len(name) > 200:
            raise NetworkError(f"circuit: {name!r} is no name that a netlist can carry")
        plain = re.sub(r"[^a-z0-9]+", "_", name.lower().replace("*", "_x_")).strip("_") or "node"
        plain = plain[:40].strip("_") if plain[0].isalpha() else f"n_{plain[:40]}".strip("_")
        alias, number = plain, 2
        while not taken.isdisjoint({alias, f"n_{alias}"}):  # vos_n_x is that of x's inverter
            alias, number = f"{plain}_v{number}", number + 1
        taken |= {alias, f"n_{alias}"}
        aliases[name] = alias
    return aliases
