"""Network as a circuit in ngspice: scaling, netlist, simulation and read-back.

    network --prepare--> circuit, probe --deck--> netlist --ngspice--> voltages --read_back--> run

The probe is the run of the ideal network in continuous time. It determines the volts per unit of
every node, the simulation time, and the reference for the circuit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, TypeAlias

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.settling import settles
from ann_dc.backends.spice.circuit_run import (
    CircuitRun,
    check_full_scale,
    read_back,
    refined,
)
from ann_dc.backends.spice.netlist.deck import Deck, deck_of
from ann_dc.backends.spice.netlist.timing import Simulation, simulation_for
from ann_dc.backends.spice.ngspice.raw import Raw
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.spice.pdk.files import PACKAGE
from ann_dc.backends.spice.probe import fastest_rate, moments, probed, span_of, swings
from ann_dc.backends.trajectory import Trajectory
from ann_dc.conversion import OrWord, default
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.deviations import Deviations, combined, draw, rounded_to_series
from ann_dc.hardware.circuit.scaling import HEADROOM, MARGIN, ScalingRules
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.e_series import EXACT, Series
from ann_dc.hardware.parts.foundry import passive
from ann_dc.hardware.parts.level_words import LevelWord as LevelWord
from ann_dc.hardware.parts.levels import BEHAVIOURAL, Level
from ann_dc.hardware.schematic.buildable import check_buildable
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.hardware.sizing.bandwidth_margin import Sizing, cure, sized_circuit
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.progress import Progress, silent
from ann_dc.summaries import summarised
from ann_dc.validation import Index, PositiveFinite, Range, checked

NODE_LAG = 1e-3
"""Time constant of a grid's nodes, in the network's fastest time constants."""
WAVEFORM_MARGIN = 100_000.0
"""Bandwidth margin of a network that does not settle."""
POINTS = 60.0
"""Smallest number of steps of such a run in its fastest time constant."""
Headroom: TypeAlias = Annotated[float, Range(words="a number, 1 or more", low=1.0)]


@checked
@summarised(
    lambda self: {
        "level": self.level.name,
        "series": self.series.name,
        "seed": self.seed,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class SpiceBackend:
    """Backend that runs networks as circuits in ngspice.

    Attributes
    ----------
    level : Level or str
        Circuit model, parts and operating conditions, or the word of a level ("macro"); by
        default `BEHAVIOURAL`.
    simulation : Simulation, optional
        Simulation settings; by default those suited to the level.
    simulator : Ngspice, optional
        Simulator; by default one with the time limit of the simulation.
    seed : int or None, default None
        Seed of part errors drawn from the level's tolerances; None for nominal parts.
    series : Series or str
        Series of resistor values, or its name ("E96"), and of capacitors with them; by default
        exact values. Drawn errors are added to the series rounding.
    headroom : float, default `HEADROOM`
        Full scale relative to the largest value of the probe run, at least 1; see `scale`.
    bandwidth_margin : float, optional
        Bandwidth margin, the usable bandwidth of the parts over that of the network's fastest mode:
        k = 2 pi f T / radius. The default is `MARGIN`, or the margin that capacitances and poles of
        the parts require; `WAVEFORM_MARGIN` for a network that does not settle or follows inputs
        over time, whose waveforms are delayed by 1 / k of its time constants.
    intervals : mapping of node name to (low, high)
        Ranges that the probe run does not show, in the user's units; see `scale`, and
        `fitting_intervals` for Lagrange multipliers.
    duration : float, optional
        Network time of the run, also of the ideal network by which the circuit is scaled. The
        network need not settle, so that oscillators become circuits; multiply by
        ``circuit.scaling.time`` for seconds. By default the run lasts until the circuit settles.
    node_lag : float, default `NODE_LAG`
        Time constant (capacitance over conductance) of a grid's nodes, in the network's fastest
        time constants.
    require_stable : bool, default True
        True to reject a circuit whose pole model oscillates; False to simulate the oscillation.
    progress : Progress
        Receiver of one progress line at a time.

    Examples
    --------
    Without ngspice, everything up to the netlist is available:

    >>> import ann_dc
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> backend = ann_dc.SpiceBackend()
    >>> circuit, probe = backend.prepare(network)
    >>> deck = backend.deck(circuit, probe, deviations={})
    >>> deck.parts
    {'op amps': 57, 'resistors': 146, 'capacitors': 39}
    >>> backend.run(network).control_error < 1e-3  # doctest: +SKIP
    True
    """

    level: OrWord[Level] = default(BEHAVIOURAL)
    simulation: Simulation | None = None
    simulator: Ngspice | None = None
    seed: Index | None = None
    series: OrWord[Series] = default(EXACT)
    headroom: Headroom = HEADROOM
    bandwidth_margin: PositiveFinite | None = None
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    duration: PositiveFinite | None = None
    node_lag: PositiveFinite = NODE_LAG
    require_stable: bool = True
    progress: Progress = silent

    @property
    def kinds(self) -> tuple[PreconditionerKind, ...]:
        """Default preconditioner kinds; a grid and a tree are built on request."""
        return tuple(
            k
            for k in self.level.preconditioners
            if k not in (PreconditionerKind.RESISTIVE_GRID, PreconditionerKind.CYCLIC_REDUCTION)
        )

    @checked
    def run(self, network: Network) -> CircuitRun:
        """Build a network as a circuit, simulate it, and read it back.

        Raises `NetworkError` if the network does not settle in continuous time and no ``duration``
        is given, or the pole model oscillates. Raises `NgspiceMissing` or `SpiceError` if ngspice
        is not found, or fails.
        """
        return simulate(self, *self.prepare(network))

    @checked
    def prepare(self, network: Network) -> tuple[Circuit, Trajectory]:
        """Run the probe, scale the circuit and choose components.

        Returns the circuit of the given network, or of one with constraints in place of the
        saturation limits of coupled neurons, and the run of the ideal network used for scaling.

        Raises `NetworkError` if the network does not settle, so that scaling is impossible; if
        parts of the level clip below full scale; or if its technology does not support the
        preconditioner, the saturation limits of a neuron, a neuron common to all cells, or
        resistors of a series.
        """
        level = self.level
        check_full_scale(level)
        check_buildable(network, level, self.series)
        rules = ScalingRules(
            gbw=level.datasheet.usable_bandwidth,
            bandwidth_margin=self.bandwidth_margin or MARGIN,
            full_scale=level.full_scale,
            headroom=self.headroom,
            intervals=self.intervals,
        )
        found = probed(network, rules, self.progress, self.duration)
        if self.bandwidth_margin is None and not settles(found.trajectory):
            found = replace(found, scaling=found.scaling.slower(WAVEFORM_MARGIN / MARGIN))
        probe = found.trajectory
        places = moments(probe)
        sizing = Sizing(
            schematic=schematic_of(found.network, differential=level.technology.differential),
            scaling=found.scaling,
            level=level,
            x=probe.final,
            run=None if settles(probe) else (probe.states[places], probe.time[places]),
            bandwidth_margin=self.bandwidth_margin,
            lag=self.node_lag / found.rate,
        )
        return sized_circuit(sizing, progress=self.progress), probe

    @checked
    def deviations(self, circuit: Circuit) -> dict[str, np.ndarray]:
        """Return the errors (N,) of single parts by parameter name: series rounding and draws.

        Errors are relative for resistors, capacitors and gains, and in volts for offsets. The
        level's tolerances give the size of drawn errors. Errors of a foundry's transistors come
        from its models in the deck, with the same seed.
        """
        off = rounded_to_series(circuit, self.series)
        if self.seed is None:
            return off
        sizes = self.level.tolerances
        sizes = passive(sizes) if self.level.models == PACKAGE else sizes
        return combined(circuit.parameters, off, draw(circuit.parameters, sizes, self.seed))

    @checked
    def deck(self, circuit: Circuit, probe: Trajectory, deviations: Deviations) -> Deck:
        """Return the netlist of a circuit, for the duration or until its slowest pole has decayed.

        ``deviations`` (N,) are the errors of parts by parameter name; empty for nominal parts.
        Raises `UnknownNameError` if one names no parameter, and `NetworkError` if the level's cells
        do not have such an error.
        """
        span = span_of(circuit, self.level, probe, self.duration)
        simulation = self.simulation or simulation_for(self.level)
        if swings(probe):
            points = math.ceil(POINTS * span.duration * fastest_rate(probe))
            simulation = replace(simulation, points=max(points, simulation.points))
        deck = deck_of(
            circuit,
            self.level,
            duration=span.duration,
            deviations=deviations,
            simulation=simulation,
            mismatch=self.seed,
        )
        return replace(deck, cut=span.cut)

    @checked
    def check_stable(self, emulation: Emulation, probe: Trajectory) -> None:
        """Raise `NetworkError` if a pole of a circuit's emulation oscillates.

        The message distinguishes parts that are too slow from an ideal network that oscillates as
        well.
        """
        self.progress("eigenvalues of the pole model")
        found = pole_spectrum(emulation, probe.final)
        if found.abscissa < 0:
            return
        circuit = emulation.circuit
        ideal = spectrum(circuit.schematic.network, probe.final).abscissa
        if ideal >= 0:
            why = f"the ideal network is unstable as well ({ideal:+.3g}); other parts do not help"
        else:
            why = (
                f"parts of {self.level.datasheet.usable_bandwidth:.3g} Hz are too slow at "
                f"bandwidth margin {circuit.scaling.bandwidth_margin:g}; "
                f"{cure(circuit, self.level, probe.final)}"
            )
        raise NetworkError(
            f"circuit: the pole model is unstable (an eigenvalue of {found.abscissa:+.3g} per unit "
            f"time constant): {why}"
        )

    @checked
    def measure(self, circuit: Circuit, deck: Deck, probe: Trajectory) -> CircuitRun:
        """Run a circuit's netlist in ngspice, regardless of its pole model."""
        self.progress(f"ngspice, {self.level.name} level")
        raw = ngspice_of(self).run(deck.text, end_time=deck.end)
        return read_run(self, circuit, deck, raw, probe)


def read_run(
    backend: SpiceBackend, circuit: Circuit, deck: Deck, raw: Raw, probe: Trajectory
) -> CircuitRun:
    """Read back a run of ngspice; finer runs for its settling time are made on request."""
    datasheet = backend.level.datasheet
    finer = partial(refined, simulator=ngspice_of(backend), datasheet=datasheet)
    return replace(read_back(circuit, deck, raw, probe, datasheet), finer=finer)


@checked
def simulate(
    backend: SpiceBackend,
    circuit: Circuit,
    probe: Trajectory,
    deviations: Deviations | None = None,
) -> CircuitRun:
    """Run a circuit on a backend's level and compare it with its probe run.

    ``deviations`` replace the part errors from the backend's series and seed. Raises `NetworkError`
    if the pole model oscillates and the backend requires stability, and `NgspiceMissing` or
    `SpiceError` if ngspice is not found or fails.
    """
    errors = backend.deviations(circuit) if deviations is None else deviations
    if backend.require_stable and backend.level.emulated and settles(probe):
        backend.check_stable(emulate(circuit, backend.level, errors), probe)
    return backend.measure(circuit, backend.deck(circuit, probe, errors), probe)


def ngspice_of(backend: SpiceBackend) -> Ngspice:
    """Return the backend's simulator, or one with the time limit of its level."""
    chosen = backend.simulation or simulation_for(backend.level)
    return backend.simulator or Ngspice(timeout=chosen.patience, progress=backend.progress)
