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
from ann_dc.hardware.emulation.assembly import Coupling, Piece, State, couplings, weighted_sum
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.parts.technologies import OtaC, paired
from ann_dc.hardware.schematic.elements import Adder, Amplifier, Integrator, PICell
from ann_dc.network.cell import Function, Sum

Source = tuple[str, int]
"""Node and offset of its cell."""


def transconductors(built: BuiltCircuit, technology: OtaC, part: Amplifier) -> Iterator[Piece]:
    """Yield the pieces of an integrator, a PI cell or an adder of transconductors."""
    factor = np.ones(built.stages)
    if not isinstance(part, Integrator):
        factor = factor + built.deviation(part.name, Quantity.FEEDBACK)
    rho = np.where(part.present, part.rho, 0.0) if isinstance(part, PICell) else 1.0
    gamma, sources = _sources(built, part, rho * factor)
    yield Sum(name=AmplifierNodes(part.name).summed)
    for number, (nodes, g) in enumerate(sources.items()):
        yield from _transconductor(built, technology, f"{part.name}.{number}", nodes)
        weight = g * technology.linear_range
        yield Coupling(f"tanh.{part.name}.{number}", AmplifierNodes(part.name).summed, weight)
    leak = gamma / built.datasheet.a0
    if isinstance(part, Adder):
        nodes = AmplifierNodes(part.name)
        yield from weighted_sum(nodes.output, {nodes.summed: 1 / (1 + leak)})
    elif isinstance(part, PICell):
        yield from _pi_cell(built, part, factor, leak)
    else:
        yield from _integrator(built, part, leak)


def _integrator(built: BuiltCircuit, part: Integrator, leak: np.ndarray) -> Iterator[Piece]:
    name = part.name
    tau = part.tau * (1 + built.deviation(name, Quantity.CAPACITOR))
    yield State(name, tau, Origin(name), scale=built.scale_of(name))
    yield from couplings(name, {AmplifierNodes(name).summed: 1.0, name: -leak})


def _pi_cell(
    built: BuiltCircuit, part: PICell, factor: np.ndarray, leak: np.ndarray
) -> Iterator[Piece]:
    nodes = AmplifierNodes(part.name)
    tau = part.tau * factor * (1 + built.deviation(part.name, Quantity.CAPACITOR))
    yield State(nodes.held, tau, Origin(part.dual))
    through = part.present / (1 + leak)
    yield from weighted_sum(nodes.output, {nodes.held: through, nodes.summed: through})
    yield from couplings(nodes.held, {nodes.summed: 1.0, nodes.output: -leak})


def _sources(
    built: BuiltCircuit, part: Amplifier, scale: np.ndarray
) -> tuple[np.ndarray, dict[tuple[Source, ...], np.ndarray]]:
    """Return Gamma (N,), and the conductance (N,) by the sources of every transconductor."""
    found: dict[tuple[Source, ...], np.ndarray] = {}
    gamma = np.zeros(built.stages)
    for stage in range(built.stages):
        weights = list(_weights(built, part, stage, scale))
        for _, _, g in weights:
            gamma[stage] += abs(g) / built.scaling.unit[part.name]
        for _, sources, g in paired(weights):
            found.setdefault(sources, np.zeros(built.stages))[stage] += g
    return gamma, found


def _weights(
    built: BuiltCircuit, part: Amplifier, stage: int, scale: np.ndarray
) -> Iterator[tuple[str, Source, float]]:
    """Yield name, source and conductance of every wire present at a stage."""
    for number, wire in enumerate(part.wires):
        if wire.weight[stage] != 0 and built.schematic.fed(wire, stage):
            g = wire.weight[stage] * built.scaling.unit[wire.source] * scale[stage]
            g = g / (1 + built.deviation(part.name, Quantity.INPUT, number)[stage])
            name = built.circuit.parameter_name(part.name, Quantity.INPUT, number)
            yield name, (wire.source, wire.offset), g


def _transconductor(
    built: BuiltCircuit, technology: OtaC, name: str, sources: tuple[Source, ...]
) -> Iterator[Piece]:
    """Yield tanh of one source or of the difference of two, relative to the linear range."""
    seen = f"seen.{name}"
    yield Sum(name=seen)
    yield Function(name=f"tanh.{name}", function="tanh", x=seen)
    for (source, offset), sign in zip(sources, (1.0, -1.0)):
        per_share = sign / (built.scaling.unit[source] * technology.linear_range)
        yield Coupling(source, seen, per_share, offset)
