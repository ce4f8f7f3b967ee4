"""TODO: the idea."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.backends.settling import control_settling
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.trajectory import Trajectory, control_error
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.elements import Generator, Multiplier
from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.parts.datasheet import Datasheet

OVERLOAD = 0.95
"""Share of full scale from which on a node counts as overloaded, where there are no rails."""


KNEE = 0.9
"""Share of its rails from which on a part clips."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Overload:
    """A node that went further than its part can: where, when (s), and to how many volts."""

    node: str
    stage: int
    time: float
    volts: float
    limit: float

    def __str__(self) -> str:
        return (
            f"{self.node} of cell {self.stage} reached {self.volts:.4g} V at {self.time:.3g} s; "
            f"it is good for {self.limit:.4g} V"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class CircuitRun:
    """One run of a circuit.

    Attributes
    ----------
    trajectory : Trajectory
        States in network units over network time, from the opening of the reset switches on.
    deck : Deck
    scaling : Scaling
    overloads : tuple of Overload
        Nodes above `KNEE` of their rails, or above `OVERLOAD` of full scale where parts have none,
        worst first: a clipped circuit can settle quietly to a wrong point.
    probe : Trajectory
        The ODE run of the same network.
    circuit : Circuit
    """

    trajectory: Trajectory
    deck: Deck
    scaling: Scaling
    overloads: tuple[Overload, ...]
    probe: Trajectory
    circuit: Circuit

    @property
    def control_error(self) -> float:
        """Largest error of a control at the end, over the largest control of the optimum."""
        return control_error(self.trajectory.controls[-1], self.probe)

    @property
    def mean_square_error(self) -> float:
        """Of the whole trajectory against the ODE, normalised by the mean square of the ODE's."""
        at = self.trajectory.time
        wanted = np.array([np.interp(at, self.probe.time, x) for x in self.probe.states.T]).T
        weight = np.gradient(at)[:, None]  # over time, however unevenly the circuit was sampled
        error = ((self.trajectory.states - wanted) ** 2 * weight).sum()
        return float(error / (wanted**2 * weight).sum())

    def settled(self, share: float = 1e-3) -> bool:
        """Whether the controls kept within ``share`` for the last third of the run."""
        end = self.deck.timing.unit * float(self.trajectory.time[-1])
        return self.settling_time(share) < 2 / 3 * end

    def settling_time(self, share: float = 1e-3) -> float:
        """Seconds after which every control stays within ``share`` of the largest final one."""
        return control_settling(self.trajectory, share) * self.deck.timing.unit


def read_back(
    circuit: Circuit, written: Deck, raw: Raw, probe: Trajectory, datasheet: Datasheet | None = None
) -> CircuitRun:
    """States of the neurons from the voltages of a run; rails are those of the hardware."""
    network, scaling = circuit.schematic.network, circuit.scaling
    time, nodes = _voltages(circuit, written, raw)
    states = _states(circuit, nodes, len(time))
    kernel = CompiledEvaluator(network)
    residuals = np.array([kernel.residuals(x) for x in states])
    seconds = time * written.timing.unit
    return CircuitRun(
        trajectory=Trajectory(
            network=network, time=time, states=states, residual_time=time, residuals=residuals
        ),
        deck=written,
        scaling=scaling,
        overloads=_overloads(circuit, nodes, seconds, datasheet or Datasheet()),
        probe=probe,
        circuit=circuit,
    )


def _voltages(
    circuit: Circuit, written: Deck, raw: Raw
) -> tuple[np.ndarray, dict[tuple[str, int], np.ndarray]]:
    """Network time of the samples, and the voltage of every node with the sign of its value."""
    polarity, timing, samples = circuit.schematic.polarity, written.timing, written.timing.samples
    if samples is None:
        after = raw.time >= timing.release
        time = (raw.time[after] - timing.release) / timing.unit
        look = lambda volts: volts[after]  # noqa: E731
    else:
        time = np.concatenate([[0.0], samples[1:] / timing.unit])
        look = lambda volts: np.interp(samples, raw.time, volts)  # noqa: E731
    nodes = {
        place: polarity[place[0]] * look(np.real(raw[node]))
        for place, node in written.signals.items()
    }
    return time, nodes


def _states(circuit: Circuit, nodes: dict[tuple[str, int], np.ndarray], count: int) -> np.ndarray:
    """(T, n): q, u, t as they are; mu = m - rho c, with c from the others."""
    network, scaling = circuit.schematic.network, circuit.scaling
    values = np.repeat(network.unpack(np.zeros(network.size))[None], count, axis=0)
    for (name, stage), volts in nodes.items():
        if name in network.neuron_index:
            values[:, network.neuron_index[name], stage] = scaling.value(name, volts)
    rows, program = network.node_index, evaluator(network)
    known = program.values(network.pack(values))[..., 1:-1]
    for part in circuit.schematic.parts:
        dual = getattr(part, "dual", None)
        for stage in range(network.stages):
            if dual is not None and (part.name, stage) in nodes:
                given = scaling.value(part.name, nodes[part.name, stage])
                proportional = known[:, rows[part.name], stage]  # m with mu at zero: rho c
                values[:, network.neuron_index[dual], stage] = given - proportional
    return network.pack(values)


def _overloads(circuit: Circuit, nodes, seconds: np.ndarray, datasheet: Datasheet):
    found = []
    for (name, stage), volts in nodes.items():
        part = circuit.schematic.by_name.get(name)
        computed = isinstance(part, (Multiplier, Generator))
        rails = datasheet.multiplier_rails if computed else datasheet.rails
        full_scale = circuit.scaling.full_scale
        limit = KNEE * rails if np.isfinite(rails) else OVERLOAD * full_scale
        sample = int(np.abs(volts).argmax())
        reached = float(np.abs(volts[sample]))
        if reached > limit:
            found.append(
                Overload(
                    node=name,
                    stage=stage,
                    time=float(seconds[sample]),
                    volts=reached,
                    limit=limit,
                )
            )
    return tuple(sorted(found, key=lambda overload: -overload.volts / overload.limit))
