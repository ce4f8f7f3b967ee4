"""Circuit of a network at a model level: the source of all its netlists.

A circuit is built once per network, level and resistor series, and is cached with the network. The
probe run that scales a circuit takes longer than writing any of the formats.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, NamedTuple, TypeAlias

import numpy as np

from ann_dc.backends.settling import settles
from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.netlist.deck import Deck
from ann_dc.backends.trajectory import Trajectory
from ann_dc.conversion import KEPT
from ann_dc.dataclass_pickling import cached_on
from ann_dc.errors import ExportError, NetworkError, UnknownNameError
from ann_dc.fidelity.circuit_instance import CircuitInstance, transient_of
from ann_dc.fidelity.circuit_study import NEAR, undrawn
from ann_dc.fidelity.fitting import fitting_intervals, fitting_margin
from ann_dc.fidelity.prediction import LARGEST, clipped_at, clipping_of, other_equilibrium_of
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import rounded_to_series
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.e_series import E96_PAIRS, SERIES, Series
from ann_dc.hardware.parts.level_words import level_words
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.buildable import clamped_full_scale
from ann_dc.hardware.sizing.bandwidth_margin import cure
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.scale import Scale

WORDS = {name.replace(" ", "-").lower(): series for name, series in SERIES.items()}
"""Resistor series by their command-line names."""

MOST_STEPS = 3000
"""Maximum steps of the transient check before files are written; divergence occurs early."""


LevelOrName: TypeAlias = Annotated[str | Level, KEPT]
"""Level, or its name, which a network may have to complete (`level_of`)."""


class Reading(NamedTuple):
    """Neuron at a stage, its node, and the scale from the node's voltage to the user's units."""

    name: str
    stage: int
    node: str
    scale: Scale


@dataclass(frozen=True, kw_only=True, eq=False)
class Build:
    """Network as a circuit, with the netlist for ngspice and a run of the ideal network.

    In `network`, inequality rows replace saturation limits of ``given`` that a preconditioner
    couples. The deck has resistors and capacitors of the series. ``control_error`` is the predicted
    error of the settled controls with the written nominal parts, relative to the size of the
    controls (`size_of`); nan if the level has no emulation. ``doubt`` has the reasons, from the
    emulation, why the circuit may not settle near the optimum, if any.
    """

    level: Level
    series: Series
    given: Network
    circuit: Circuit
    probe: Trajectory
    deck: Deck
    control_error: float = np.nan
    doubt: str = ""

    @property
    def network(self) -> Network:
        """Network that the circuit represents."""
        return self.circuit.schematic.network

    @cached_property
    def readings(self) -> tuple[Reading, ...]:
        """Readings of all live neurons with a node, by stage."""
        return self._readings(np.ones(self.network.size, bool))

    @cached_property
    def controls(self) -> tuple[Reading, ...]:
        """Live controls by stage; all neurons if the network is not an optimiser."""
        return self._readings(self.network.of_population("u")) or self.readings

    def _readings(self, wanted: np.ndarray) -> tuple[Reading, ...]:
        names, signals = [*self.network.neuron_index], self.deck.signals
        places = ((names[i], int(k)) for i, k in self.network.places[wanted])
        return tuple(
            Reading(name, stage, signals[name, stage], self.circuit.scale_of(name))
            for name, stage in places
            if (name, stage) in signals
        )

    @cached_property
    def settles(self) -> bool:
        """True if the ideal network settles; otherwise its run has a given duration."""
        return settles(self.probe)

    def final(self, reading: Reading) -> float:
        """Return the value of a neuron at the end of the ideal run, in the user's units."""
        row = self.network.neuron_index[reading.name]
        scale = self.network.cell.neurons[row].scale
        return float(scale.user(self._end[row, reading.stage]))

    @cached_property
    def _end(self) -> np.ndarray:
        """Final states (neurons, N) of the probe run."""
        return self.network.unpack(self.probe.final)


def build(
    network: Network,
    level: LevelOrName,
    series: str = "exact",
    duration: float | None = None,
) -> Build:
    """Build a network as a circuit at a model level, for a run until settled or of a duration.

    Repeated calls return the same object. A level is a `Level`, or a name of
    `ann_dc.hardware.parts.level_words`. The resistor series are ``exact``, ``E12``, ``E24``,
    ``E96``, ``E24-pairs`` and ``E96-pairs``. Raises `UnknownNameError` for others, and
    `ExportError` with the reason if the network cannot be built at the level.
    """
    if series.lower() not in WORDS:
        raise UnknownNameError.of("series", series, [s.replace(" ", "-") for s in SERIES])
    word = level.lower() if isinstance(level, str) else level
    key = word, series.lower(), duration
    made = WORDS[series.lower()]
    return cached_on(network, "_builds", key, lambda: _built(network, level, made, duration))


def _built(network: Network, level: LevelOrName, series: Series, duration: float | None) -> Build:
    try:
        made = level_of(network, level)
        backend = SpiceBackend(level=made, series=series, duration=duration)
        instance, doubts, error = undrawn(backend, *backend.prepare(network)), [], np.nan
        rests = settles(instance.probe)
        if made.emulated and rests:
            instance = _without_ringing(backend, instance, network)
            doubts += _lost(instance)
        if rests:
            error = _control_error(instance)
            doubts += _coarse(instance, error)
        circuit, probe = instance.circuit, instance.probe
        deck = backend.deck(circuit, probe, instance.deviations)
    except NetworkError as error:
        raise ExportError(f"level {name_of(level)}: {error}") from error
    for doubt in doubts:
        warnings.warn(f"level {made.name}: circuit: {doubt}", UserWarning, stacklevel=2)
    return Build(
        level=made,
        series=series,
        given=network,
        circuit=circuit,
        probe=probe,
        deck=deck,
        control_error=error,
        doubt="; ".join(doubts),
    )


def _without_ringing(
    backend: SpiceBackend, instance: CircuitInstance, network: Network
) -> CircuitInstance:
    """Return a circuit with op amps fast enough to avoid ringing.

    Preconditioners other than the diagonal one always need more than the usual bandwidth.
    """
    usual = network.preconditioner.kind is PreconditionerKind.DIAGONAL
    if usual and pole_spectrum(instance.emulation, instance.probe.final).abscissa < 0:
        return instance
    if not usual:
        backend = replace(backend, intervals=fitting_intervals(backend, network))
        instance = undrawn(backend, *backend.prepare(network))
    bandwidth_margin = _margin(instance.circuit, instance.level, instance.probe)
    backend = replace(backend, bandwidth_margin=bandwidth_margin)
    instance = undrawn(backend, *backend.prepare(network))
    backend.check_stable(instance.emulation, instance.probe)
    return instance


def _lost(instance: CircuitInstance) -> list[str]:
    """Return reasons why a stable circuit may not settle correctly.

    They become warnings, because an emulation does not model parts beyond a function's domain.
    """
    if instance.emulation.network.size > LARGEST:
        return []
    if clipped_at(instance.emulation, instance.settled).any():
        return [clipping_of(instance, instance.emulation, instance.settled).sentence]
    if other_equilibrium := other_equilibrium_of(instance, transient_of(instance, MOST_STEPS)):
        return [
            f"it may settle at another equilibrium: emulated from reset, {other_equilibrium}; "
            "design the network with another preconditioner, such as "
            "PreconditionerKind.MULTILEVEL"
        ]
    return []


def _control_error(instance: CircuitInstance) -> float:
    """Return the predicted error of the settled controls; nan without an emulation."""
    try:
        return instance.control_error
    except NetworkError:
        return np.nan


def _coarse(instance: CircuitInstance, error: float) -> list[str]:
    """Return a warning if the controls settle too far from the optimum, with a remedy."""
    if not error > NEAR:
        return []
    size = instance.probe.size_in_words
    reported = f"its controls are predicted to be {error:.1%} of {size} off, above {NEAR:.0%}"
    pairs = replace(instance, deviations=rounded_to_series(instance.circuit, E96_PAIRS))
    better = _control_error(pairs) if instance.deviations else np.nan
    if better < NEAR:
        return [
            f"{reported}, because of the series of its resistors; series=E96-pairs: {better:.1e}"
        ]
    return [
        f"{reported}; use better parts, or a slower network (ann-dc circuit prints the "
        "error budget)"
    ]


def _margin(circuit: Circuit, level: Level, probe: Trajectory) -> float:
    """Return the required bandwidth margin of the op amps over the network."""
    bandwidth_margin = fitting_margin(circuit, level, probe)
    if not np.isfinite(bandwidth_margin):
        means = cure(circuit, level, probe.final)
        if circuit.schematic.network.preconditioner.kind is not PreconditionerKind.DIAGONAL:
            means += ", or design the network with another preconditioner"
        raise NetworkError(f"circuit: {means}")
    return bandwidth_margin


def name_of(level: LevelOrName) -> str:
    """Return the name of a level for messages."""
    return level if isinstance(level, str) else level.name


def level_of(network: Network, level: LevelOrName) -> Level:
    """Return the level with a given name; its full scale is at most 1 V for saturation limits.

    A `Level` keeps its full scale. Raises `UnknownNameError` with the available levels.
    """
    if isinstance(level, Level):
        return level
    words = level_words()
    if level.lower() not in words:
        raise UnknownNameError.of("level", level, words)
    return clamped_full_scale(network, words[level.lower()].made(network))
