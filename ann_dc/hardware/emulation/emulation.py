"""A circuit as a network again: op amps with their poles, multipliers with their errors.

All that parts do is neurons, sums and multipliers: the result is a `Network`, which every backend
runs, whose Jacobian is the pole model of the circuit, and in which every resistor, offset and gain
is the weight of a connection. `op_amps`, `transconductors` and `multipliers` have the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import SEEPING, Circuit
from ann_dc.hardware.circuit.deviations import Deviations, checked_deviations
from ann_dc.hardware.emulation.assembly import AmplifierNodes, Assembly, Origin
from ann_dc.hardware.emulation.capacitors import released
from ann_dc.hardware.emulation.multipliers import add_generator, add_multiplier
from ann_dc.hardware.emulation.op_amps import add_grid_node, add_inverter, add_op_amp
from ann_dc.hardware.emulation.transconductors import add_transconductors
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OtaC
from ann_dc.hardware.schematic.buildable import check_metric
from ann_dc.hardware.schematic.elements import Generator, GridNode, Multiplier, PICell
from ann_dc.hardware.schematic.metric_parts import metric_values
from ann_dc.hardware.schematic.rails import check_rails
from ann_dc.hardware.schematic.shared import check_shared
from ann_dc.hints.checked import checked
from ann_dc.hints.words import such_as
from ann_dc.network.network import Network

ALL_MODES = 3000
"""Neurons of an emulation up to which all of its modes are computed: exactly, in ten seconds."""


@such_as("ann_dc.emulate(circuit, level)")
@dataclass(frozen=True, kw_only=True, eq=False)
class Emulation:
    """The network that a circuit is.

    Attributes
    ----------
    network : Network
        Its neurons carry the names of the parts; values are in the units of the ideal network.
        ``held.<part>`` is a capacitor, ``not.<part>`` an inverter, ``open.<part>`` the op amp of a
        diode neuron, ``clamps.<part>`` what clamps follow, ``ground.<part>`` a virtual ground,
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

        For all of its neurons where it has no controls.
        """
        ideal = self.circuit.schematic.network
        controls = ideal.of_population("u")
        places = ideal.places[controls] if controls.any() else ideal.places
        rows = [self.network.neuron_index[ideal.cell.neurons[neuron].name] for neuron, _ in places]
        return self.network.state_index[rows, places[:, 1]]

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


@checked
def emulate(circuit: Circuit, level: Level, deviations: Deviations | None = None) -> Emulation:
    """The network of a circuit's equations, started where reset switches hold the circuit.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What parts are like. Its tolerances are not drawn here: ``deviations`` say which part is off
        by how much.
    deviations : mapping of parameter name to (N,) array, optional
        Relative, or in volts.

    Returns
    -------
    Emulation

    Raises
    ------
    NetworkError
        If the level's circuits compute in periods of a clock, or cannot build the metric, the rails
        of a neuron, or one that all cells share.
    UnknownNameError
        If a deviation names no parameter.

    Examples
    --------
    An integrator that settles to 0.5, of op amps with a gain of only 1000:

    >>> from ann_dc import equilibrium, levels
    >>> from ann_dc.hardware.circuit import ProbeRun, circuit_of, scale
    >>> from ann_dc.hardware.schematic import schematic_of
    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> wires = [Connection(source=s, target="x", weight=w) for s, w in (("x", -1.0), ("one", 0.5))]
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=tuple(wires)))
    >>> probe = ProbeRun(states=np.array([[0.0], [0.5]]), times=np.array([0.0, 10.0]), radius=1.0)
    >>> circuit = circuit_of(schematic_of(row), scale(row, probe))
    >>> emulation = emulate(circuit, levels.macro(a0=1e3))
    >>> x = equilibrium(emulation.network, emulated_state(emulation, np.array([0.5])))
    >>> emulation.controls(x).round(4).tolist()
    [0.4991]
    """
    _check(circuit, level)
    off = checked_deviations(circuit.parameters, deviations or {})
    assembly = Assembly(circuit, level, off)
    for part in circuit.schematic.parts:
        if isinstance(part, Multiplier):
            add_multiplier(assembly, part)
        elif isinstance(part, Generator):
            add_generator(assembly, part, level.functions)
        elif isinstance(part, GridNode):
            add_grid_node(assembly, part)
        elif isinstance(level.technology, OtaC):
            add_transconductors(assembly, level.technology, part)
        else:
            add_op_amp(assembly, part)
        if part.name in circuit.schematic.inverted:
            add_inverter(assembly, part.name)
    for name, wire in circuit.schematic.plain.items():
        assembly.sum(name)
        assembly.connect(wire.source, name, wire.weight)
    emulation = Emulation(
        network=assembly.network(),
        circuit=circuit,
        origins=assembly.origins,
        slopes={name: tuple(found) for name, found in assembly.slopes.items()},
    )
    network, parasitics = emulation.network, level.datasheet.parasitics
    held = emulated_state(emulation, circuit.schematic.network.start_state)
    start = released(network, circuit, parasitics, off, held)
    return replace(emulation, network=network.with_start(start))


def _check(circuit: Circuit, level: Level) -> None:
    if level.technology.clocked:
        raise NetworkError(
            "emulation: a switched-capacitor circuit is no network in continuous time; run the "
            "recurrent layer with the same step"
        )
    check_metric(circuit.schematic.network.metric.kind, level)
    check_rails(circuit.schematic.network, level)
    check_shared(circuit.schematic.network, level)


@checked
def emulated_state(emulation: Emulation, x: np.ndarray) -> np.ndarray:
    """State of the emulation in which everything is where the ideal network has it.

    Capacitors, op amps and multipliers stand at their ideal values, the op amp of a diode neuron
    that is off where it holds its virtual ground: where reset switches hold a circuit, and where
    Newton's method starts to look for its equilibrium.

    Parameters
    ----------
    emulation : Emulation
    x : (n,) array
        State vector of the ideal network.

    Returns
    -------
    (n',) array
        State vector of the emulation.

    Examples
    --------
    >>> from ann_dc import levels
    >>> from ann_dc.hardware.circuit import ProbeRun, circuit_of, scale
    >>> from ann_dc.hardware.schematic import schematic_of
    >>> from ann_dc.network import Cell, Connection, Network, Neuron
    >>> decay = Connection(source="x", target="x", weight=-1.0)
    >>> row = Network(stages=1, cell=Cell(neurons=(Neuron(name="x"),), connections=(decay,)))
    >>> probe = ProbeRun(states=np.array([[1.0], [0.0]]), times=np.array([0.0, 10.0]), radius=1.0)
    >>> emulation = emulate(circuit_of(schematic_of(row), scale(row, probe)), levels.macro())
    >>> state = emulated_state(emulation, np.array([0.25]))
    >>> dict(zip(emulation.network.neuron_index, state.tolist()))
    {'x': 0.25, 'held.x': 0.25}
    """
    network, ideal = emulation.network, emulation.circuit.schematic.network
    x = np.asarray(x, float)
    values = dict(zip(ideal.node_index, evaluator(ideal).values(x)[..., 1:-1]))
    values |= {name: node[0] for name, node in metric_values(ideal, x[None]).items()}
    full = np.zeros(network.live.shape)
    for name, row in network.neuron_index.items():
        origin = emulation.origins[name]
        full[row] = values[origin.node] * origin.sign
    _stop(emulation, full)
    _switch_off(emulation, full)
    return network.pack(full)


def _stop(emulation: Emulation, full: np.ndarray) -> None:
    """Capacitors of neurons that stand at a rail, to where clamps keep them; in place."""
    network, ideal = emulation.network, emulation.circuit.schematic.network
    for neuron in ideal.cell.neurons:
        held = network.neuron_index.get(AmplifierNodes(neuron.name).held)
        if held is not None:
            built, values = network.cell.neurons[held].limiter, full[held]
            low, high = neuron.limiter.low, neuron.limiter.high
            values = np.where((values <= low) & np.isfinite(built.low), built.low, values)
            full[held] = np.where((values >= high) & np.isfinite(built.high), built.high, values)


def _switch_off(emulation: Emulation, full: np.ndarray) -> None:
    """Op amps of diode neurons that are off, to where they hold their virtual grounds; in place."""
    network, circuit = emulation.network, emulation.circuit
    nodes = evaluator(network).values(network.pack(full))[..., 1:-1]
    for part in circuit.schematic.parts:
        if isinstance(part, PICell) and part.rectified:
            op_amp = network.neuron_index[AmplifierNodes(part.name, rectified=True).output]
            ground = nodes[network.node_index[AmplifierNodes(part.name).ground]]
            ground = ground + _caught_up(emulation, part.name, nodes, full)
            beyond = (SEEPING - 1.0) * circuit.crossing(part) - ground
            off = np.minimum(np.maximum(-ground / SEEPING, beyond), 0.0)
            full[op_amp] = np.where(full[op_amp] > 0, full[op_amp], off)


def _caught_up(
    emulation: Emulation, part: str, nodes: np.ndarray, full: np.ndarray
) -> np.ndarray | float:
    """What the ground of a diode neuron lags behind by; in place, it does so no more."""
    network, names = emulation.network, AmplifierNodes(part)
    if names.lagging not in network.neuron_index:
        return 0.0
    ends = (names.lagging, names.lagging)
    wires = network.cell.connections
    conductance = next(-wire.weight for wire in wires if (wire.source, wire.target) == ends)
    output, held, summed = (
        nodes[network.node_index[name]] for name in (names.output, names.held, names.summed)
    )
    behind = (output - held - summed) / np.where(conductance > 0, conductance, np.inf)
    full[network.neuron_index[names.lagging]] = behind
    return behind


@checked
def pole_spectrum(emulation: Emulation, x: np.ndarray) -> Spectrum:
    """Eigenvalues of the pole model where the ideal network stands at a state.

    Parameters
    ----------
    emulation : Emulation
    x : (n,) array
        State vector of the ideal network.

    Returns
    -------
    Spectrum
        In units of 1 / network time.
    """
    return modes_at(emulation, emulated_state(emulation, x))


def modes_at(emulation: Emulation, x: np.ndarray) -> Spectrum:
    """Eigenvalues of the pole model at one of its own states: up to `ALL_MODES` neurons all.

    Parameters
    ----------
    emulation : Emulation
    x : (n,) array
        State vector of the emulation.

    Returns
    -------
    Spectrum
        In units of 1 / network time.
    """
    return spectrum(emulation.network, x, dense=ALL_MODES)
