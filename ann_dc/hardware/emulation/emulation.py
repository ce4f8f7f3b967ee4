"""Behavioural emulation of a circuit: a network and the counterparts of neurons.

All effects of parts are neurons, sums and multipliers, so the result is a `Network`, which every
backend runs. Its Jacobian is the pole model of the circuit, and every resistor, offset and gain is
the weight of a connection. `op_amps`, `transconductors` and `multipliers` contain the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ann_dc.dataclass_pickling import Record
from ann_dc.errors import such_as
from ann_dc.hardware.circuit.circuit import THERMAL, Circuit
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.network.network import Network

AT_KNEE = 1.5
"""1 / (1 - p) at the knee."""

STEEP = 10.0
"""Factor on the distance from the knee while the diode is off; the pace quickly reaches 1."""


@such_as("ann_dc.emulate(circuit, level)")
@dataclass(frozen=True, kw_only=True, eq=False)
class Emulation(Record):
    """Network that represents a circuit.

    Attributes
    ----------
    network : Network
        Neurons have the names of the parts; values are in units of the ideal network.
        ``held.<part>`` is a capacitor, ``not.<part>`` an inverter, and ``open.<part>`` the op amp
        of a rectifying multiplier neuron. ``clamps.<part>`` is the output of the idle clamps,
        ``clamp_hi.<part>`` the op amp of a moving clamp, and ``share.clamp_hi.<part>`` its part of
        the capacitor. ``ground.<part>`` is a virtual ground, ``first.<part>`` an op amp before its
        second pole.
    circuit : Circuit
        Emulated circuit.
    origins : mapping of neuron name to Origin
        Node of the ideal network that each neuron represents.
    slopes : mapping of parameter name to tuple of (connection name, (N,) array)
        Change of connection weights per deviation of a parameter.
    """

    network: Network
    circuit: Circuit
    origins: Mapping[str, Origin]
    slopes: Mapping[str, tuple[tuple[str, np.ndarray], ...]]

    @cached_property
    def outputs(self) -> np.ndarray:
        """State components (m,) of the ideal controls, or of all neurons without controls.

        A multiplier output is represented by its capacitor.
        """
        ideal = self.circuit.schematic.network
        controls = ideal.of_population("u")
        places = ideal.places[controls] if controls.any() else ideal.places
        held = {origin.node: name for name, origin in self.origins.items()}
        names = [ideal.cell.neurons[neuron].name for neuron, _ in places]
        index = self.network.neuron_index
        rows = [index[name if name in index else held[name]] for name in names]
        return self.network.state_index[rows, places[:, 1]]

    @property
    def output_names(self) -> list[str]:
        """Names of the neurons of ``outputs``."""
        rows = self.network.places[self.outputs, 0]
        return [self.network.cell.neurons[row].name for row in rows]

    @cached_property
    def clips(self) -> np.ndarray:
        """Mask (n,) of the neurons with limits of a part and not of the ideal network."""
        held = {AmplifierNodes(part.name).held for part in self.circuit.schematic.parts}
        names = [neuron.name for neuron in self.network.cell.neurons]
        return np.array([names[row] not in held for row in self.network.places[:, 0]])

    def controls(self, x: np.ndarray) -> np.ndarray:
        """Return the controls (..., m) of states (..., n), in the units of the states.

        The controls of all stages are in the order of ``outputs``.
        """
        return np.asarray(x)[..., self.outputs]


def slower_network(network: Network, factors: Mapping[str, np.ndarray]) -> Network:
    """Return the network with the time constants of some neurons multiplied by factors (N,)."""
    neurons = tuple(
        replace(neuron, tau=neuron.tau * factors.get(neuron.name, 1.0))
        for neuron in network.cell.neurons
    )
    return replace(network, cell=replace(network.cell, neurons=neurons))


def paced_at(emulation: Emulation, x: np.ndarray) -> Network:
    """Return the emulation's network with the paces of a state in its time constants.

    The emulation has no paces as nodes, and ``x`` (n,) is its state at rest.
    """
    circuit, network = emulation.circuit, emulation.network
    values, slower = network.unpack(x), dict[str, np.ndarray]()
    for part in circuit.schematic.rectified:
        op_amp = AmplifierNodes(part.name, rectified=True)
        if op_amp.pace not in network.node_index:
            thermal = THERMAL * abs(circuit.value_of(part.name))
            y = values[network.neuron_index[op_amp.output]] / thermal
            pace = 1 - 1 / (AT_KNEE + np.where(y > 0, y, -STEEP * y))
            pole = op_amp.first if op_amp.first in network.neuron_index else op_amp.output
            slower[pole] = 1 / pace
    return slower_network(network, slower) if slower else network
