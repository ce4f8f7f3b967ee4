"""Noise in a circuit's emulation: integration of noise samples, and covariances.

The emulation is driven by the samples that ngspice receives. Noise is an input of the emulation's
network (`ann_dc.hardware.emulation.noise_currents`), piecewise linear in time. The classical
Runge-Kutta method integrates between samples, so that a step does not contain a kink.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import linalg

from ann_dc.backends import status
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import OVERFLOW, Status
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.interpreted import InterpretedEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.emulation.noise_currents import (
    Currents,
    Noise,
    Place,
    noise_input,
    noisy_network,
    sources_of,
)
from ann_dc.network.network import Network
from ann_dc.validation import checked

LARGEST = 1000
"""Largest number of emulation neurons whose noise is computed by default."""

REACH = 0.25
"""Largest step times the fastest rate; the step error is then 1e-5 of that mode's move."""


@checked
def run_with_noise(
    emulation: Emulation,
    currents: Currents,
    *,
    start: np.ndarray | None = None,
    deviations: Deviations | None = None,
    reach: float = REACH,
) -> Run:
    """Integrate a circuit's equations with noise, from the first sample to the last.

    `currents` are in amperes and drawn for the components of the emulation. `start` (n,) is a state
    in the units of the emulation's network; default: the network's initial guess. `deviations` are
    those of the emulation. `reach` is the largest step times the fastest rate at the start.

    The run has a state at every sample. Noise does not settle: a run that neither diverged nor left
    a domain is "not settled when the noise ended". Raises `NetworkError` if ``reach`` is not
    between 0 and 1.
    """
    if not 0 < reach <= 1:
        raise NetworkError(f"reach: expected a number above 0, at most 1, got {reach!r}")
    network = noisy_network(emulation, currents, deviations)
    first = network.start_state if start is None else np.array(start, float)
    unit = emulation.circuit.scaling.time
    return _Integration(network, currents, first, currents.step / unit, reach).run()


@checked
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
    """Add rms noise to an error or an array of errors; unknown noise (nan) is ignored.

    >>> float(noisy(0.003, 0.004)), float(noisy(0.003, math.nan))
    (0.005, 0.003)
    """
    return np.hypot(error, np.nan_to_num(noise))


@checked
def settled_noise(emulation: Emulation, x: np.ndarray, noise: Noise) -> np.ndarray:
    """Return the stationary standard deviation (n,) of every state around x (n,).

    The settled point `x` and the result are in the units of the emulation's network. Samples are
    not drawn. The covariance P solves J P + P J' + B S B' / 2 = 0, with J the Jacobian and B S B' /
    2 the source term. All frequencies are included. `noise` gives the temperature and the voltage
    noise of op amps and multipliers. Raises `NetworkError` if the circuit is unknown to
    `noise_sources`.

    Examples
    --------
    Thermal noise is proportional to the root of the temperature:

    >>> from ann_dc.fidelity import CircuitInstance, settled_noise
    >>> from ann_dc.hardware.emulation import Noise
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> nominal = CircuitInstance(circuit=circuit, level=level, probe=probe)
    >>> cold, warm = (
    ...     settled_noise(nominal.emulation, nominal.settled, Noise(step=1.0, temperature=kelvin))
    ...     for kelvin in (75.0, 300.0)
    ... )
    >>> round(float(warm.max() / cold.max()), 6)
    2.0
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


@checked
def started_at(emulation: Emulation, x: np.ndarray) -> Circuit:
    """Return the circuit preset to start at a state (n,) of its emulation.

    The state is in the units of the emulation's network. Noise around a settled point then needs no
    transient.
    """
    circuit, network = emulation.circuit, emulation.network
    values = network.unpack(np.asarray(x, float))
    presets = {
        name: circuit.schematic.polarity[name]
        * circuit.scaling.volts(name, values[network.neuron_index[AmplifierNodes(name).held]])
        for name in circuit.presets
    }
    return replace(circuit, presets=presets)


class _Integration:
    """Fourth-order Runge-Kutta integration with equal steps between samples."""

    def __init__(
        self, network: Network, currents: Currents, x: np.ndarray, interval: float, reach: float
    ) -> None:
        self.network, self.x, self.interval = network, x, interval
        self.compiled = InterpretedEvaluator(network)
        rows = [network.node_index[noise_input(source)] for source in currents.sources]
        self.rows = np.array(rows, np.int64)
        self.samples = np.ascontiguousarray(currents.samples.transpose(2, 0, 1))  # (K + 1, ...)
        rate = self.compiled.fastest_rate(x)
        self.steps = max(math.ceil(interval * rate / reach), 1)
        self.guard = self.compiled.domain_guard(x)
        self.largest = OVERFLOW * max(float(np.abs(x).max(initial=0.0)), 1.0)

    def run(self) -> Run:
        """Integrate from sample to sample, to the last sample or until the run fails."""
        states, residuals = [self.x], [self.compiled.residuals(self.x)]
        ended = None
        with np.errstate(all="ignore"):
            for before, after in zip(self.samples, self.samples[1:]):
                self._across(before, after)
                states.append(self.x)
                residuals.append(self.compiled.residuals(self.x))
                ended = self._failure(self.interval * (len(states) - 1))
                if ended is not None:
                    break
        time = self.interval * np.arange(len(states))
        if ended is None:
            ended = status.not_settled(residuals[-1], float(time[-1]), "the noise ended")
        steps = self.steps * (len(states) - 1)
        return Run(
            trajectory=Trajectory(
                network=self.network,
                time=time,
                states=np.array(states),
                residual_time=time,
                residuals=np.array(residuals),
            ),
            status=ended,
            tolerance=Settling().tolerance,
            settling_time=float("nan"),
            verified="noise does not settle",
            steps=steps,
            evaluations=4 * steps,
        )

    def _across(self, before: np.ndarray, after: np.ndarray) -> None:
        h, x, slope = self.interval / self.steps, self.x, (after - before) / (2 * self.steps)
        for step in range(self.steps):
            self.compiled.set_inputs(self.rows, before + 2 * step * slope)
            k1 = self.compiled.rhs(x)
            self.compiled.set_inputs(self.rows, before + (2 * step + 1) * slope)
            k2 = self.compiled.rhs(x + (h / 2) * k1)
            k3 = self.compiled.rhs(x + (h / 2) * k2)
            self.compiled.set_inputs(self.rows, before + (2 * step + 2) * slope)
            k4 = self.compiled.rhs(x + h * k3)
            x = x + (h / 6) * (k1 + 2 * k2 + 2 * k3 + k4)
        self.x = x

    def _failure(self, now: float) -> Status | None:
        if not float(np.abs(self.x).max(initial=0.0)) < self.largest:
            return status.diverged(self.network, self.x, now)
        block, stage = self.compiled.outside(self.x, self.guard)
        return status.left_domain(self.network, block, stage, now) if block >= 0 else None
