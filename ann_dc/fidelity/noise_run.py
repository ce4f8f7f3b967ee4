r"""A circuit's emulation with noise: the samples that ngspice is fed, on the circuit's equations.

A current i into the virtual ground of a part adds to what its resistors bring there. With V/S volts
for a unit of its node, p its polarity, T seconds for a unit of network time,

.. math::
    A \to A - \frac{p S}{V} \frac{T}{rate\, C}\, i \;\text{(integrator)}, \qquad
    A \to A - \frac{p S}{V} R_f\, i \;\text{(PI cell, adder, inverter)} ,

and a current across the feedback resistor of a PI cell moves its virtual ground,
e -> e + (p S / V) R_f i / (1 + Gamma), but does not reach its capacitor. Noise is thus an input of
the emulation's network, piecewise linear in time; the classical Runge-Kutta method integrates it
between samples, so that no step has a kink inside.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy import linalg

from ann_dc.analysis.blas import one_thread
from ann_dc.backends import status
from ann_dc.backends.run import Run
from ann_dc.backends.settling import Settling
from ann_dc.backends.status import OVERFLOW, Status
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.circuit.elements import Integrator
from ann_dc.hardware.emulation.emulation import GROUND, HELD, INVERTED, SUMMED, Emulation
from ann_dc.hardware.emulation.noise import (
    Currents,
    Noise,
    Place,
    Source,
    noise_sources,
)
from ann_dc.network.cell import Connection
from ann_dc.network.network import Network

REACH = 0.25
"""Largest step times the fastest rate: a step is then wrong by 1e-5 of what that mode moves."""

NOISE = "noise."
"""Before the name of a source: the input that carries its current."""


def noisy_network(
    emulation: Emulation, currents: Currents, deviations: Deviations | None = None
) -> Network:
    """The emulation's network with an input in amperes for every source of noise, at zero.

    ``deviations`` are those that the emulation was made with.
    """
    network, cell = emulation.network, emulation.network.cell
    off = deviations or {}
    inputs = {NOISE + source.name: 0.0 for source in currents.sources}
    wires = tuple(_connection(emulation, source, off) for source in currents.sources)
    return replace(
        network,
        cell=replace(cell, inputs=(*cell.inputs, *inputs), connections=(*cell.connections, *wires)),
        inputs={**network.inputs, **inputs},
    )


def _connection(emulation: Emulation, source: Source, off: Deviations) -> Connection:
    circuit = emulation.circuit
    schematic, scaling, name = circuit.schematic, circuit.scaling, source.part
    part, alias = schematic.by_name[name], schematic.alias[name]
    volt = schematic.polarity[name] * scaling.unit[name] / scaling.full_scale
    target, ohms = SUMMED + name, 0.0
    if source.place is Place.INVERTER:
        target = SUMMED + INVERTED + name
        ohms = circuit.inverter * (1 + np.asarray(off.get(f"e_n_{alias}", 0.0)))
    elif isinstance(part, Integrator):
        rate = np.where(part.rate > 0, part.rate, np.inf)
        ohms = scaling.time / (rate * circuit.capacitors[name])
    else:
        ohms = circuit.feedback[name] * (1 + np.asarray(off.get(f"rf_{alias}", 0.0)))
    if source.place is Place.FEEDBACK:
        target = GROUND + name
        ohms = ohms * _weight(emulation, SUMMED + name, target)
    weight = np.where(source.conductance > 0, -ohms * volt, 0.0)
    return Connection(source=NOISE + source.name, target=target, weight=weight)


def _weight(emulation: Emulation, source: str, target: str) -> np.ndarray:
    wires = emulation.network.cell.connections
    return np.asarray(next(w.weight for w in wires if (w.source, w.target) == (source, target)))


def run_with_noise(
    emulation: Emulation,
    currents: Currents,
    *,
    start: np.ndarray | None = None,
    deviations: Deviations | None = None,
    reach: float = REACH,
) -> Run:
    """Integrate a circuit's equations with noise, from the first sample to the last.

    Parameters
    ----------
    emulation : Emulation
    currents : Currents
        Drawn for the same components.
    start : (n,) array, optional
        State of the emulation; its network's start where none is given.
    deviations : mapping of parameter name to (N,) array, optional
        Those that the emulation was made with.
    reach : float
        Largest step times the fastest rate at the start.

    Returns
    -------
    Run
        With a state at every sample. Noise does not settle: a run that neither diverged nor left a
        domain is "not settled when the noise ended".

    Raises
    ------
    NetworkError
        If ``reach`` is not between 0 and 1.
    """
    if not 0 < reach <= 1:
        raise NetworkError(f"reach: expected a number above 0, at most 1, got {reach!r}")
    network = noisy_network(emulation, currents, deviations)
    first = network.start_state if start is None else np.array(start, float)
    unit = emulation.circuit.scaling.time
    return _Integration(network, currents, first, currents.step / unit, reach).run()


def settled_noise(emulation: Emulation, x: np.ndarray, noise: Noise) -> np.ndarray:
    """Standard deviation (n,) of every state around the settled point x (n,), for ever.

    No samples are drawn: with J the Jacobian and B S B' / 2 what the sources drive, the covariance
    P solves J P + P J' + B S B' / 2 = 0, to all frequencies.

    Raises
    ------
    NetworkError
        If the circuit is one that `noise_sources` does not know.
    """
    circuit = emulation.circuit
    sources = noise_sources(circuit)
    silent = Currents(
        step=noise.step,
        sources=sources,
        samples=np.zeros((len(sources), circuit.schematic.network.stages, 1)),
    )
    network = noisy_network(emulation, silent)
    kernel, driven = CompiledEvaluator(network), np.zeros((network.size, network.size))
    still, unit = kernel.rhs(x), 2 * circuit.scaling.time
    op_amps: dict[tuple[str, int], np.ndarray] = {}
    for source in sources:
        row = np.array([network.node_index[NOISE + source.name]])
        for stage in np.flatnonzero(source.conductance):
            kernel.set_inputs(row, MICROAMPERE * np.eye(network.stages)[stage])
            column = (kernel.rhs(x) - still) / MICROAMPERE
            siemens = float(source.conductance[stage])
            driven += np.outer(column, column) * noise.thermal(siemens) / unit
            place = source.op_amp, int(stage)
            op_amps[place] = op_amps.get(place, 0.0) + siemens * column  # one voltage, all currents
        kernel.set_inputs(row, np.zeros(network.stages))
    for column in op_amps.values():
        driven += np.outer(column, column) * noise.amplifier**2 / unit
    with one_thread():
        covariance = linalg.solve_continuous_lyapunov(evaluator(network).jacobian(x), -driven)
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


MICROAMPERE = 1e-6
"""Currents enter linearly: one of that size tells the sensitivity without rounding."""


def started_at(emulation: Emulation, x: np.ndarray) -> Circuit:
    """Components preset so that the circuit starts at a state (n,) of its emulation.

    Noise around a settled point needs no transient then.
    """
    circuit, network = emulation.circuit, emulation.network
    values = network.unpack(np.asarray(x, float))
    presets = {
        name: circuit.schematic.polarity[name]
        * circuit.scaling.volts(name, values[network.neuron_index[HELD + name]])
        for name in circuit.presets
    }
    return replace(circuit, presets=presets)


class _Integration:
    """Fourth-order Runge-Kutta steps, the same number between any two samples."""

    def __init__(
        self, network: Network, currents: Currents, x: np.ndarray, interval: float, reach: float
    ) -> None:
        self.network, self.x, self.interval = network, x, interval
        self.kernel = CompiledEvaluator(network)
        rows = [network.node_index[NOISE + source.name] for source in currents.sources]
        self.rows = np.array(rows, np.int64)
        self.samples = np.ascontiguousarray(currents.samples.transpose(2, 0, 1))  # (K + 1, ...)
        rate = self.kernel.fastest_rate(x)
        self.steps = max(math.ceil(interval * rate / reach), 1)
        self.guard = self.kernel.domain_guard(x)
        self.largest = OVERFLOW * max(float(np.abs(x).max(initial=0.0)), 1.0)

    def run(self) -> Run:
        """From sample to sample, to the last one or until the run fails."""
        states, residuals = [self.x], [self.kernel.residuals(self.x)]
        ended = None
        with np.errstate(all="ignore"):
            for before, after in zip(self.samples, self.samples[1:]):
                self._across(before, after)
                states.append(self.x)
                residuals.append(self.kernel.residuals(self.x))
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
        """From one sample to the next, between which the noise is a straight line."""
        h, x, slope = self.interval / self.steps, self.x, (after - before) / (2 * self.steps)
        for step in range(self.steps):
            self.kernel.set_inputs(self.rows, before + 2 * step * slope)
            k1 = self.kernel.rhs(x)
            self.kernel.set_inputs(self.rows, before + (2 * step + 1) * slope)
            k2 = self.kernel.rhs(x + (h / 2) * k1)
            k3 = self.kernel.rhs(x + (h / 2) * k2)
            self.kernel.set_inputs(self.rows, before + (2 * step + 2) * slope)
            k4 = self.kernel.rhs(x + h * k3)
            x = x + (h / 6) * (k1 + 2 * k2 + 2 * k3 + k4)
        self.x = x

    def _failure(self, now: float) -> Status | None:
        if not float(np.abs(self.x).max(initial=0.0)) < self.largest:
            return status.diverged(self.network, self.x, now)
        block, stage = self.kernel.outside(self.x, self.guard)
        return status.left_domain(self.network, block, stage, now) if block >= 0 else None
