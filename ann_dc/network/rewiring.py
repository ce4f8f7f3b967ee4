"""Modification of wires and parts of a network, the basis of non-idealities.

Every function returns a new network with one difference, at some stages (``present``, (N,)
booleans) or at all stages. A network without a difference is returned unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ann_dc.network.cell import ONE, Block, Connection, Function, Limiter, Neuron, Sum
from ann_dc.network.ends import Omitted
from ann_dc.network.network import Network
from ann_dc.scale import Scale

DRIVE = "drive"
"""Prefix of the sum that collects the wires of a neuron with a slew rate."""


def _tidy(weight) -> float | np.ndarray:
    """Return one number if all stages have equal weights."""
    weight = np.asarray(weight, float)
    return float(weight.flat[0]) if (weight == weight.flat[0]).all() else weight


def wire(source: str, target: str, weight: float | np.ndarray = 1.0) -> Connection:
    """Return a connection within the cell."""
    return Connection(source=source, target=target, weight=_tidy(weight))


def with_wires(network: Network, wires: list[Connection]) -> Network:
    """Return the network with more wires; weights of parallel connections are added."""
    together = {c.name: c for c in network.cell.connections}
    wires = [new for new in wires if np.any(new.weight)]
    for new in wires:
        double = together.get(new.name)
        weight = new.weight if double is None else np.add(double.weight, new.weight)
        together[new.name] = replace(new, weight=_tidy(weight))
    cell = replace(network.cell, connections=tuple(together.values()))
    return replace(network, cell=cell) if wires else network


def reweighed(network: Network, names: list[str], present: np.ndarray, weight_of) -> Network:
    """Return the network with other weights of named connections at some stages.

    ``weight_of`` gives the new weights of a connection, (N,) or one for all stages. The network is
    returned unchanged if the weights are equal.
    """
    before, affected = network.cell.connections, set(names)

    def other(c: Connection) -> Connection:
        return replace(c, weight=_tidy(np.where(present, weight_of(c), c.weight)))

    after = tuple(other(c) if c.name in affected else c for c in before)
    if all((np.asarray(a.weight) == b.weight).all() for a, b in zip(after, before)):
        return network
    return replace(network, cell=replace(network.cell, connections=after))


def retimed(network: Network, names: list[str], present: np.ndarray, tau_of) -> Network:
    """Return the network with other time constants of named neurons at some stages.

    ``tau_of`` gives the new time constants of a neuron, (N,) or one for all stages. The network is
    returned unchanged if the time constants are equal.
    """
    before, affected = network.cell.neurons, set(names)

    def other(n: Neuron) -> Neuron:
        return replace(n, tau=_tidy(np.where(present, tau_of(n), n.tau)))

    after = tuple(other(n) if n.name in affected else n for n in before)
    if all((np.asarray(a.tau) == b.tau).all() for a, b in zip(after, before)):
        return network
    return replace(network, cell=replace(network.cell, neurons=after))


def arrival(network: Network, node: str) -> str:
    """Return the target of a node's wires: the node, or the sum added by `slewing`."""
    drive = f"{DRIVE}.{node}"
    return drive if any(block.name == drive for block in network.cell.blocks) else node


def conductance(network: Network, target: str, fused: str, scale: Mapping[str, float]):
    """Return sum |w| S over the wires of a node.

    A wire from the fused sum, which has no op amp (or ""), is replaced by the wires of that sum.
    ``scale`` is the full scale S by source, 1 by default.
    """
    total: float | np.ndarray = 0.0
    for c in network.cell.connections:
        if c.target == target:
            own = c.source != fused
            behind = scale.get(c.source, 1.0) if own else conductance(network, fused, "", scale)
            total = total + np.abs(c.weight) * behind
    return total


def fresh(network: Network, prefix: str, node: str) -> str:
    """Return the name ``prefix.node`` for a new node, numbered if the name is taken."""
    cell = network.cell
    taken = {n.name.lower() for n in (*cell.neurons, *cell.blocks)} | set(
        map(str.lower, cell.inputs)
    )
    name, number = f"{prefix}.{node}", 2
    while name.lower() in taken:
        name, number = f"{prefix}.{node}.{number}", number + 1
    return name


def _with_block(network: Network, block: Block, after: str) -> Network:
    """Return the network with a block placed after its source, or first for a neuron."""
    names = [b.name for b in network.cell.blocks]
    place = names.index(after) + 1 if after in names else 0
    blocks = (*network.cell.blocks[:place], block, *network.cell.blocks[place:])
    return replace(network, cell=replace(network.cell, blocks=blocks))


def _blocks_reading(network: Network, new: str, old: str) -> Network:
    """Return the network whose products and functions read ``new`` instead of ``old``."""
    blocks = tuple(
        replace(b, **{field: new for field in ("a", "b", "x") if getattr(b, field, "") == old})
        for b in network.cell.blocks
    )
    return replace(network, cell=replace(network.cell, blocks=blocks))


def _all_reading(network: Network, new: str, old: str) -> Network:
    """Return the network whose readers of ``old`` read ``new``, at the left end too."""
    cell = _blocks_reading(network, new, old).cell
    wires = tuple(replace(c, source=new) if c.source == old else c for c in cell.connections)
    duals = tuple(replace(d, residual=new) if d.residual == old else d for d in cell.duals)
    diodes = tuple(
        replace(d, residual=new) if d.residual == old else d for d in cell.inequality_duals
    )
    objectives = tuple(
        replace(o, residual=new) if o.residual == old else o for o in cell.objectives
    )
    left = {new: network.left_boundary[old]} if old in network.left_boundary else {}
    cell = replace(
        cell, connections=wires, duals=duals, inequality_duals=diodes, objectives=objectives
    )
    return replace(network, cell=cell, left_boundary={**network.left_boundary, **left})


def slowed(network: Network, name: str, tau: float, present: np.ndarray, start) -> Network:
    """Return the network with a pole after a neuron or block, at some stages.

    ``tau`` is the time constant of the pole in units of network time; ``start`` (N,) is the initial
    state of the new neuron.
    """
    slow = fresh(network, "slow", name)
    seen = slow if present.all() else fresh(network, "seen", name)
    scale = network.neuron(name).scale if name in network.neuron_index else Scale()
    neurons = (*network.cell.neurons, Neuron(name=slow, tau=tau, scale=scale))
    absent = {a.stage for a in network.omitted if a.neuron == name} | set(np.flatnonzero(~present))
    pins = [pin for pin in network.fixed if pin.neuron == name and present[pin.stage]]
    network = replace(
        network,
        cell=replace(network.cell, neurons=neurons),
        fixed=(*network.fixed, *(replace(pin, neuron=slow) for pin in pins)),
        omitted=(*network.omitted, *(Omitted(neuron=slow, stage=int(k)) for k in sorted(absent))),
        start={**network.start, slow: start},
    )
    wires = [wire(name, slow), wire(slow, slow, -1.0)]
    if seen != slow:
        network = _with_block(network, Sum(name=seen), after=name)
        wires += [wire(slow, seen), wire(name, seen, ~present)]
    return with_wires(_all_reading(network, seen, name), wires)


def amplified(network: Network, name: str, gain: np.ndarray) -> Network:
    """Return the network with a gain (N,) after a block."""
    connections = tuple(
        replace(c, weight=_tidy(c.weight * _read(gain, c.template))) if c.source == name else c
        for c in network.cell.connections
    )
    network = replace(network, cell=replace(network.cell, connections=connections))
    if not any(
        name in (getattr(b, field, "") for field in ("a", "b", "x")) for b in network.cell.blocks
    ):
        return network
    amplified = fresh(network, "gain", name)
    network = _with_block(network, Sum(name=amplified), after=name)
    return with_wires(_blocks_reading(network, amplified, name), [wire(name, amplified, gain)])


def _read(gain: np.ndarray, template: int) -> np.ndarray:
    """Return the gains (N,) at a connection's sources; one beyond the ends."""
    place = np.arange(len(gain)) + template
    inside = (place >= 0) & (place < len(gain))
    return np.where(inside, gain[np.clip(place, 0, len(gain) - 1)], 1.0)


def stopped(neuron: Neuron, limit: float) -> Neuron:
    """Return a neuron limited to plus and minus ``limit``, or to its closer limits."""
    low, high = max(neuron.limiter.low, -limit), min(neuron.limiter.high, limit)
    return replace(neuron, limiter=Limiter(low=low, high=high))


def slewing(network: Network, name: str, largest: np.ndarray, present: np.ndarray) -> Network:
    """Return the network with a neuron's net input clipped to +-``largest``.

    ``largest`` is a number or (N,); the clipping applies at the stages ``present``.
    """
    drive, cell = fresh(network, DRIVE, name), network.cell
    arriving = tuple(replace(c, target=drive) if c.target == name else c for c in cell.connections)
    blocks: list[Block] = [*cell.blocks, Sum(name=drive)]
    wires = [wire(ONE, name, -largest * present), wire(drive, name, ~present)]
    for sign in (1.0, -1.0):
        shifted, beyond = (
            fresh(network, f"{part}{sign:+.0f}", name) for part in ("slew", "rectify")
        )
        blocks += [Sum(name=shifted), Function(name=beyond, function="rectify", x=shifted)]
        wires += [wire(drive, shifted, 1 / largest), wire(ONE, shifted, sign)]
        wires.append(wire(beyond, name, sign * largest * present))
    cell = replace(cell, connections=arriving, blocks=tuple(blocks))
    return with_wires(replace(network, cell=cell), wires)
