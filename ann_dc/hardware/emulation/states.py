"""States of an emulation that correspond to ideal network states, and their modes."""

from __future__ import annotations

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.dataclass_pickling import cached_on
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import SEEPING
from ann_dc.hardware.emulation.emulation import Emulation, paced_at
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.schematic.preconditioner_wiring import preconditioner_values
from ann_dc.validation import checked

ALL_MODES = 3000
"""Largest number of neurons for which all modes are computed: exactly, in ten seconds."""


@checked
def emulated_state(emulation: Emulation, x: np.ndarray) -> np.ndarray:
    """Return the emulation state that corresponds to a state of the ideal network.

    Capacitors, op amps and multipliers have their ideal values. The op amp of an inactive
    rectifying multiplier neuron has the value that maintains its virtual ground. Reset switches
    bring a circuit to this state, and Newton's method for the equilibrium starts from it.

    Parameters
    ----------
    emulation : Emulation
        Emulation of a circuit.
    x : (n,) array
        State vector of the ideal network.

    Returns
    -------
    (n',) array
        State vector of the emulation.

    Examples
    --------
    >>> from ann_dc import emulate, levels
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
    values |= {name: node[0] for name, node in preconditioner_values(ideal, x[None]).items()}
    full = np.zeros(network.live.shape)
    for name, row in network.neuron_index.items():
        origin = emulation.origins[name]
        full[row] = values[origin.node] * origin.sign
    _stop(emulation, full)
    _switch_off(emulation, full)
    return network.pack(full)


def _stop(emulation: Emulation, full: np.ndarray) -> None:
    """Move capacitors of saturated neurons, in place, to the clamped values."""
    network, ideal = emulation.network, emulation.circuit.schematic.network
    for neuron in ideal.cell.neurons:
        held = network.neuron_index.get(AmplifierNodes(neuron.name).held)
        if held is not None:
            built, values = network.cell.neurons[held].limiter, full[held]
            low, high = neuron.limiter.low, neuron.limiter.high
            values = np.where((values <= low) & np.isfinite(built.low), built.low, values)
            full[held] = np.where((values >= high) & np.isfinite(built.high), built.high, values)


def _switch_off(emulation: Emulation, full: np.ndarray) -> None:
    """Move op amps of inactive rectifying neurons, in place, to hold their grounds."""
    network, circuit = emulation.network, emulation.circuit
    nodes = evaluator(network).values(network.pack(full))[..., 1:-1]
    for part in circuit.schematic.rectified:
        op_amp = network.neuron_index[AmplifierNodes(part.name, rectified=True).output]
        ground = nodes[network.node_index[AmplifierNodes(part.name).ground]]
        ground = ground + _caught_up(emulation, part.name, nodes, full)
        beyond = (SEEPING - 1.0) * circuit.crossing(part) - ground
        off = np.minimum(np.maximum(-ground / SEEPING, beyond), 0.0)
        full[op_amp] = np.where(full[op_amp] > 0, full[op_amp], off)


def _caught_up(
    emulation: Emulation, part: str, nodes: np.ndarray, full: np.ndarray
) -> np.ndarray | float:
    """Remove the lag of the ground of a rectifying neuron in place and return the lag."""
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


def modes_at(emulation: Emulation, x: np.ndarray) -> Spectrum:
    """Return the eigenvalues of the pole model at a state ``x`` (n,) of the emulation.

    All are computed for up to `ALL_MODES` neurons. The unit is 1 / network time.
    """
    return spectrum(paced_at(emulation, x), x, dense=ALL_MODES)


@checked
def pole_spectrum(emulation: Emulation, x: np.ndarray) -> Spectrum:
    """Return the pole-model eigenvalues (1 / network time) at an ideal state ``x``.

    They are cached for every state as long as the emulation exists.
    """
    key = np.asarray(x, float).tobytes()
    return cached_on(
        emulation, "_pole_spectra", key, lambda: modes_at(emulation, emulated_state(emulation, x))
    )


@checked
def settled_state(emulation: Emulation, x: np.ndarray) -> np.ndarray:
    """Return the equilibrium (n',) of an emulation near an ideal state ``x``.

    It is cached for every state as long as the emulation exists. Raises `NetworkError` if there is
    no equilibrium near that state.
    """

    def settled() -> np.ndarray:
        found = equilibrium(emulation.network, emulated_state(emulation, x))
        found.setflags(write=False)
        return found

    return cached_on(emulation, "_settled_states", np.asarray(x, float).tobytes(), settled)
