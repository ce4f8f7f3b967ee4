"""What one op amp is: the nodes of a PI dual, a diode neuron or an objective, fused to a PI cell.

A residual sum, an integrator and a proportional path together are an amplifier with series R-C
feedback, as long as nothing else reads what is inside.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.elements import PICell, Wire
from ann_dc.network.cell import Function, Product
from ann_dc.network.duals import DiodeDual, ObjectiveDual, PIDual
from ann_dc.network.network import Network

Wires: TypeAlias = Mapping[str, tuple[Wire, ...]]
"""What arrives at a node, by its name."""

Rectified: TypeAlias = DiodeDual | ObjectiveDual
"""What becomes a PI cell with diodes."""


def wires_of(network: Network) -> Wires:
    """What arrives at every node of a cell."""
    arriving: dict[str, list[Wire]] = {}
    for c in network.cell.connections:
        weight = np.broadcast_to(np.asarray(c.weight, float), network.stages)
        wire = Wire(source=c.source, offset=int(c.template), weight=weight)
        arriving.setdefault(c.target, []).append(wire)
    return {name: tuple(found) for name, found in arriving.items()}


def rates_of(network: Network) -> dict[str, np.ndarray]:
    """1 / tau (N,) of every neuron, zero where it is pinned or absent."""
    return dict(zip((n.name for n in network.cell.neurons), evaluator(network).tape.rates))


def fused_cells(
    network: Network, wires: Wires, *, differential: bool
) -> tuple[list[PICell], set[str]]:
    """PI cells, and the nodes that are inside of them.

    Parameters
    ----------
    network : Network
    wires : mapping of node name to tuple of Wire
        From `wires_of`.
    differential : bool
        Whether outputs come with both signs; then nothing is rectified.

    Returns
    -------
    cells : list of PICell
    inside : set of str
        Neurons and blocks that have no part of their own.
    """
    readers, rates = _readers(network, wires), rates_of(network)
    cells: list[PICell] = []
    inside: set[str] = set()
    for dual in network.cell.duals:
        if _is_fused(dual, wires, readers):
            cells.append(_pi_cell(dual, wires, rates[dual.neuron]))
            inside |= {dual.neuron, dual.residual, dual.multiplier}
    rectified = (*network.cell.diodes, *network.cell.objectives)
    for dual in () if differential else rectified:
        live = network.live[network.neuron_index[dual.neuron]]
        if _is_rectified(dual, wires, readers, live):
            cells.append(_diode_cell(dual, wires, rates[dual.neuron]))
            inside |= {dual.neuron, *dual.nodes}
    return cells, inside


def _readers(network: Network, wires: Wires) -> Counter[str]:
    """How often every node is read."""
    readers: Counter[str] = Counter(w.source for found in wires.values() for w in found)
    for block in network.cell.blocks:
        if isinstance(block, Product):
            readers.update((block.a, block.b))
        elif isinstance(block, Function):
            readers.update((block.x,))
    return readers


def _is_fused(dual: PIDual, wires: Wires, readers: Counter[str]) -> bool:
    """Whether a PI dual can be one op amp: c is read by mu and m only, mu by m only."""
    alone = readers[dual.residual] == 2 and readers[dual.neuron] == 1
    return alone and _is_proportional_integral(dual, wires)


def _is_proportional_integral(dual: PIDual, wires: Wires) -> bool:
    """Whether mu' is a positive share of c and m = mu + rho c with rho > 0, in the same cell."""
    into_mu, into_m = wires.get(dual.neuron, ()), wires.get(dual.multiplier, ())
    return (
        [w.source for w in into_mu] == [dual.residual]
        and {w.source for w in into_m} == {dual.neuron, dual.residual}
        and all(w.offset == 0 and (w.weight > 0).all() for w in (*into_mu, *into_m))
        and all((w.weight == 1).all() for w in into_m if w.source == dual.neuron)
    )


def _is_rectified(dual: Rectified, wires: Wires, readers: Counter[str], live: np.ndarray) -> bool:
    """Whether z can be one op amp: only its rectifier reads z + w g, and z' is all of its kind."""
    own = sum(w.source == dual.neuron for w in wires.get(dual.residual, ()))
    read = readers[dual.residual], readers[dual.sum], readers[dual.neuron] - own
    return read == (1, 1, 2) and _has_diode(dual, wires, live) and _leaks_little(dual, wires)


def _has_diode(dual: Rectified, wires: Wires, live: np.ndarray) -> bool:
    """Whether z' is a positive share of m - z and m that of z + w g with w > 0, where z lives."""
    into_z = {w.source: w for w in wires.get(dual.neuron, ())}
    into_sum = {w.source: w for w in wires.get(dual.sum, ())}
    if set(into_z) != {dual.multiplier, dual.neuron}:
        return False
    if set(into_sum) != {dual.neuron, dual.residual}:
        return False
    if any(wire.offset for wire in (*into_z.values(), *into_sum.values())):
        return False
    pull, leak = (into_z[source].weight[live] for source in (dual.multiplier, dual.neuron))
    one, w = (into_sum[source].weight[live] for source in (dual.neuron, dual.residual))
    return bool(((pull > 0) & (leak == -pull) & (one == 1) & (w > 0)).all())


def _leaks_little(dual: Rectified, wires: Wires) -> bool:
    """Whether g reads z as -d z at most, with 0 <= w d < 1: then it may read m instead."""
    d = -_weight(wires, dual.neuron, dual.residual)
    w = _weight(wires, dual.residual, dual.sum)
    return bool(np.all((d >= 0) & (w * d < 1)))


def _weight(wires: Wires, source: str, target: str) -> np.ndarray | float:
    """Of what arrives at a node from another one of its cell."""
    found = [w.weight for w in wires.get(target, ()) if w.source == source and not w.offset]
    return np.sum(found, axis=0) if found else 0.0


def _pi_cell(dual: PIDual, wires: Wires, rate: np.ndarray) -> PICell:
    return PICell(
        name=dual.multiplier,
        dual=dual.neuron,
        wires=wires.get(dual.residual, ()),
        rate=rate * _weight(wires, dual.residual, dual.neuron),
        rho=next(w.weight for w in wires[dual.multiplier] if w.source == dual.residual),
    )


def _diode_cell(dual: Rectified, wires: Wires, rate: np.ndarray) -> PICell:
    w = next(wire.weight for wire in wires[dual.sum] if wire.source == dual.residual)
    # m = z + w (g - d z), z' = (g - d z) / tau: m = z + rho (g - d m), z' = rate (g - d m)
    own, rest = wires.get(dual.residual, ()), 1.0
    if any(wire.source == dual.neuron for wire in own):
        rest = 1.0 + w * _weight(wires, dual.neuron, dual.residual)
        own = tuple(
            replace(wire, source=dual.multiplier) if wire.source == dual.neuron else wire
            for wire in own
        )
    return PICell(
        name=dual.multiplier,
        dual=dual.neuron,
        wires=own,
        rate=rate * _weight(wires, dual.multiplier, dual.neuron) * w / rest,
        rho=w / rest,
        rectified=True,
    )
