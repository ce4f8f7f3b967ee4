"""Construction of circuit emulations, part by part, with ideal or moving clamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ann_dc.dataclass_pickling import cached_on
from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations, checked_deviations
from ann_dc.hardware.emulation.assembly import Piece, assembled
from ann_dc.hardware.emulation.built_circuit import BuiltCircuit
from ann_dc.hardware.emulation.clamps import rest_idle
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.multipliers import generator, multiplier
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.emulation.op_amps import amplifier, grid_node, inverter, released
from ann_dc.hardware.emulation.states import emulated_state
from ann_dc.hardware.emulation.transconductors import transconductors
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.parts.technologies import OtaC
from ann_dc.hardware.schematic.buildable import check_buildable
from ann_dc.hardware.schematic.elements import Generator, GridNode, Multiplier, Part
from ann_dc.network.network import Network
from ann_dc.validation import checked


@checked
def emulate(circuit: Circuit, level: Level, deviations: Deviations | None = None) -> Emulation:
    """Return the network of a circuit's equations.

    The network starts at the state set by the reset switches. Clamps at saturation limits are ideal
    limiters, as they are at rest. The emulation without deviations is cached as long as the circuit
    exists.

    Parameters
    ----------
    circuit : Circuit
        Circuit to emulate.
    level : Level
        Model level of the parts. Its tolerances are not drawn here; ``deviations`` contains the
        errors of the parts.
    deviations : mapping of parameter name to (N,) array, optional
        Deviations, relative or in volts; none by default.

    Returns
    -------
    Emulation
        Emulation of the circuit.

    Raises
    ------
    NetworkError
        If inputs change over time, or circuits of the level are clocked, or cannot realise the
        preconditioner, the limits of a neuron or a shared neuron.
    UnknownNameError
        If a deviation has an unknown parameter name.

    Examples
    --------
    An integrator that settles to 0.5, of op amps with a gain of only 1000:

    >>> import numpy as np
    >>> from ann_dc import equilibrium, levels
    >>> from ann_dc.hardware.circuit import ProbeRun, circuit_of, scale
    >>> from ann_dc.hardware.emulation import emulated_state
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
    if deviations:
        return _emulated(circuit, level, deviations, moving=False)
    return cached_on(
        circuit, "_emulations", level, lambda: _emulated(circuit, level, {}, moving=False)
    )


@checked
def emulate_clamps(
    circuit: Circuit, level: Level, deviations: Deviations | None = None
) -> Emulation:
    """Emulate the transient of a circuit with clamps made of op amps and diodes.

    Currents of capacitors also drop a voltage across output resistances. The emulation has more
    neurons than that of `emulate` and an identical settled point, which `emulate` computes more
    easily. Raises `NetworkError` and `UnknownNameError` under the conditions of `emulate`.
    """
    return _emulated(circuit, level, deviations or {}, moving=True)


def _emulated(circuit: Circuit, level: Level, deviations: Deviations, *, moving: bool) -> Emulation:
    _check(circuit, level)
    off = checked_deviations(circuit.parameters, deviations)
    emulation = assembled(circuit, _pieces(BuiltCircuit(circuit, level, off, moving)))
    network, parasitics = emulation.network, level.datasheet.parasitics
    held = emulated_state(emulation, circuit.schematic.network.start_state)
    if moving:
        held = rest_idle(network, circuit, level.datasheet, held)
        held = _trail(network, circuit, held)
    start = released(network, circuit, parasitics, off, held)
    return replace(emulation, network=network.with_start(start))


def _pieces(built: BuiltCircuit) -> Iterator[tuple[str, Iterator[Piece]]]:
    """Yield every part with its pieces; an inverter belongs to the part before it."""
    for part in built.schematic.parts:
        yield part.name, _of_part(built, part)
        if part.name in built.schematic.inverted:
            yield part.name, inverter(built, part.name)


def _of_part(built: BuiltCircuit, part: Part) -> Iterator[Piece]:
    technology = built.level.technology
    if isinstance(part, Multiplier):
        return multiplier(built, part)
    if isinstance(part, Generator):
        return generator(built, part)
    if isinstance(part, GridNode):
        return grid_node(built, part)
    if isinstance(technology, OtaC):
        return transconductors(built, technology, part)
    return amplifier(built, part)


def _trail(network: Network, circuit: Circuit, x: np.ndarray) -> np.ndarray:
    """Return a state whose trailing currents equal those of their capacitors."""
    full, values = network.unpack(x).copy(), evaluator(network).values(x)[..., 1:-1]
    for nodes in map(AmplifierNodes, circuit.schematic.by_name):
        if nodes.trailing in network.neuron_index:
            full[network.neuron_index[nodes.trailing]] = values[network.node_index[nodes.summed]]
    return network.pack(full)


def _check(circuit: Circuit, level: Level) -> None:
    if level.technology.clocked:
        raise NetworkError(
            "emulation: a switched-capacitor circuit is not a network in continuous time; use "
            "the recurrent layer with the same step"
        )
    network = circuit.schematic.network
    if network.waveforms:
        raise NetworkError(
            f"emulation: inputs {', '.join(network.waveforms)} change over time; emulate the "
            "circuit of the network at a time, network.at_time(0.0)"
        )
    check_buildable(network, level)
