r"""Noise inputs of the emulation's network: currents at virtual grounds, voltages.

A current i into the virtual ground of a part adds to the contribution of the resistors there. With
V/S volts per unit of the part's node, p its polarity, and T seconds per unit of network time,

.. math::
    A \to A - \frac{p S}{V} \frac{T}{rate\, C}\, i \;\text{(integrator)}, \qquad
    A \to A - \frac{p S}{V} R_f\, i \;\text{(PI cell, adder, inverter)} .

A current across the feedback resistor of a PI cell moves its virtual ground and not its capacitor:
e -> e + (p S / V) R_f i / (1 + Gamma). The voltage of a multiplier acts as its output offset.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ann_dc.hardware.circuit.circuit import Quantity
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.emulation.noise_currents import Currents, Place, Source
from ann_dc.hardware.schematic.elements import Integrator
from ann_dc.network.cell import Connection
from ann_dc.network.network import Network
from ann_dc.validation import checked


def noise_input(source: Source) -> str:
    """Return the input name of a source, which carries amperes, or volts."""
    return f"noise.{source.name}"


@checked
def noisy_network(
    emulation: Emulation, currents: Currents, deviations: Deviations | None = None
) -> Network:
    """Return the emulation's network with an input per noise source, initially zero.

    Inputs are in amperes or volts. The samples of ``currents`` are not used. ``deviations`` are
    those with which the emulation was made.
    """
    network, cell = emulation.network, emulation.network.cell
    off = deviations or {}
    inputs = {noise_input(source): 0.0 for source in currents.sources}
    wires = tuple(_connection(emulation, source, off) for source in currents.sources)
    return replace(
        network,
        cell=replace(cell, inputs=(*cell.inputs, *inputs), connections=(*cell.connections, *wires)),
        inputs={**network.inputs, **inputs},
    )


def _connection(emulation: Emulation, source: Source, off: Deviations) -> Connection:
    if source.place is Place.PRODUCT:
        return _as_offset(emulation, source)
    nodes = AmplifierNodes(source.part, inverter=source.place is Place.INVERTER)
    part, ohms = emulation.circuit.schematic.by_name[source.part], _ohms(emulation, source, off)
    own = isinstance(part, Integrator) and source.place is Place.GROUND
    target = nodes.held if own else nodes.summed
    if source.place is Place.FEEDBACK:
        (wire,) = _between(emulation, nodes.summed, (nodes.ground, nodes.lagging))
        target, ohms = wire.target, ohms * np.asarray(wire.weight)
    volt = emulation.circuit.value_of(source.part)
    weight = np.where(source.conductance > 0, -ohms * volt, 0.0)
    return Connection(source=noise_input(source), target=target, weight=weight)


def _as_offset(emulation: Emulation, source: Source) -> Connection:
    """Return the connection of one volt at a multiplier's output, like its offset."""
    name = emulation.circuit.parameter_name(source.part, Quantity.OFFSET_Z)
    ((offset, slope),) = emulation.slopes[name]
    target = next(wire.target for wire in emulation.network.cell.connections if wire.name == offset)
    weight = np.where(source.conductance > 0, slope, 0.0)
    return Connection(source=noise_input(source), target=target, weight=weight)


def _ohms(emulation: Emulation, source: Source, off: Deviations) -> np.ndarray:
    """Return volts at the output per ampere (integrator: per unit of network time)."""
    circuit, name = emulation.circuit, source.part
    part = circuit.schematic.by_name[name]
    if source.place is Place.INVERTER:
        return circuit.inverter * (1 + _deviation(emulation, off, name, Quantity.INVERTER))
    if isinstance(part, Integrator):
        rate = np.where(part.rate > 0, part.rate, np.inf)
        return circuit.scaling.time / (rate * circuit.capacitors[name])
    return circuit.feedback[name] * (1 + _deviation(emulation, off, name, Quantity.FEEDBACK))


def _deviation(emulation: Emulation, off: Deviations, part: str, quantity: Quantity) -> np.ndarray:
    return np.asarray(off.get(emulation.circuit.parameter_name(part, quantity), 0.0))


def _between(emulation: Emulation, source: str, targets: tuple[str, ...]) -> list[Connection]:
    wires = emulation.network.cell.connections
    return [wire for wire in wires if wire.source == source and wire.target in targets]
