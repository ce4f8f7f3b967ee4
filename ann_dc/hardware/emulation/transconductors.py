r"""Transconductors as neurons: a tanh per weight, into one node per part.

Let G_j = |w_j| S_j be the conductance of a wire in network units, and L the linear range relative
to full scale. A source has the fraction v = s / S of full scale. A transconductor adds

.. math:: G\,L \tanh(v / L) \;\text{(one weight)}, \qquad
    G\,L \tanh((v_a - v_b) / L) \;\text{(a pair)}

to A, and a finite gain A0 of all transconductors at a node subtracts A / A0 of the node's value. A
pair reads only the difference of two sources, so its curvature vanishes together with a residual.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ann_dc.hardware.circuit.circuit import Quantity
from ann_dc.hardware.emulation.assembly import Assembly
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.parts.technologies import OtaC, paired
from ann_dc.hardware.schematic.elements import Adder, Amplifier, Integrator, PICell

Source = tuple[str, int]
"""Node and offset of its cell."""


def add_transconductors(assembly: Assembly, built: OtaC, part: Amplifier) -> None:
    """Add an integrator, a PI cell or an adder of transconductors to an assembly."""
    if isinstance(part, Adder):
        _adder(assembly, built, part)
    elif isinstance(part, PICell):
        _pi_cell(assembly, built, part)
    else:
        _integrator(assembly, built, part)


def _integrator(assembly: Assembly, built: OtaC, part: Integrator) -> None:
    name = part.name
    gamma = _arriving(assembly, built, part, np.ones(assembly.stages))
    off = assembly.deviation(name, Quantity.CAPACITOR)
    assembly.neuron(name, part.tau * (1 + off), Origin(name), scale=assembly.scale_of(name))
    assembly.connect(AmplifierNodes(name).summed, name, 1.0)
    assembly.connect(name, name, -gamma / assembly.datasheet.a0)
    assembly.leave_out_unpinned(name, part.present)


def _pi_cell(assembly: Assembly, built: OtaC, part: PICell) -> None:
    nodes, present = AmplifierNodes(part.name), part.present
    factor = 1 + assembly.deviation(part.name, Quantity.FEEDBACK)
    rho = np.where(present, part.rho, 0.0) * factor
    leak = _arriving(assembly, built, part, rho) / assembly.datasheet.a0
    tau = part.tau * factor * (1 + assembly.deviation(part.name, Quantity.CAPACITOR))
    assembly.neuron(nodes.held, tau, Origin(part.dual))
    assembly.sum(nodes.output)
    assembly.connect(nodes.held, nodes.output, present / (1 + leak))
    assembly.connect(nodes.summed, nodes.output, present / (1 + leak))
    assembly.connect(nodes.summed, nodes.held, 1.0)
    assembly.connect(nodes.output, nodes.held, -leak)
    assembly.leave_out(nodes.held, np.flatnonzero(~present).tolist())


def _adder(assembly: Assembly, built: OtaC, part: Adder) -> None:
    nodes = AmplifierNodes(part.name)
    factor = 1 + assembly.deviation(part.name, Quantity.FEEDBACK)
    leak = _arriving(assembly, built, part, factor) / assembly.datasheet.a0
    assembly.sum(nodes.output)
    assembly.connect(nodes.summed, nodes.output, 1 / (1 + leak))


def _arriving(assembly: Assembly, built: OtaC, part: Amplifier, scale: np.ndarray) -> np.ndarray:
    """Connect the transconductors of a part to its sum and return their Gamma (N,)."""
    found: dict[tuple[Source, ...], np.ndarray] = {}
    gamma = np.zeros(assembly.stages)
    for stage in range(assembly.stages):
        weights = list(_weights(assembly, part, stage, scale))
        for _, _, g in weights:
            gamma[stage] += abs(g) / assembly.scaling.unit[part.name]
        for _, sources, g in paired(weights):
            found.setdefault(sources, np.zeros(assembly.stages))[stage] += g
    assembly.sum(AmplifierNodes(part.name).summed)
    for number, (sources, g) in enumerate(found.items()):
        _transconductor(assembly, built, part.name, number, sources, g)
    return gamma


def _weights(
    assembly: Assembly, part: Amplifier, stage: int, scale: np.ndarray
) -> Iterator[tuple[str, Source, float]]:
    """Yield name, source and conductance of every wire present at a stage."""
    for number, wire in enumerate(part.wires):
        if wire.weight[stage] != 0 and assembly.schematic.fed(wire, stage):
            g = wire.weight[stage] * assembly.scaling.unit[wire.source] * scale[stage]
            g = g / (1 + assembly.deviation(part.name, Quantity.INPUT, number)[stage])
            name = assembly.circuit.parameter_name(part.name, Quantity.INPUT, number)
            yield name, (wire.source, wire.offset), g


def _transconductor(
    assembly: Assembly,
    built: OtaC,
    part: str,
    number: int,
    sources: tuple[Source, ...],
    g: np.ndarray,
) -> None:
    seen, curve = f"seen.{part}.{number}", f"tanh.{part}.{number}"
    assembly.sum(seen)
    assembly.function(curve, "tanh", seen)
    for (source, offset), sign in zip(sources, (1.0, -1.0)):
        per_share = sign / (assembly.scaling.unit[source] * built.linear_range)
        assembly.connect(source, seen, per_share, offset)
    assembly.connect(curve, AmplifierNodes(part).summed, g * built.linear_range)
