"""A circuit as a network again: its neurons, and what each of them stands for.

All that parts do is neurons, sums and multipliers: the result is a `Network`, which every backend
runs, whose Jacobian is the pole model of the circuit, and in which every resistor, offset and gain
is the weight of a connection. `op_amps`, `transconductors` and `multipliers` have the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.nodes import AmplifierNodes, Origin
from ann_dc.network.network import Network
from ann_dc.validation.values import such_as


@such_as("ann_dc.emulate(circuit, level)")
@dataclass(frozen=True, kw_only=True, eq=False)
class Emulation:
    """The network that a circuit is.

    Attributes
    ----------
    network : Network
        Its neurons carry the names of the parts; values are in the units of the ideal network.
        ``held.<part>`` is a capacitor, ``not.<part>`` an inverter, ``open.<part>`` the op amp of a
        diode neuron, ``clamps.<part>`` what clamps follow,
        ``clamp_hi.<part>`` the op amp of one that moves, ``share.clamp_hi.<part>`` what it carries
        of the capacitor, ``ground.<part>`` a virtual ground,
        ``first.<part>`` an op amp before its second pole.
    circuit : Circuit
        What was emulated.
    origins : mapping of neuron name to Origin
        Which node of the ideal network each of its neurons stands for.
    slopes : mapping of parameter name to tuple of (connection name, (N,) array)
        How the weights of connections change with a parameter's deviation.
    """

    network: Network
    circuit: Circuit
    origins: Mapping[str, Origin]
    slopes: Mapping[str, tuple[tuple[str, np.ndarray], ...]]

    @cached_property
    def outputs(self) -> np.ndarray:
        """(m,) components of the state that stand for the ideal network's controls.

        For all of its neurons where it has no controls; a multiplier stands on its capacitor.
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
        """Names of the neurons of ``outputs``, one for each of them."""
        rows = self.network.places[self.outputs, 0]
        return [self.network.cell.neurons[row].name for row in rows]

    @cached_property
    def clips(self) -> np.ndarray:
        """(n,) booleans: whose rails are those of a part, and not those of the ideal network."""
        held = {AmplifierNodes(part.name).held for part in self.circuit.schematic.parts}
        names = [neuron.name for neuron in self.network.cell.neurons]
        return np.array([names[row] not in held for row in self.network.places[:, 0]])

    def controls(self, x: np.ndarray) -> np.ndarray:
        """Controls of states of the emulation, in the units of the states.

        Parameters
        ----------
        x : (..., n) array
            State vectors of the emulation.

        Returns
        -------
        (..., m) array
            All stages' controls, in the order of ``outputs``.
        """
        return np.asarray(x)[..., self.outputs]
