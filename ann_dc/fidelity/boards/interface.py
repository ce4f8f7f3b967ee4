"""Converter interface of a circuit: quantisation of q_0, q_d and u, and its cost.

A converter of b bits over both full scales resolves a node to q = 2 S / 2^b, where S is the value
of full scale. Its codes are two's complement, from -S to S - q, and values beyond are clipped.
Inputs are rounded and the network is solved again. The error of the worst inputs is bounded by
moving every input of every cell by q / 2, each with the sign that harms most. Controls are rounded
when they are read. Converter times add to the solve: input settling before, control conversion
after.

Reset switches set the integrators at the start of a solve from separate sources. A cold start, with
all capacitors empty, does not need these sources.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.sensitivity import input_sensitivity
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory, control_error, control_values
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance, settling_of, transient_of
from ann_dc.fidelity.circuit_study import instances, settled_error, undrawn
from ann_dc.fidelity.noise_run import control_noise
from ann_dc.fidelity.prediction import CLOCKED, other_equilibrium_of, require_emulation
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.network.network import Network
from ann_dc.validation import NotNegative, Range, checked

Bits = Annotated[int, Range(words="a whole number of bits, 1 to 32", low=1, high=32)]


@checked
@dataclass(frozen=True, kw_only=True)
class Interface:
    """Converters between a circuit and its digital environment; None for exact ones.

    ``dac_bits`` and ``adc_bits`` are those of the converters of the inputs and of the controls.
    ``dac_settling`` is the time in seconds until the inputs are valid, ``adc_conversion`` that to
    read the controls.
    """

    dac_bits: Bits | None = None
    adc_bits: Bits | None = None
    dac_settling: NotNegative = 1e-6
    adc_conversion: NotNegative = 1e-6

    @property
    def seconds(self) -> float:
        """Time in seconds that the converters add to a solve."""
        inputs = 0.0 if self.dac_bits is None else self.dac_settling
        return inputs + (0.0 if self.adc_bits is None else self.adc_conversion)


@dataclass(frozen=True, kw_only=True, eq=False)
class InterfaceCost:
    """Cost of an interface; errors are control errors relative to the largest control.

    Attributes
    ----------
    rounded : mapping of input name to (N,) array
        Rounded values of every input that a DAC feeds, in the user's units.
    input_error : float
        Error due to these rounded inputs.
    worst_input_error : float
        Bound on the error for the worst rounding of inputs near these, by sensitivities.
    output_error : float
        Largest rounding error of the controls: half a step.
    error : float
        Error of these inputs and of these controls as read, with ideal parts.
    circuit_error : float
        Error of the circuit's parts with exact converters; nan if the circuit does not settle.
    noise : float
        Rms noise of the worst control; nan if unknown.
    settling_time, cold_settling_time : float
        Time in seconds until the controls stay within 0.1 %, from the initial state set by the
        switches and from empty capacitors; nan if the circuit does not settle there.
    astray : str
        Other equilibrium to which a cold start leads, as a clause; empty if there is none.
    """

    interface: Interface
    rounded: Mapping[str, np.ndarray]
    input_error: float
    worst_input_error: float
    output_error: float
    error: float
    circuit_error: float
    noise: float
    settling_time: float
    cold_settling_time: float
    other_equilibrium: str

    @property
    def total_error(self) -> float:
        """Bound on the error of converters and parts, for the worst inputs near these."""
        converters = max(self.error, self.worst_input_error + self.output_error)
        return converters + self.circuit_error

    @property
    def solve_time(self) -> float:
        """Time in seconds from digital inputs to digital controls."""
        return self.settling_time + self.interface.seconds


@checked
def interface_cost(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory, interface: Interface
) -> InterfaceCost:
    """Compute the cost of converters at the inputs and controls of a circuit.

    The level of `backend` is emulated for the settling times, with parts drawn by its seed and
    rounded to its series. `probe` is the run of the ideal network by which the circuit was scaled.
    Raises `NetworkError` if the circuit has no emulation or is clocked, or if the problem of the
    rounded inputs has no solution nearby.
    """
    built = undrawn(backend, circuit, probe)
    if backend.seed is not None:
        (built,) = instances(built, [backend.seed])
    require_emulation(built, "interface")
    if backend.level.technology.clocked:
        raise NetworkError(f"interface: no settling time is known: {CLOCKED}")
    network = circuit.schematic.network
    steps = {} if interface.dac_bits is None else _steps(circuit, interface.dac_bits)
    rounded = {
        name: offset + _rounded(np.asarray(network.inputs[name]) - offset, step, interface.dac_bits)
        for name, step in steps.items()
        for offset in [network.input_scale(name).offset]
    }
    backend.progress("rounded inputs")
    ideal = network.with_inputs(rounded)
    controls = control_values(ideal, equilibrium(ideal, probe.final))
    grain = _control_steps(circuit, interface.adc_bits)
    read = _rounded(controls, grain, interface.adc_bits)
    size = probe.control_size
    backend.progress("transient from the reset switches")
    held, _ = _settling(built, None)
    backend.progress("transient from empty capacitors")
    cold, other_equilibrium = _settling(built, np.zeros(built.moving.network.size))
    backend.progress("noise")
    return InterfaceCost(
        interface=interface,
        rounded=rounded,
        input_error=control_error(controls, probe),
        worst_input_error=float(_moved(network, probe, steps).max(initial=0.0) / size),
        output_error=float(grain.max(initial=0.0) / 2 / size),
        error=control_error(read, probe),
        circuit_error=settled_error(built),
        noise=control_noise(built),
        settling_time=held,
        cold_settling_time=cold,
        other_equilibrium=other_equilibrium,
    )


def _steps(circuit: Circuit, bits: int) -> dict[str, float]:
    """Return the DAC step by input in the user's units, over full scale of its node.

    A step is negative if the user's value falls while the node's value rises.
    """
    network, unit = circuit.schematic.network, circuit.scaling.unit
    fed = {pin.input: pin.neuron for pin in network.fixed}
    fed |= {name: neuron for neuron, name in network.left_boundary.items()}
    nodes = {name: fed.get(name, name) for name in network.cell.inputs}
    return {
        name: 2 * unit[node] / 2**bits * network.input_scale(name).factor
        for name, node in nodes.items()
        if node in unit
    }


def _control_steps(circuit: Circuit, bits: int | None) -> np.ndarray:
    """Return the ADC step (controls,) in network units; zero for an exact converter."""
    network = circuit.schematic.network
    rows = np.broadcast_to(np.arange(len(network.cell.neurons))[:, None], network.live.shape)
    names = control_values(network, network.pack(rows.astype(float))).astype(int)
    units = [circuit.scaling.unit[network.cell.neurons[row].name] for row in names]
    return np.zeros(len(units)) if bits is None else 2 * np.array(units) / 2**bits


def _rounded(values: np.ndarray, step: float | np.ndarray, bits: int | None) -> np.ndarray:
    """Return the nearest values with a converter code; unchanged if `bits` is None."""
    if bits is None:
        return values
    return step * np.clip(np.round(values / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def _moved(network: Network, probe: Trajectory, steps: Mapping[str, float]) -> np.ndarray:
    """Return a bound (controls,) on the control change by half a step of each input."""
    x = equilibrium(network, probe.final)
    slopes = input_sensitivity(network, x, control_values(network, np.arange(network.size)))
    total = np.zeros(len(probe.control_values[-1]))
    for name, step in steps.items():
        half = abs(step / network.input_scale(name).factor) / 2
        total += half * np.abs(slopes[name]).sum(axis=1)
    return total


def _settling(built: CircuitInstance, start: np.ndarray | None) -> tuple[float, str]:
    """Return the settling time (s; nan if not reached), and the other equilibrium."""
    run = transient_of(built, start=start)
    other_equilibrium = other_equilibrium_of(built, run)
    if other_equilibrium or not run.status.settled:
        return math.nan, other_equilibrium
    return settling_of(built, run), ""
