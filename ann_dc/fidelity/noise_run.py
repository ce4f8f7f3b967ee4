"""Noise in a circuit's emulation: covariance of its states around a settled point."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from ann_dc.errors import NetworkError
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.noise_currents import (
    Currents,
    Noise,
    Place,
    noise_input,
    noisy_network,
    sources_of,
)

LARGEST = 1000
"""Largest number of emulation neurons whose noise is computed by default."""


def control_noise(instance: CircuitInstance) -> float:
    """Return the rms noise of the worst settled control, relative to the largest.

    Noise sources are resistors and parts with known noise, at the temperature of the level. The
    result is nan if unknown: for differential and clocked circuits, for circuits that do not
    settle, and for emulations of more than 1000 neurons, since the computing time grows with their
    cube.
    """
    emulation, level = instance.emulation, instance.level
    other = instance.circuit.schematic.differential or level.technology.clocked
    if other or emulation.network.size > LARGEST:
        return float("nan")
    try:
        x = instance.settled
    except NetworkError:
        return float("nan")
    parasitics, kelvin = level.datasheet.parasitics, level.conditions.kelvin
    noise = Noise.of_parts(parasitics, step=1.0, temperature=kelvin)  # no samples are drawn
    rms = emulation.controls(settled_noise(emulation, x, noise))
    size = size_of(emulation.controls(x), instance.probe.control_reach)
    return float(np.abs(rms).max() / size)


def noisy(error, noise: float):
    """Add rms noise to an error or an array of errors; unknown noise (nan) is ignored."""
    return np.hypot(error, np.nan_to_num(noise))


def settled_noise(emulation: Emulation, x: np.ndarray, noise: Noise) -> np.ndarray:
    """Return the stationary standard deviation (n,) of every state around x (n,).

    The covariance P solves J P + P J' + B S B' / 2 = 0, with J the Jacobian and B S B' / 2 the
    source term over all frequencies; samples are not drawn. Both arrays are in the units of the
    emulation's network. `noise` gives the temperature and the voltage noise of op amps and
    multipliers. Raises `NetworkError` if the circuit is unknown to `noise_sources`.
    """
    circuit = emulation.circuit
    sources = sources_of(circuit, noise)
    silent = Currents(
        step=noise.step,
        sources=sources,
        samples=np.zeros((len(sources), circuit.schematic.network.stages, 1)),
    )
    network = noisy_network(emulation, silent)
    compiled, driven = InterpretedEvaluator(network), np.zeros((network.size, network.size))
    still, unit = compiled.rhs(x), 2 * circuit.scaling.time
    op_amps: dict[tuple[str, int], np.ndarray] = {}
    for source in sources:
        row = np.array([network.node_index[noise_input(source)]])
        for stage in np.flatnonzero(source.conductance):
            compiled.set_inputs(row, SMALL * np.eye(network.stages)[stage])
            column = (compiled.rhs(x) - still) / SMALL
            if source.place is Place.PRODUCT:
                driven += np.outer(column, column) * noise.multiplier**2 / unit
                continue
            siemens = float(source.conductance[stage])
            driven += np.outer(column, column) * noise.thermal(siemens) / unit
            place = source.op_amp, int(stage)
            op_amps[place] = op_amps.get(place, 0.0) + siemens * column  # one voltage, all currents
        compiled.set_inputs(row, np.zeros(network.stages))
    for column in op_amps.values():
        driven += np.outer(column, column) * noise.amplifier**2 / unit
    free = np.flatnonzero(compiled.free(x))  # what stands at a rail stays there
    moving = np.ix_(free, free)
    covariance = linalg.solve_continuous_lyapunov(
        evaluator(network).jacobian(x)[moving], -driven[moving]
    )
    found = np.zeros(network.size)
    found[free] = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return found


SMALL = 1e-6
"""Amplitude (A or V) that gives noise weights without rounding; noise enters linearly."""
