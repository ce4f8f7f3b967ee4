"""PI-cell merging: nodes of a PI, inequality or objective dual in one op amp.

A residual sum, an integrator and a proportional path together are an amplifier with series R-C
feedback, provided that no other node reads the inner nodes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.schematic.elements import PICell, Wire, arguments
from ann_dc.network.duals import InequalityDual, ObjectiveDual, PIDual
from ann_dc.network.network import Network

Wires: TypeAlias = Mapping[str, tuple[Wire, ...]]
"""Incoming wires by node name."""

Rectified: TypeAlias = InequalityDual | ObjectiveDual
"""Duals that become PI cells with diodes."""


def wires_of(network: Network) -> Wires:
    """Return the incoming wires of every node of a cell."""
    arriving: dict[str, list[Wire]] = {}
    for c in network.cell.connections:
        weight = np.broadcast_to(np.asarray(c.weight, float), network.stages)
        wire = Wire(source=c.source, offset=int(c.template), weight=weight)
        arriving.setdefault(c.target, []).append(wire)
    return {name: tuple(found) for name, found in arriving.items()}


def rates_of(network: Network) -> dict[str, np.ndarray]:
    """Return 1 / tau (N,) of every neuron, zero for fixed or omitted cells."""
    return dict(zip((n.name for n in network.cell.neurons), evaluator(network).tape.rates))


def fused_cells(
    network: Network, wires: Wires, *, differential: bool
) -> tuple[list[PICell], set[str]]:
    """Return PI cells, and the neurons and blocks that are inside them.

    The ``wires`` are those of `wires_of`. If outputs are ``differential``, no cell is rectified.
    """
    readers, rates = _readers(network, wires), rates_of(network)
    cells: list[PICell] = []
    inside: set[str] = set()
    for dual in network.cell.duals:
        if _is_fused(dual, wires, readers):
            cells.append(_pi_cell(dual, wires, rates[dual.neuron]))
            inside |= {dual.neuron, dual.residual, dual.multiplier}
    rectified = (*network.cell.inequality_duals, *network.cell.objectives)
    for dual in () if differential else rectified:
        live = network.live[network.neuron_index[dual.neuron]]
        if _is_rectified(dual, wires, readers, live):
            cells.append(_diode_cell(dual, wires, rates[dual.neuron]))
            inside |= {dual.neuron, *dual.nodes}
    return cells, inside


def _readers(network: Network, wires: Wires) -> Counter[str]:
    """Return the number of readers of every node."""
    readers: Counter[str] = Counter(w.source for found in wires.values() for w in found)
    for block in network.cell.blocks:
        readers.update(arguments(block))
    return readers


def _is_fused(dual: PIDual, wires: Wires, readers: Counter[str]) -> bool:
    """Return True if a PI dual is one op amp: mu and m alone read c, m alone reads mu."""
    alone = readers[dual.residual] == 2 and readers[dual.neuron] == 1
    return alone and _is_proportional_integral(dual, wires)


def _is_proportional_integral(dual: PIDual, wires: Wires) -> bool:
    """Return True if mu' is a positive multiple of c and m = mu + rho c with rho > 0."""
    into_mu, into_m = wires.get(dual.neuron, ()), wires.get(dual.multiplier, ())
    return (
        [w.source for w in into_mu] == [dual.residual]
        and {w.source for w in into_m} == {dual.neuron, dual.residual}
        and all(w.offset == 0 and (w.weight > 0).all() for w in (*into_mu, *into_m))
        and all((w.weight == 1).all() for w in into_m if w.source == dual.neuron)
    )


def _is_rectified(dual: Rectified, wires: Wires, readers: Counter[str], live: np.ndarray) -> bool:
    """Return True if z can be one op amp: only its rectifier reads z + w g."""
    own = sum(w.source == dual.neuron for w in wires.get(dual.residual, ()))
    read = readers[dual.residual], readers[dual.sum], readers[dual.neuron] - own
    return read == (1, 1, 2) and _has_diode(dual, wires, live) and _leaks_little(dual, wires)


def _has_diode(dual: Rectified, wires: Wires, live: np.ndarray) -> bool:
    """Return True if z' is a positive multiple of m - z, m that of z + w g with w > 0.

    The condition applies to the stages at which z exists.
    """
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
    """Return True if g reads z at most as -d z, 0 <= w d < 1: then g may read m."""
    d = -_weight(wires, dual.neuron, dual.residual)
    w = _weight(wires, dual.residual, dual.sum)
    return bool(np.all((d >= 0) & (w * d < 1)))


def _weight(wires: Wires, source: str, target: str) -> np.ndarray | float:
    """Return the weight into a node from another node of its cell."""
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
