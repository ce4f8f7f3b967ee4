"""A network as a circuit in ngspice: scaled by a probe run, read back by neuron."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.spice.circuit_run import KNEE, CircuitRun, read_back
from ann_dc.backends.spice.netlist.deck import deck_of
from ann_dc.backends.spice.ngspice.runner import Ngspice
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit, circuit_of
from ann_dc.hardware.circuit.deviations import Deviations, draw
from ann_dc.hardware.circuit.scaling import HEADROOM, MARGIN, ProbeRun, ScalingRules, scale
from ann_dc.hardware.circuit.schematic import schematic_of
from ann_dc.hardware.emulation.emulation import emulate, is_emulated, pole_spectrum
from ann_dc.hardware.parts.levels import BEHAVIOURAL, Level
from ann_dc.network.network import Network

LONGER = 1.5
"""Duration of a circuit run over that of the probe run."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpiceBackend:
    """Runs networks as circuits.

    Attributes
    ----------
    level : Level
    simulator : Ngspice, optional
        One with the level's patience where none is given.
    headroom, margin, intervals
        See `scale`.
    seed : int or None
        Draws the errors of single parts from the level's spread; None: every part as it should be.
    require_stable : bool
        Refuse a circuit whose pole model oscillates: ngspice would take for ever to show it. Set
        it to False to watch one ring.
    progress : callable or None
    """

    level: Level = BEHAVIOURAL
    simulator: Ngspice | None = None
    seed: int | None = None
    headroom: float = HEADROOM
    margin: float = MARGIN
    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    require_stable: bool = True
    progress: Callable[[str], None] | None = None

    def prepare(self, network: Network) -> tuple[Circuit, Trajectory]:
        """Probe, scale and choose components.

        Raises
        ------
        NetworkError
            If the network does not settle, so that there is nothing to scale by.
        """
        level = self.level
        if level.full_scale > KNEE * level.limit:
            raise NetworkError(
                f"full_scale: parts of level {level.name} clip at {level.limit:g} V, got "
                f"{level.full_scale:g} V; take at most {KNEE * level.limit:.3g} V"
            )
        self.tell("probe run")
        run = replace(PROBE, progress=self.progress).run(network)
        if not run.status.settled:
            raise NetworkError(f"circuit: the network has to settle to be scaled; {run.status}")
        trajectory = run.trajectory
        if not np.abs(trajectory.controls[-1]).max(initial=0.0) > 1e-12:
            raise NetworkError(
                "circuit: all controls settle at zero, so that no error can be related to them; "
                "give the problem another target"
            )
        scaling = scale(
            network,
            ProbeRun(
                states=trajectory.states,
                times=trajectory.time,
                radius=spectrum(network, trajectory.final).radius,
            ),
            ScalingRules(
                gbw=self.level.datasheet.usable_bandwidth,
                margin=self.margin,
                full_scale=self.level.full_scale,
                headroom=self.headroom,
                intervals=self.intervals,
            ),
        )
        schematic = schematic_of(network, differential=self.level.technology.differential)
        return circuit_of(schematic, scaling, smallest=self.level.smallest_resistor), trajectory

    def deviations(self, circuit: Circuit) -> dict[str, np.ndarray]:
        """Errors of single parts: drawn from the level's spread with the seed, none without."""
        if self.seed is None:
            return {}
        return draw(circuit.parameters, self.level.tolerances, self.seed)

    def run(self, network: Network) -> CircuitRun:
        """Compile a network, simulate it, and read it back.

        Raises
        ------
        NetworkError
            If the network does not settle in continuous time.
        NgspiceMissing, SpiceError
            If ngspice is not there, or fails.
        """
        return simulate(self, *self.prepare(network))

    def tell(self, line: str) -> None:
        """One line of progress."""
        if self.progress:
            self.progress(line)


def simulate(
    backend: SpiceBackend,
    circuit: Circuit,
    probe: Trajectory,
    deviations: Deviations | None = None,
) -> CircuitRun:
    """Run components on a backend's level, and compare them with their probe run.

    ``deviations`` say which parts are off by how much, instead of the backend's seed.

    Raises
    ------
    NetworkError
        If the pole model oscillates and the backend requires stability.
    SpiceError
        If ngspice fails.
    """
    off = backend.deviations(circuit) if deviations is None else deviations
    if backend.require_stable and is_emulated(circuit, backend.level):
        _check_stable(backend, circuit, probe, off)
    duration = LONGER * float(probe.time[-1])
    written = deck_of(circuit, backend.level, duration=duration, deviations=off)
    backend.tell(f"ngspice, {backend.level.name} level")
    simulator = backend.simulator or Ngspice(timeout=backend.level.patience)
    raw = simulator.run(written.text, end_time=written.end)
    return read_back(circuit, written, raw, probe, backend.level.datasheet)


def _check_stable(
    backend: SpiceBackend, circuit: Circuit, probe: Trajectory, deviations: Deviations
) -> None:
    backend.tell("eigenvalues of the pole model")
    level = backend.level
    found = pole_spectrum(emulate(circuit, level, deviations), probe.final)
    if found.abscissa < 0:
        return
    ideal = spectrum(circuit.schematic.network, probe.final).abscissa
    if ideal >= 0:
        why = f"so is the ideal network ({ideal:+.3g}); no hardware cures that"
    else:
        why = (
            f"parts of {level.datasheet.usable_bandwidth:.3g} Hz are too slow at margin "
            f"{backend.margin:g}; raise the margin"
        )
    raise NetworkError(
        f"circuit: the pole model is unstable (an eigenvalue of {found.abscissa:+.3g} per unit of "
        f"network time): {why}"
    )


PROBE = OdeBackend(method=DOP853, verify=False)
"""The run that a circuit is scaled by and compared with."""
