r"""Noise of resistors, op amps and multipliers: seeded currents at virtual grounds.

Every resistor R has a thermal current of one-sided density 4 k T / R, and every op amp a white
voltage e_a at its input. At the virtual ground of a part with resistors R_j, both are currents,

.. math:: S = 4 k T \sum_j 1/R_j + e_a^2 \Bigl(\sum_j 1/R_j\Bigr)^2 ,

with the feedback resistor of an adder or an inverter among the R_j. The feedback resistor of a PI
cell is not among them, because its series capacitor must not be charged by a noise current. Its
noise, and the e_a that a PI cell passes to its output, form a second current across the resistor,
from its far end to the virtual ground. The white voltage e_m at the output of a multiplier remains
a voltage. It acts as an offset before the multiplier's pole, which limits its bandwidth.

Samples of variance s^2 at intervals dt, connected by straight lines, have the one-sided density 2
s^2 dt sinc^4(f dt). So s^2 = S / (2 dt) is correct for frequencies far below 1/dt. Behind a pole of
time constant tau the rms value is 7/30 dt/tau too small. The first sample is zero, because noise
begins when the reset switches open. Netlist and emulation use identical samples.

Not modelled are flicker noise, noise of function generators, errors of the noise-generating
resistors, and kT/C noise of the reset switches. The e_a that an integrator passes directly to its
output is also omitted; it is visible only above sum(1/R)/(2 pi C).

In the emulation's network every source is an input. A current i into the virtual ground of a part
adds to the contribution of the resistors there. With V/S volts per unit of the part's node, p its
polarity, and T seconds per unit of network time,

.. math::
    A \to A - \frac{p S}{V} \frac{T}{rate\, C}\, i \;\text{(integrator)}, \qquad
    A \to A - \frac{p S}{V} R_f\, i \;\text{(PI cell, adder, inverter)} .

A current across the feedback resistor of a PI cell moves its virtual ground and not its capacitor:
e -> e + (p S / V) R_f i / (1 + Gamma). The voltage of a multiplier acts as its output offset.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.constants import Boltzmann

from ann_dc.errors import NetworkError, require_positive
from ann_dc.hardware.circuit.circuit import Circuit, Quantity
from ann_dc.hardware.circuit.deviations import Deviations
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.nodes import AmplifierNodes
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.elements import Adder, Amplifier, Integrator, Multiplier, PICell
from ann_dc.network.cell import Connection
from ann_dc.network.network import Network
from ann_dc.validation import checked


@checked
@dataclass(frozen=True, kw_only=True)
class Noise:
    """Noise strength.

    Raises `NetworkError` if a number is out of its range.

    Attributes
    ----------
    step : float
        Seconds between samples; the noise is white up to about one fifth of 1 / step.
    temperature : float
        Temperature of all resistors in K.
    amplifier : float
        White input voltage noise of the op amps in V/sqrt(Hz).
    multiplier : float
        White output voltage noise of multipliers in V/sqrt(Hz).
    seed : int
        Equal seeds give equal samples.
    """

    step: float
    temperature: float = 300.0
    amplifier: float = 0.0
    multiplier: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        require_positive(step=self.step)
        for name in ("temperature", "amplifier", "multiplier"):
            value, unit = getattr(self, name), "K" if name == "temperature" else "V/sqrt(Hz)"
            if not 0 <= value < math.inf:
                raise NetworkError(
                    f"{name}: expected a number of {unit}, at least 0, got {value!r}"
                )
        if not (isinstance(self.seed, (int, np.integer)) and self.seed >= 0):
            raise NetworkError(f"seed: expected a whole number, at least 0, got {self.seed!r}")

    @classmethod
    def of_parts(
        cls, parasitics: Parasitics, *, step: float, temperature: float = 300.0, seed: int = 0
    ) -> Noise:
        """Return the noise of resistors, and of parts according to their datasheet.

        ``step``, ``temperature`` and ``seed`` are fields of `Noise`.
        """
        return cls(
            step=step,
            temperature=temperature,
            amplifier=parasitics.amplifier_noise,
            multiplier=parasitics.multiplier_noise,
            seed=seed,
        )

    def thermal(self, conductance):
        """Return the one-sided density 4 k T G of a conductance's thermal current [1]_.

        The conductance G is in siemens, the result in A^2/Hz.

        References
        ----------
        .. [1] H. Nyquist, Thermal agitation of electric charge in conductors, Physical Review 32,
           1928, 110-113.
        """
        return 4 * Boltzmann * self.temperature * conductance


class Place(enum.Enum):
    """Location of a noise source."""

    GROUND = "into the virtual ground"
    FEEDBACK = "across the feedback resistor"
    INVERTER = "into the virtual ground of the inverter"
    PRODUCT = "at the output of a multiplier"


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """Noise current in every cell, or noise voltage of a multiplier.

    ``conductance`` (N,) is the total of the resistors that cause the noise in siemens; zero for an
    absent source. It is also the current per volt of op-amp noise. The value for a multiplier's
    voltage is 1.
    """

    part: str
    place: Place
    conductance: np.ndarray

    @property
    def name(self) -> str:
        """Name of the source and of its random streams."""
        return f"{self.place.name.lower()}.{self.part}"

    @property
    def op_amp(self) -> str:
        """Name of the op amp's random streams: a PI cell has one name for both currents."""
        return f"not.{self.part}" if self.place is Place.INVERTER else self.part


@dataclass(frozen=True, kw_only=True, eq=False)
class Currents:
    """Linearly interpolated samples of all noise since the reset switches opened.

    ``step`` is in seconds. ``samples`` (sources, N, K + 1) are in amperes, or in volts for
    multipliers; the first ones are zero. Without noise there are no sources.
    """

    step: float
    sources: tuple[Source, ...]
    samples: np.ndarray

    @property
    def span(self) -> float:
        """Seconds from the first to the last sample."""
        return (self.samples.shape[2] - 1) * self.step

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the samples (N, K + 1) of a source by name."""
        return self.samples[[source.name for source in self.sources].index(name)]


@checked
def noise_sources(circuit: Circuit) -> tuple[Source, ...]:
    """Return the noise sources of the resistors and op amps of a circuit.

    Raises `NetworkError` if the circuit is differential.
    """
    schematic = circuit.schematic
    if schematic.differential:
        raise NetworkError(
            "noise: available for circuits of single-ended op amps only; choose a level of op amps"
        )
    found = []
    for part in schematic.parts:
        alive = schematic.alive_at(part.name)
        if isinstance(part, Amplifier):
            conductances = {Place.GROUND: _conductance(circuit, part)}
            feedback = 1 / circuit.feedback[part.name] if part.name in circuit.feedback else 0.0
            if isinstance(part, Adder):
                conductances[Place.GROUND] += feedback
            elif isinstance(part, PICell):
                conductances[Place.FEEDBACK] = np.full(len(alive), feedback)
        else:
            conductances = {}
        if part.name in schematic.inverted:
            conductances[Place.INVERTER] = np.full(len(alive), 2 / circuit.inverter)
        found += [
            Source(part=part.name, place=place, conductance=np.where(alive, conductance, 0.0))
            for place, conductance in conductances.items()
        ]
    return tuple(found)


@checked
def sources_of(circuit: Circuit, noise: Noise) -> tuple[Source, ...]:
    """Return the contributing noise sources of a circuit, multipliers included.

    Raises `NetworkError` if the circuit is differential.
    """
    schematic = circuit.schematic
    currents = noise_sources(circuit)
    multipliers = [
        Source(part=p.name, place=Place.PRODUCT, conductance=1.0 * schematic.alive_at(p.name))
        for p in schematic.parts
        if isinstance(p, Multiplier)
    ]
    heard = noise.temperature > 0 or noise.amplifier > 0
    return (*(currents if heard else ()), *(multipliers if noise.multiplier > 0 else ()))


def _conductance(circuit: Circuit, part: Integrator | PICell | Adder) -> np.ndarray:
    """Return the conductance (N,) of external resistors at a part's virtual ground."""
    total = np.zeros(circuit.schematic.network.stages)
    for wire, ohms in zip(part.wires, circuit.resistors[part.name]):
        total += np.where(circuit.schematic.fed_at(wire), 1 / ohms, 0.0)
    return np.full(len(total), total.sum()) if circuit.schematic.collects(part.name) else total


@checked
def draw_noise(circuit: Circuit, noise: Noise, span: float) -> Currents:
    """Draw the noise of a circuit.

    Every source and every op amp has a random stream in every cell, determined by its name. Other
    parts, more cells, a longer span or another temperature do not change its random numbers. The
    samples cover ``span`` seconds after the opening of the reset switches. Raises `NetworkError` if
    the span is not positive or `noise_sources` does not support the circuit.
    """
    require_positive(span=span)
    sources = sources_of(circuit, noise)
    stages, count = circuit.schematic.network.stages, math.ceil(span / noise.step * (1 - 1e-12))
    samples = np.zeros((len(sources), stages, count + 1))
    for row, source in zip(samples, sources):
        for stage in np.flatnonzero(source.conductance):
            row[stage, 1:] = _samples(noise, source, int(stage), count)
    samples.setflags(write=False)
    return Currents(step=noise.step, sources=sources, samples=samples)


def _samples(noise: Noise, source: Source, stage: int, count: int) -> np.ndarray:
    conductance = float(source.conductance[stage])
    total = np.zeros(count)
    streams = {
        f"thermal.{source.name}": noise.thermal(conductance),
        f"amplifier.{source.op_amp}": (noise.amplifier * conductance) ** 2,
    }
    if source.place is Place.PRODUCT:
        streams = {f"multiplier.{source.part}": noise.multiplier**2}
    for stream, density in streams.items():
        if density > 0:
            total += white(density, noise.step, count, [noise.seed, stage, *stream.encode()])
    return total


def white(density: float, step: float, count: int, seed: list[int]) -> np.ndarray:
    """Return (count,) samples whose linear interpolation has a low-frequency density.

    The density is one-sided, and ``step`` is the number of seconds between samples. The square of
    the samples' unit per Hz is the unit of the density: for A, A^2/Hz.
    """
    size = math.sqrt(density / (2 * step))
    return size * np.random.default_rng(seed).standard_normal(count)


def noise_input(source: Source) -> str:
    """Return the input name of a source, which carries amperes, or volts."""
    return f"noise.{source.name}"


@checked
def noisy_network(
    emulation: Emulation, currents: Currents, deviations: Deviations | None = None
) -> Network:
    """Return the emulation's network with an input per noise source, initially zero.

    Inputs are in amperes or volts. The samples of ``currents`` are not used. ``deviations`` are
    those with which the emulation was made.
    """
    network, cell = emulation.network, emulation.network.cell
    off = deviations or {}
    inputs = {noise_input(source): 0.0 for source in currents.sources}
    wires = tuple(_connection(emulation, source, off) for source in currents.sources)
    return replace(
        network,
        cell=replace(cell, inputs=(*cell.inputs, *inputs), connections=(*cell.connections, *wires)),
        inputs={**network.inputs, **inputs},
    )


def _connection(emulation: Emulation, source: Source, off: Deviations) -> Connection:
    if source.place is Place.PRODUCT:
        return _as_offset(emulation, source)
    nodes = AmplifierNodes(source.part, inverter=source.place is Place.INVERTER)
    part, ohms = emulation.circuit.schematic.by_name[source.part], _ohms(emulation, source, off)
    own = isinstance(part, Integrator) and source.place is Place.GROUND
    target = nodes.held if own else nodes.summed
    if source.place is Place.FEEDBACK:
        (wire,) = (
            wire
            for wire in emulation.network.cell.connections
            if wire.source == nodes.summed and wire.target in (nodes.ground, nodes.lagging)
        )
        target, ohms = wire.target, ohms * np.asarray(wire.weight)
    volt = emulation.circuit.value_of(source.part)
    weight = np.where(source.conductance > 0, -ohms * volt, 0.0)
    return Connection(source=noise_input(source), target=target, weight=weight)


def _as_offset(emulation: Emulation, source: Source) -> Connection:
    """Return the connection of one volt at a multiplier's output, like its offset."""
    name = emulation.circuit.parameter_name(source.part, Quantity.OFFSET_Z)
    ((offset, slope),) = emulation.slopes[name]
    target = next(wire.target for wire in emulation.network.cell.connections if wire.name == offset)
    weight = np.where(source.conductance > 0, slope, 0.0)
    return Connection(source=noise_input(source), target=target, weight=weight)


def _ohms(emulation: Emulation, source: Source, off: Deviations) -> np.ndarray:
    """Return volts at the output per ampere (integrator: per unit of network time)."""
    circuit, name = emulation.circuit, source.part
    part = circuit.schematic.by_name[name]
    if source.place is Place.INVERTER:
        return circuit.inverter * (1 + _deviation(emulation, off, name, Quantity.INVERTER))
    if isinstance(part, Integrator):
        rate = np.where(part.rate > 0, part.rate, np.inf)
        return circuit.scaling.time / (rate * circuit.capacitors[name])
    return circuit.feedback[name] * (1 + _deviation(emulation, off, name, Quantity.FEEDBACK))


def _deviation(emulation: Emulation, off: Deviations, part: str, quantity: Quantity) -> np.ndarray:
    return np.asarray(off.get(emulation.circuit.parameter_name(part, quantity), 0.0))
