r"""Integrating capacitors as neurons: charging current, leakage, switch charge.

A capacitor C with insulation tau_l = R C is in parallel with an open reset switch of capacitance
C_s and resistance R_s towards the preset h_0. The capacitor voltage h obeys

.. math:: (C + C_s)\, \dot h = i - \frac{C}{\tau_l} h - \frac{h - h_0}{R_s} ,

and starts q / (C + C_s) above h_0 if the opening switch leaves a charge q. In a differential
circuit both switches leave equal charges, which have no effect.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit, Quantity
from ann_dc.hardware.emulation.assembly import (
    Coupling,
    Piece,
    State,
    Weight,
    couplings,
    weighted_sum,
)
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.elements import UNLIMITED, Integrator, PICell
from ann_dc.network.cell import ONE, Limiter
from ann_dc.network.network import Network


def capacitor(
    built: BuiltCircuit,
    part: Integrator | PICell,
    weights: Mapping[str, Weight],
    tau: np.ndarray,
    limiter: Limiter = UNLIMITED,
) -> Iterator[Piece]:
    """Yield tau h' = the sum of weighted nodes, within limits, minus leakage.

    ``tau`` (N,) is the time constant of the nominal capacitor alone.
    """
    nodes, circuit = AmplifierNodes(part.name), built.circuit
    parasitics, name = built.datasheet.parasitics, part.name
    off = built.deviation(name, Quantity.CAPACITOR)
    origin = Origin(part.dual if isinstance(part, PICell) else name)
    farads = np.where(part.present, circuit.capacitors[name], np.inf)
    total = 1 + off + parasitics.switch_capacitance / farads
    yield State(nodes.held, tau * total, origin, limiter)
    yield from couplings(nodes.held, weights)
    rate = built.scaling.time * tau  # of one per second
    insulator = rate * (1 + off) / parasitics.capacitor_leakage
    insulator = insulator * circuit.own_capacitors(name) / farads
    switch = rate / (farads * parasitics.switch_leakage)
    if (insulator + switch).any():
        preset = switch * circuit.presets[name] * circuit.value_of(name)
        yield from weighted_sum(nodes.leak, {nodes.held: -(insulator + switch), ONE: preset})
        yield Coupling(nodes.leak, nodes.held, 1.0)


def released(
    network: Network,
    circuit: Circuit,
    parasitics: Parasitics,
    off: Mapping[str, np.ndarray],
    x: np.ndarray,
) -> np.ndarray:
    """Return the state (n,) after the reset switches have opened.

    It includes the switch charge.

    ``network`` is that of the emulation, ``off`` maps parameter names to capacitor deviations (N,),
    and ``x`` (n,) is the state with closed switches.
    """
    if parasitics.switch_charge == 0 or circuit.schematic.differential:
        return x
    values = network.unpack(x)
    for name, farads in circuit.capacitors.items():
        deviation = off.get(circuit.parameter_name(name, Quantity.CAPACITOR), 0.0)
        total = farads * (1 + deviation) + parasitics.switch_capacitance
        row = network.neuron_index[AmplifierNodes(name).held]
        volts = np.divide(
            parasitics.switch_charge, total, out=np.zeros_like(total), where=total > 0
        )
        values[row] += volts * circuit.value_of(name)
    return network.pack(values)
