"""Other wires and other parts in a network: what defects are made of.

Every function gives a new network in which one thing is different, at some stages (``present``,
(N,) booleans) or at all of them; a network in which nothing would differ comes back as it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ann_dc.network.cell import ONE, Block, Connection, Function, Limiter, Neuron, Sum
from ann_dc.network.ends import Absent
from ann_dc.network.network import Network
from ann_dc.scale import Scale

DRIVE = "drive"
"""Prefix of the sum at which the wires of a neuron arrive that has a slew rate."""


def _tidy(weight) -> float | np.ndarray:
    """One number where all stages have the same."""
    weight = np.asarray(weight, float)
    return float(weight.flat[0]) if (weight == weight.flat[0]).all() else weight


def wire(source: str, target: str, weight: float | np.ndarray = 1.0) -> Connection:
    """A connection within the cell."""
    return Connection(source=source, target=target, weight=_tidy(weight))


def with_wires(network: Network, wires: list[Connection]) -> Network:
    """More wires; one that is there already adds to the weight of its double."""
    together = {c.name: c for c in network.cell.connections}
    wires = [new for new in wires if np.any(new.weight)]
    for new in wires:
        double = together.get(new.name)
        weight = new.weight if double is None else np.add(double.weight, new.weight)
        together[new.name] = replace(new, weight=_tidy(weight))
    cell = replace(network.cell, connections=tuple(together.values()))
    return replace(network, cell=cell) if wires else network


def reweighed(network: Network, names: list[str], present: np.ndarray, weight_of) -> Network:
    """Other weights of some connections at some stages; the same network if they are the same.

    Parameters
    ----------
    network : Network
    names : list of str
        Of connections.
    present : (N,) array of bool
        At which stages.
    weight_of : callable
        Of a connection; it gives the new weights, (N,) or one for all.

    Returns
    -------
    Network
    """
    before, affected = network.cell.connections, set(names)

    def other(c: Connection) -> Connection:
        return replace(c, weight=_tidy(np.where(present, weight_of(c), c.weight)))

    after = tuple(other(c) if c.name in affected else c for c in before)
    if all((np.asarray(a.weight) == b.weight).all() for a, b in zip(after, before)):
        return network
    return replace(network, cell=replace(network.cell, connections=after))


def retimed(network: Network, names: list[str], present: np.ndarray, tau_of) -> Network:
    """Other time constants of some neurons at some stages; the same network if they are the same.

    Parameters
    ----------
    network : Network
    names : list of str
        Of neurons.
    present : (N,) array of bool
        At which stages.
    tau_of : callable
        Of a neuron; it gives the new time constants, (N,) or one for all.

    Returns
    -------
    Network
    """
    before, affected = network.cell.neurons, set(names)

    def other(n: Neuron) -> Neuron:
        return replace(n, tau=_tidy(np.where(present, tau_of(n), n.tau)))

    after = tuple(other(n) if n.name in affected else n for n in before)
    if all((np.asarray(a.tau) == b.tau).all() for a, b in zip(after, before)):
        return network
    return replace(network, cell=replace(network.cell, neurons=after))


def arrival(network: Network, node: str) -> str:
    """Where the wires of a node arrive: at itself, or at the sum that `slew` has put before it."""
    drive = f"{DRIVE}.{node}"
    return drive if any(block.name == drive for block in network.cell.blocks) else node


def conductance(network: Network, target: str, fused: str, scale: Mapping[str, float]):
    """sum |w| S of a node's wires; in place of the one from a fused sum, those of that sum.

    Parameters
    ----------
    network : Network
    target : str
        The node.
    fused : str
        A sum that is no op amp of its own, or "".
    scale : mapping of node name to float
        Full scale S of a source, 1 where none is given.
    """
    total: float | np.ndarray = 0.0
    for c in network.cell.connections:
        if c.target == target:
            own = c.source != fused
            behind = scale.get(c.source, 1.0) if own else conductance(network, fused, "", scale)
            total = total + np.abs(c.weight) * behind
    return total


def fresh(network: Network, prefix: str, node: str) -> str:
    """The name ``prefix.node`` for a new node, numbered where it is taken."""
    cell = network.cell
    taken = {n.name.lower() for n in (*cell.neurons, *cell.blocks)} | set(
        map(str.lower, cell.inputs)
    )
    name, number = f"{prefix}.{node}", 2
    while name.lower() in taken:
        name, number = f"{prefix}.{node}.{number}", number + 1
    return name


def _with_block(network: Network, block: Block, after: str) -> Network:
    """One more block, behind the one that it reads; before all of them if that is a neuron."""
    names = [b.name for b in network.cell.blocks]
    place = names.index(after) + 1 if after in names else 0
    blocks = (*network.cell.blocks[:place], block, *network.cell.blocks[place:])
    return replace(network, cell=replace(network.cell, blocks=blocks))


def _blocks_reading(network: Network, new: str, old: str) -> Network:
    """Products and functions that read another node in place of the old one."""
    blocks = tuple(
        replace(b, **{field: new for field in ("a", "b", "x") if getattr(b, field, "") == old})
        for b in network.cell.blocks
    )
    return replace(network, cell=replace(network.cell, blocks=blocks))


def _all_reading(network: Network, new: str, old: str) -> Network:
    """Everything that reads another node in place of the old one, at the left end too."""
    cell = _blocks_reading(network, new, old).cell
    wires = tuple(replace(c, source=new) if c.source == old else c for c in cell.connections)
    duals = tuple(replace(d, residual=new) if d.residual == old else d for d in cell.duals)
    diodes = tuple(replace(d, residual=new) if d.residual == old else d for d in cell.diodes)
    objectives = tuple(
        replace(o, residual=new) if o.residual == old else o for o in cell.objectives
    )
    left = {new: network.left[old]} if old in network.left else {}
    cell = replace(cell, connections=wires, duals=duals, diodes=diodes, objectives=objectives)
    return replace(network, cell=cell, left={**network.left, **left})


def slowed(network: Network, name: str, tau: float, present: np.ndarray, start) -> Network:
    """A pole behind a node, at some stages.

    Parameters
    ----------
    network : Network
    name : str
        A neuron or a block.
    tau : float
        Time constant of the pole, in units of network time.
    present : (N,) array of bool
        At which stages.
    start : (N,) array
        Where the new neuron starts.

    Returns
    -------
    Network
    """
    slow = fresh(network, "slow", name)
    seen = slow if present.all() else fresh(network, "seen", name)
    scale = network.neuron(name).scale if name in network.neuron_index else Scale()
    neurons = (*network.cell.neurons, Neuron(name=slow, tau=tau, scale=scale))
    absent = {a.stage for a in network.absent if a.neuron == name} | set(np.flatnonzero(~present))
    pins = [pin for pin in network.pins if pin.neuron == name and present[pin.stage]]
    network = replace(
        network,
        cell=replace(network.cell, neurons=neurons),
        pins=(*network.pins, *(replace(pin, neuron=slow) for pin in pins)),
        absent=(*network.absent, *(Absent(neuron=slow, stage=int(k)) for k in sorted(absent))),
        start={**network.start, slow: start},
    )
    wires = [wire(name, slow), wire(slow, slow, -1.0)]
    if seen != slow:
        network = _with_block(network, Sum(name=seen), after=name)
        wires += [wire(slow, seen), wire(name, seen, ~present)]
    return with_wires(_all_reading(network, seen, name), wires)


def amplified(network: Network, name: str, gain: np.ndarray) -> Network:
    """A gain (N,) behind a block.

    Parameters
    ----------
    network : Network
    name : str
        Of the block.
    gain : (N,) array

    Returns
    -------
    Network
    """
    connections = tuple(
        replace(c, weight=_tidy(c.weight * _read(gain, c.template))) if c.source == name else c
        for c in network.cell.connections
    )
    network = replace(network, cell=replace(network.cell, connections=connections))
    if not any(
        name in (getattr(b, field, "") for field in ("a", "b", "x")) for b in network.cell.blocks
    ):
        return network
    louder = fresh(network, "gain", name)
    network = _with_block(network, Sum(name=louder), after=name)
    return with_wires(_blocks_reading(network, louder, name), [wire(name, louder, gain)])


def _read(gain: np.ndarray, template: int) -> np.ndarray:
    """Gains (N,) of what a connection reads; one beyond the ends, where there is no block."""
    place = np.arange(len(gain)) + template
    inside = (place >= 0) & (place < len(gain))
    return np.where(inside, gain[np.clip(place, 0, len(gain) - 1)], 1.0)


def stopped(neuron: Neuron, limit: float) -> Neuron:
    """A neuron with rails at plus and minus ``limit``, or those that it has if they are closer."""
    low, high = max(neuron.limiter.low, -limit), min(neuron.limiter.high, limit)
    return replace(neuron, limiter=Limiter(low=low, high=high))


def slewing(network: Network, name: str, largest: np.ndarray, present: np.ndarray) -> Network:
    """A neuron whose drive is clipped at plus and minus ``largest``, at some stages.

    Parameters
    ----------
    network : Network
    name : str
        Of the neuron.
    largest : (N,) array or float
        Of the drive.
    present : (N,) array of bool
        At which stages.

    Returns
    -------
    Network
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
