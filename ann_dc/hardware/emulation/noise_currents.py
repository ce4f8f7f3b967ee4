r"""Noise of resistors, op amps and multipliers, drawn from a seed: currents into virtual grounds.

Every resistor R has a thermal current of one-sided density 4 k T / R, and every op amp a white
voltage e_a at its input. Moved to the virtual ground of a part whose resistors R_j end there, both
are currents,

.. math:: S = 4 k T \sum_j 1/R_j + e_a^2 \Bigl(\sum_j 1/R_j\Bigr)^2 ,

where the feedback resistor of an adder or an inverter is one of the R_j. That of a PI cell is not:
it has a capacitor in series, which a current of its own must not charge. Its noise, and the e_a
that a PI cell passes on to its output, are a second current across it, from its far end to the
virtual ground. The white voltage e_m at the output of a multiplier stays a voltage: it acts as an
offset there, before the multiplier's own pole, which ends its band.

Samples of variance s^2 on a grid of dt, joined by straight lines, have the one-sided density
2 s^2 dt sinc^4(f dt), so s^2 = S / (2 dt) is right for frequencies far below 1/dt; behind a pole of
time constant tau the rms is 7/30 dt/tau too small. The first sample is zero: noise begins when the
reset switches open. Netlist and emulation are fed the same samples.

Neglected are the e_a that an integrator passes on to its output beside what it integrates (it
shows above sum(1/R)/(2 pi C) only), flicker noise, the noise of function generators, the errors of
the resistors that make the noise, and kT/C of the reset switches.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np
from scipy.constants import Boltzmann

from ann_dc.errors import NetworkError, require_positive
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.hardware.schematic.elements import Adder, Integrator, Multiplier, PICell
from ann_dc.validation.checked import checked


@checked
@dataclass(frozen=True, kw_only=True)
class Noise:
    """How much noise there is.

    Attributes
    ----------
    step : float
        Seconds between samples; the noise is white up to about a fifth of 1 / step.
    temperature : float
        Of all resistors, in K.
    amplifier : float
        Input voltage noise of the op amps in V/sqrt(Hz), white.
    multiplier : float
        Of multipliers at their outputs, in V/sqrt(Hz), white.
    seed : int
        The same seed gives the same samples.

    Raises
    ------
    NetworkError
        If a number is out of its range.

    Examples
    --------
    A megaohm at room temperature, in A/sqrt(Hz):

    >>> f"{Noise(step=1e-9).thermal(1e-6) ** 0.5:.3g}"
    '1.29e-13'
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
        """The noise of resistors, and of parts as their datasheet has it.

        Parameters
        ----------
        parasitics : Parasitics
        step, temperature, seed
            Of `Noise`.

        Examples
        --------
        >>> Noise.of_parts(Parasitics(amplifier_noise=5e-9), step=1e-9).amplifier
        5e-09
        """
        return cls(
            step=step,
            temperature=temperature,
            amplifier=parasitics.amplifier_noise,
            multiplier=parasitics.multiplier_noise,
            seed=seed,
        )

    def thermal(self, conductance):
        """One-sided density 4 k T G of the thermal current of a conductance [1]_.

        Parameters
        ----------
        conductance : float or array
            G, in siemens.

        Returns
        -------
        float or array
            In A^2/Hz.

        References
        ----------
        .. [1] H. Nyquist, Thermal agitation of electric charge in conductors, Physical Review 32,
           1928, 110-113.
        """
        return 4 * Boltzmann * self.temperature * conductance


class Place(enum.Enum):
    """Where noise enters."""

    GROUND = "into the virtual ground"
    FEEDBACK = "across the feedback resistor"
    INVERTER = "into the virtual ground of the inverter"
    PRODUCT = "at the output of a multiplier"


@dataclass(frozen=True, kw_only=True, eq=False)
class Source:
    """A current of noise in every cell, or the voltage of a multiplier.

    Attributes
    ----------
    part : str
        The part with the op amp, or the multiplier.
    place : Place
        Where it enters.
    conductance : (N,) array
        Of all resistors that make it, in siemens; zero where there is none. It is as well the
        current for a volt of the op amp's noise. Of a multiplier's voltage, 1 where there is one.
    """

    part: str
    place: Place
    conductance: np.ndarray

    @property
    def name(self) -> str:
        """Its own name, and that of its random streams."""
        return f"{self.place.name.lower()}.{self.part}"

    @property
    def op_amp(self) -> str:
        """Name of the random streams of the op amp: a PI cell has one for both currents."""
        return f"not.{self.part}" if self.place is Place.INVERTER else self.part


@dataclass(frozen=True, kw_only=True, eq=False)
class Currents:
    """Samples of all noise, joined by straight lines, from the opening of the reset switches on.

    Attributes
    ----------
    step : float
        Seconds between samples.
    sources : tuple of Source
        Empty where there is no noise.
    samples : (sources, N, K + 1) array
        Amperes, volts of multipliers; the first ones are zero.
    """

    step: float
    sources: tuple[Source, ...]
    samples: np.ndarray

    @property
    def span(self) -> float:
        """Seconds from the first sample to the last."""
        return (self.samples.shape[2] - 1) * self.step

    def __getitem__(self, name: str) -> np.ndarray:
        """Samples (N, K + 1) of a source, by its name."""
        return self.samples[[source.name for source in self.sources].index(name)]


@checked
def noise_sources(circuit: Circuit) -> tuple[Source, ...]:
    """Where noise of resistors and op amps enters a circuit.

    Parameters
    ----------
    circuit : Circuit

    Returns
    -------
    tuple of Source

    Raises
    ------
    NetworkError
        If the circuit is differential.
    """
    schematic = circuit.schematic
    if schematic.differential:
        raise NetworkError(
            "noise: known for circuits of single-ended op amps only; choose a level of op amps"
        )
    found = []
    for part in schematic.parts:
        alive = schematic.alive_at(part.name)
        if isinstance(part, (Integrator, PICell, Adder)):
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
    """Where noise enters a circuit (Circuit), multipliers included; what makes none is left out.

    Raises
    ------
    NetworkError
        If the circuit is differential.
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
    """(N,) siemens of the resistors that end at a part's virtual ground from outside."""
    total = np.zeros(circuit.schematic.network.stages)
    for wire, ohms in zip(part.wires, circuit.resistors[part.name]):
        total += np.where(circuit.schematic.fed_at(wire), 1 / ohms, 0.0)
    return np.full(len(total), total.sum()) if circuit.schematic.collects(part.name) else total


@checked
def draw_noise(circuit: Circuit, noise: Noise, span: float) -> Currents:
    """Draw the noise of a circuit.

    Every source and every op amp has a random stream of its own in every cell, by its name: other
    parts, more cells, a longer span or another temperature leave its random numbers as they are.

    Parameters
    ----------
    circuit : Circuit
    noise : Noise
    span : float
        Seconds after the opening of the reset switches that the samples have to last.

    Returns
    -------
    Currents

    Raises
    ------
    NetworkError
        If the span is not positive, or the circuit is one that `noise_sources` does not know.
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
    """Samples that, joined by straight lines, have a one-sided density at low frequency.

    The unit of the samples squared a Hz is that of the density: for A, A^2/Hz.

    Parameters
    ----------
    density : float
    step : float
        Seconds between samples.
    count : int
    seed : list of int

    Returns
    -------
    (count,) array

    Examples
    --------
    The variance of independent samples is density / (2 step):

    >>> samples = white(density=2e-6, step=1e-3, count=10_000, seed=[0])
    >>> bool(abs(samples.var() / 1e-3 - 1) < 0.1)
    True
    """
    size = math.sqrt(density / (2 * step))
    return size * np.random.default_rng(seed).standard_normal(count)
