r"""Idle clamps: outputs of their op amps, and their capacitance at an integrator.

The op amp of an idle clamp at an upper limit u follows the output x, two diode drops below. One
drop is not sufficient, because near the limit idle diodes carry little current and the clamping
diode leaks:

.. math:: o = x - V_D \ln\Big(1 + \frac{u - x}{R_1 I_s}\Big) , \qquad
    \frac{do}{dx} = 1 + \frac{V_D}{u - x + R_1 I_s} , \quad V_D = 2 V_T .

A fraction s of the integrator's capacitor is charged with o, so near a limit this part is larger by
the factor do/dx.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.hardware.circuit.circuit import (
    CLAMP_REFERENCE,
    CLAMP_RESTING,
    CLAMP_SATURATION,
    CLAMP_SHARE,
    THERMAL,
    Circuit,
)
from ann_dc.hardware.emulation.emulation import Emulation, slower_network
from ann_dc.hardware.emulation.nodes import AmplifierNodes, ClampNodes
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.schematic.elements import Integrator
from ann_dc.network.network import Network

BESIDE = 1e-4
"""Distance in volts from a limit at which reset leaves an output that starts at the limit.

The cause is the current of its inputs through a closed switch of one ohm.
"""


@dataclass(frozen=True)
class Clamp:
    """Clamp of an integrator, in network units of its output.

    ``side`` is 1 for the upper limit, -1 for the lower limit. ``thermal`` is V_T, ``idling`` V_D of
    the diodes through which the inactive clamp follows, and ``seeping`` R_1 I_s.
    """

    nodes: ClampNodes
    side: float
    rail: float
    thermal: float
    idling: float
    seeping: float

    def idle(self, x: np.ndarray) -> np.ndarray:
        """Return the op amp's equilibrium output while the integrator is within limits."""
        apart = np.maximum(self.side * (self.rail - x), self.thermal * BESIDE / THERMAL)
        return x - self.side * self.idling * np.log1p(apart / self.seeping)

    def added(self, x: np.ndarray) -> np.ndarray:
        """Return the added relative capacitance; 0 if the clamp conducts."""
        apart = self.side * (self.rail - x)
        off = apart > self.thermal * BESIDE / THERMAL
        return CLAMP_SHARE * self.idling / (np.where(off, apart, np.inf) + self.seeping)


def clamps_of(circuit: Circuit, sheet: Datasheet, part: Integrator) -> tuple[Clamp, ...]:
    """Return the moving clamps of an integrator, one per limit, the lower limit first."""
    built, value = circuit.limiter(part), circuit.value_of(part.name)
    return tuple(
        Clamp(
            nodes=ClampNodes(part.name, upper=side * value > 0),
            side=side,
            rail=rail,
            thermal=THERMAL * abs(value),
            idling=CLAMP_RESTING * THERMAL * abs(value),
            seeping=CLAMP_REFERENCE / sheet.gbw * CLAMP_SATURATION * abs(value),
        )
        for side, rail in ((-1.0, built.low), (1.0, built.high))
        if math.isfinite(rail)
    )


def rest_idle(network: Network, circuit: Circuit, sheet: Datasheet, x: np.ndarray) -> np.ndarray:
    """Return an emulation state in which all moving clamps are off.

    The given state ``x`` (n,) has outputs inside their limits.
    """
    full = network.unpack(x).copy()
    for part in circuit.schematic.limited:
        output = full[network.neuron_index[part.name]]
        beside = np.zeros_like(output)
        for clamp in clamps_of(circuit, sheet, part):
            rest = clamp.idle(output)
            beside += CLAMP_SHARE * (rest - output)
            for name in (clamp.nodes.output, clamp.nodes.share):
                full[network.neuron_index[name]] = rest
        full[network.neuron_index[AmplifierNodes(part.name).held]] = output + beside
    return network.pack(full)


def beside_rails(emulation: Emulation, sheet: Datasheet, x: np.ndarray) -> Emulation:
    """Return an emulation with the capacitors enlarged by idle clamps at a state.

    The given emulation treats clamps as ideal limiters, and ``x`` (n,) is a state of the ideal
    network. The emulation is returned unchanged if the circuit has no clamps.
    """
    circuit, network = emulation.circuit, emulation.network
    ideal, larger = circuit.schematic.network, dict[str, np.ndarray]()
    values = ideal.unpack(x)
    for part in circuit.schematic.limited:
        output = values[ideal.neuron_index[part.name]]
        added = [clamp.added(output) for clamp in clamps_of(circuit, sheet, part)]
        larger[AmplifierNodes(part.name).held] = 1 + np.sum(added, axis=0)
    return replace(emulation, network=slower_network(network, larger)) if larger else emulation
