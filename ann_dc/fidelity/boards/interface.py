r"""How q_0 and q_d come in and u goes out: converters as defects with a stated cost.

A converter of b bits over both full scales knows values of a node to q = 2 S / 2^b, S being what
full scale stands for; its codes are those of two's complement, -S to S - q, and what is beyond is
clipped. Inputs are rounded, and the network solved again; what the worst inputs would cost is
bounded by moving every one of every cell by q / 2, each with the sign that harms most. Controls are
rounded when they are read. Converters take time: that of the inputs before a solve, that of the
controls after it.

Reset switches hold integrators at the start of a solve by sources of their own; a cold start, all
capacitors empty, needs none of them.
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
from ann_dc.fidelity.circuit_instance import Specimen, settling_of, transient_of
from ann_dc.fidelity.circuit_study import settled_error, specimens, undrawn
from ann_dc.fidelity.noise_run import control_noise
from ann_dc.fidelity.prediction import CLOCKED, astray_of, not_emulated
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import NotNegative, Range

Bits = Annotated[int, Range(words="a whole number of bits, 1 to 32", low=1, high=32)]


@checked
@dataclass(frozen=True, kw_only=True)
class Interface:
    """Converters between a circuit and the numbers around it; None for exact ones.

    Attributes
    ----------
    dac_bits, adc_bits : int or None
        Of the inputs and of the controls.
    dac_settling, adc_conversion : float
        Seconds until inputs stand, and that it takes to read the controls.

    Examples
    --------
    >>> Interface(dac_bits=12, adc_bits=10).seconds
    2e-06
    """

    dac_bits: Bits | None = None
    adc_bits: Bits | None = None
    dac_settling: NotNegative = 1e-6
    adc_conversion: NotNegative = 1e-6

    @property
    def seconds(self) -> float:
        """That converters add to a solve."""
        inputs = 0.0 if self.dac_bits is None else self.dac_settling
        return inputs + (0.0 if self.adc_bits is None else self.adc_conversion)


@dataclass(frozen=True, kw_only=True, eq=False)
class InterfaceCost:
    """What an interface costs; errors are of the controls, over the largest one.

    Attributes
    ----------
    interface : Interface
    rounded : mapping of input name to (N,) array
        What comes in instead of each input that a DAC feeds, in the user's units.
    input_error : float
        Of these rounded inputs.
    worst_input_error : float
        Bound for the worst rounding of inputs near these, by sensitivities.
    output_error : float
        Largest one of rounding the controls: half a step.
    error : float
        Of these inputs, and of these controls as they are read, by ideal parts.
    circuit_error : float
        Of the circuit's own parts, with exact converters; nan where it does not settle.
    noise : float
        Rms on the worst control; nan where it is not known.
    settling_time, cold_settling_time : float
        Seconds until the controls stay within 0.1 %, from the start where switches hold the
        circuit, and from empty capacitors; nan where it does not get there.
    astray : str
        Where a cold start leads instead, in a clause; empty where it does not.
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
    astray: str

    @property
    def total_error(self) -> float:
        """Of converters and parts together, for the worst inputs near these, at most.

        nan where the circuit does not settle.
        """
        converters = max(self.error, self.worst_input_error + self.output_error)
        return converters + self.circuit_error

    @property
    def solve_time(self) -> float:
        """Seconds from numbers to numbers."""
        return self.settling_time + self.interface.seconds


@checked
def interface_cost(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory, interface: Interface
) -> InterfaceCost:
    """What converters at the inputs and controls of a circuit cost.

    Parameters
    ----------
    backend : SpiceBackend
        Whose level is emulated, for the settling times, with parts as its seed and its series have
        them.
    circuit : Circuit
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.
    interface : Interface

    Returns
    -------
    InterfaceCost

    Raises
    ------
    NetworkError
        If the circuit has no emulation, or is a clocked one, or the problem of the rounded inputs
        has no solution near.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity.boards import Interface, interface_cost
    >>> problem = ann_dc.plants.double_integrator(N=3)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> backend = ann_dc.SpiceBackend(level=ann_dc.levels.macro())
    >>> circuit, probe = backend.prepare(network)
    >>> fine = interface_cost(backend, circuit, probe, Interface(dac_bits=16, adc_bits=16))
    >>> fine.error < 1e-3, fine.cold_settling_time < 2 * fine.settling_time
    (True, True)
    """
    built = undrawn(backend, circuit, probe)
    if backend.seed is not None:
        (built,) = specimens(built, [backend.seed])
    missing = not_emulated(built)
    if missing is not None:
        raise NetworkError(f"interface: {missing}")
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
    controls = _controls(network.with_inputs(rounded), probe)
    grain = _control_steps(circuit, interface.adc_bits)
    read = _rounded(controls, grain, interface.adc_bits)
    size = probe.control_size
    backend.progress("transient, as switches hold it")
    held, _ = _settling(built, None)
    backend.progress("transient from empty capacitors")
    cold, astray = _settling(built, np.zeros(built.moving.network.size))
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
        astray=astray,
    )


def _steps(circuit: Circuit, bits: int) -> dict[str, float]:
    """A DAC's step in the user's units, by input: over full scale of the node that it feeds.

    Negative where the user's value falls as the node's rises.
    """
    network, unit = circuit.schematic.network, circuit.scaling.unit
    fed = {pin.input: pin.neuron for pin in network.pins}
    fed |= {name: neuron for neuron, name in network.left.items()}
    nodes = {name: fed.get(name, name) for name in network.cell.inputs}
    return {
        name: 2 * unit[node] / 2**bits * network.input_scale(name).factor
        for name, node in nodes.items()
        if node in unit
    }


def _control_steps(circuit: Circuit, bits: int | None) -> np.ndarray:
    """An ADC's step (controls,) in network units; zero of an exact one."""
    network = circuit.schematic.network
    rows = np.broadcast_to(np.arange(len(network.cell.neurons))[:, None], network.live.shape)
    names = control_values(network, network.pack(rows.astype(float))).astype(int)
    units = [circuit.scaling.unit[network.cell.neurons[row].name] for row in names]
    return np.zeros(len(units)) if bits is None else 2 * np.array(units) / 2**bits


def _rounded(values: np.ndarray, step: float | np.ndarray, bits: int | None) -> np.ndarray:
    """The nearest values that a converter has a code for; as they are without one."""
    if bits is None:
        return values
    return step * np.clip(np.round(values / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


def _controls(network: Network, probe: Trajectory) -> np.ndarray:
    """Controls of the ideal network with these inputs, near where it settles with its own."""
    return control_values(network, equilibrium(network, probe.final))


def _moved(network: Network, probe: Trajectory, steps: Mapping[str, float]) -> np.ndarray:
    """How far half a step of every input of every cell moves each control (controls,), at most."""
    x = equilibrium(network, probe.final)
    slopes = input_sensitivity(network, x, control_values(network, np.arange(network.size)))
    total = np.zeros(len(probe.control_values[-1]))
    for name, step in steps.items():
        half = abs(step / network.input_scale(name).factor) / 2
        total += half * np.abs(slopes[name]).sum(axis=1)
    return total


def _settling(built: Specimen, start: np.ndarray | None) -> tuple[float, str]:
    """Seconds from a start of what moves, nan where it leads elsewhere; and where to."""
    run = transient_of(built, start=start)
    astray = astray_of(built, run)
    if astray or not run.status.settled:
        return math.nan, astray
    return settling_of(built, run), ""
