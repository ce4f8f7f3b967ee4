r"""An OTA-C circuit as a network again: tanh transconductors into one node a neuron.

With G_j = |w_j| S_j the conductance of a wire in units of the network, L the linear range over full
scale, and v = s / S the share of full scale of a source, a transconductor brings

.. math:: G\,L \tanh(v / L) \;\text{(one weight)}, \qquad
    G\,L \tanh((v_a - v_b) / L) \;\text{(a pair)}

to A, and a finite gain A0 of all that drive a node takes A / A0 of its own value away. A pair sees
the difference of two sources only, so its curvature goes where a residual goes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations, checked, parameters
from ann_dc.hardware.circuit.elements import Adder, Integrator, PICell
from ann_dc.hardware.emulation.emulation import HELD, SUMMED, Emulation, Emulator, emulate
from ann_dc.hardware.parts.datasheet import Datasheet
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OtaC, paired
from ann_dc.network.cell import Function, Neuron, Sum
from ann_dc.network.ends import Absent


def emulate_transconductors(
    circuit: Circuit,
    datasheet: Datasheet,
    deviations: Deviations | None = None,
    *,
    linear_range: float,
) -> Emulation:
    """The network of an OTA-C circuit's equations; see `ann_dc.hardware.emulation.emulation.emulate`.

    Parameters
    ----------
    circuit : Circuit
        Of a differential schematic.
    datasheet : Datasheet
        a0 is the gain of a node; bandwidths are those of multipliers and function generators.
    deviations : mapping of parameter name to (N,) array, optional
    linear_range : float
        L.

    Raises
    ------
    NetworkError
        If the circuit has coordinators.
    """
    if circuit.schematic.coupling is not None:
        raise NetworkError("emulation: coarse coordinators reach beyond neighbours; leave them out")
    off = checked(parameters(circuit), deviations or {})
    return _Transconductors(circuit, datasheet, off, linear_range=linear_range).emulation()


@dataclass(eq=False)
class _Transconductors(Emulator):
    linear_range: float = 30.0

    def _integrator(self, part: Integrator) -> None:
        there = part.rate > 0
        gamma = self._arriving(part, np.ones(self.stages))
        off = self._deviation(f"c_{self.schematic.alias[part.name]}")
        tau = np.where(there, 1 / np.where(there, part.rate, 1.0), 1.0) * (1 + off)
        unit = self._unit_of(part.name)
        self.neurons.append(Neuron(name=part.name, tau=tau, unit=unit))
        self._connect(SUMMED + part.name, part.name, 1.0)
        self._connect(part.name, part.name, -gamma / self.datasheet.a0)
        self._leave_out(part.name, there)

    def _pi_cell(self, part: PICell) -> None:
        there = part.rate > 0
        alias = self.schematic.alias[part.name]
        factor = 1 + self._deviation(f"rf_{alias}")
        rho = np.where(there, part.rho, 0.0) * factor
        leak = self._arriving(part, rho) / self.datasheet.a0
        tau = np.where(there, part.rho / np.where(there, part.rate, 1.0), 1.0)
        tau = tau * factor * (1 + self._deviation(f"c_{alias}"))
        self.neurons.append(Neuron(name=HELD + part.name, tau=tau))
        self.blocks.append(Sum(name=part.name))
        self._connect(HELD + part.name, part.name, there / (1 + leak))
        self._connect(SUMMED + part.name, part.name, there / (1 + leak))
        self._connect(SUMMED + part.name, HELD + part.name, 1.0)
        self._connect(part.name, HELD + part.name, -leak)
        self._leave_out(HELD + part.name, there)

    def _adder(self, part: Adder) -> None:
        factor = 1 + self._deviation(f"rf_{self.schematic.alias[part.name]}")
        leak = self._arriving(part, factor) / self.datasheet.a0
        self.blocks.append(Sum(name=part.name))
        self._connect(SUMMED + part.name, part.name, 1 / (1 + leak))

    def _leave_out(self, name: str, there: np.ndarray) -> None:
        for stage in np.flatnonzero(~there):
            if (name, int(stage)) not in self.schematic.pins:
                self.absent.append(Absent(neuron=name, stage=int(stage)))

    def _arriving(self, part, scale: np.ndarray) -> np.ndarray:
        """Wire the transconductors of a part into ``summed.<part>``; their Gamma (N,)."""
        units, alias = self.scaling.unit, self.schematic.alias[part.name]
        found: dict[tuple, np.ndarray] = {}
        gamma = np.zeros(self.stages)
        for stage in range(self.stages):
            weights = []
            for number, wire in enumerate(part.wires):
                name = f"r_{alias}_{number}"
                if wire.weight[stage] != 0 and self.schematic.fed(wire, stage):
                    g = wire.weight[stage] * units[wire.source] * scale[stage]
                    g = g / (1 + self._deviation(name)[stage])
                    weights.append((name, (wire.source, wire.offset), g))
                    gamma[stage] += abs(g) / units[part.name]
            for _, nodes, g in paired(weights):
                found.setdefault(nodes, np.zeros(self.stages))[stage] += g
        self.blocks.append(Sum(name=SUMMED + part.name))
        for number, (nodes, g) in enumerate(found.items()):
            self._transconductor(f"{part.name}.{number}", part.name, nodes, g)
        return gamma

    def _transconductor(self, name: str, part: str, nodes: tuple, g: np.ndarray) -> None:
        seen, curve = f"seen.{name}", f"tanh.{name}"
        self.blocks += [Sum(name=seen), Function(name=curve, function="tanh", x=seen)]
        for (source, offset), sign in zip(nodes, (1.0, -1.0)):
            per_share = sign / (self.scaling.unit[source] * self.linear_range)
            self._connect(source, seen, per_share, offset)
        self._connect(curve, SUMMED + part, g * self.linear_range)


def emulate_level(
    circuit: Circuit, level: Level, deviations: Deviations | None = None
) -> Emulation:
    """TODO: becomes emulate(circuit, level, deviations)."""
    built = level.technology
    if isinstance(built, OtaC):
        return emulate_transconductors(
            circuit, level.datasheet, deviations, linear_range=built.linear_range
        )
    if built.clocked:
        raise NetworkError(
            "emulation: a switched-capacitor circuit is no network in continuous time; run the "
            "recurrent layer with the same step"
        )
    return emulate(circuit, level.datasheet, deviations)
