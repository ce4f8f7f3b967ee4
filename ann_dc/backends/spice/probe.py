"""Probe runs of the ideal network, by which its circuit is scaled and timed.

Saturation limits of coupled neurons are replaced by constraints before the run.

A circuit is simulated for at least 14 time constants of the slowest pole, limited to between 1.5
and 20 probe durations. The probe run shows the settling of the ideal network; if it starts near its
end, the slowest mode is used instead. Op amps can add modes slower than those of the network, and
so do clamps at an output that is close to a rail. The slowest pole of the pole model shows these
modes, and the run covers it up to a bound.

Controls that end far below their largest values take longer to settle, so the run is longer. A run
ends after the slowest mode has decayed below the predicted error, which is read at its end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.settling import settles
from ann_dc.backends.status import Outcome
from ann_dc.backends.trajectory import Trajectory, control_error
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.circuit.scaling import ProbeRun, Scaling, ScalingRules, scale
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.clamps import beside_limits
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.states import pole_spectrum, settled_state
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.hardware.sizing.rail_rows import BANDWIDTH, intervals_of_inputs, with_rail_rows
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.selection import clamped_rows
from ann_dc.progress import Progress

PROBE = OdeBackend(method=DOP853, verify=False)
"""Backend of the run by which a circuit is scaled and with which it is compared."""

RATES = 64
"""Number of states of a run of given duration at which its circuit is sized."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Probed:
    """Network that is built, its run and the scaling of its circuit.

    ``rate`` is the fastest rate for which op amps are sized, in units of 1 / network time.
    """

    network: Network
    trajectory: Trajectory
    rate: float
    scaling: Scaling


def probed(
    network: Network, rules: ScalingRules, progress: Progress, duration: float | None = None
) -> Probed:
    """Run a network until it settles, or for a ``duration``, and scale its circuit.

    Constraints replace the saturation limits of coupled neurons. Raises `NetworkError` if the
    network does not settle or complete its duration, so that scaling is impossible.
    """
    run = replace(PROBE, progress=progress, duration=duration)
    if not len(clamped_rows(network)):
        return _probed(network, rules, run)
    known = {n: ends for n, ends in rules.intervals.items() if n in network.node_index}
    found = _probed(network, replace(rules, intervals=known), run)
    rows = with_rail_rows(network, found.scaling, found.rate)
    if (
        rows.cell.inequality_duals == network.cell.inequality_duals
    ):  # every rail lies beyond full scale
        return _probed(rows, rules, run)
    found = _probed(rows, rules, run, BANDWIDTH * found.rate)
    wide = intervals_of_inputs(schematic_of(rows), found.scaling, found.rate, rules.headroom)
    wider = replace(rules, intervals=wide | dict(rules.intervals))
    return replace(found, scaling=_scaling(found.trajectory, wider, found.rate))


def _probed(
    network: Network, rules: ScalingRules, backend: OdeBackend, least: float = 0.0
) -> Probed:
    """Run a network and scale its circuit for its fastest rate, or the ``least`` rate."""
    trajectory = _run(network, backend)
    rate = max(fastest_rate(trajectory), least)
    scaling = _scaling(trajectory, rules, rate)
    return Probed(network=network, trajectory=trajectory, rate=rate, scaling=scaling)


def _scaling(probe: Trajectory, rules: ScalingRules, rate: float) -> Scaling:
    run = ProbeRun(states=probe.states, times=probe.time, radius=rate)
    return scale(probe.network, run, rules)


DAMPED = 0.05
"""Smallest damping ratio of modes that do not swing."""


def swings(probe: Trajectory) -> bool:
    """Return True if a network that does not settle has modes that hardly decay.

    An oscillator has such modes; a network that follows inputs over time has them if its
    equilibrium has.
    """
    if settles(probe):
        return False
    if not probe.network.waveforms:
        return True
    found = spectrum(probe.network.at_time(float(probe.time[-1])), probe.final)
    modes = found.eigenvalues
    return bool((-np.real(modes) < DAMPED * np.abs(np.imag(modes))).any())


def fastest_rate(probe: Trajectory) -> float:
    """Return the spectral radius at the settled point, in 1 / network time.

    If the network does not settle, the result is the largest of `RATES` states of the run.
    """
    if probe not in _rates:
        places = moments(probe)
        networks = (probe.network.at_time(float(probe.time[place])) for place in places)
        radii = (spectrum(n, probe.states[k]).radius for n, k in zip(networks, places))
        _rates[probe] = max(radii)
    return _rates[probe]


_rates: WeakKeyDictionary[Trajectory, float] = WeakKeyDictionary()


def moments(probe: Trajectory) -> list[int]:
    """Return the rows of a run at which its circuit is sized: the settled one, or `RATES`."""
    if settles(probe):
        return [-1]
    return np.unique(np.linspace(0, len(probe.time) - 1, RATES).astype(int)).tolist()


def _run(network: Network, backend: OdeBackend) -> Trajectory:
    backend.progress("probe run")
    run = backend.run(network)
    if run.status.outcome is Outcome.COMPLETED:
        return run.trajectory
    if backend.duration is not None and not run.status.settled:
        raise NetworkError(f"duration: {backend.duration:g} cannot be run; {run.status}")
    if not run.status.settled:
        alone = network.preconditioner.kind is PreconditionerKind.DIAGONAL and bool(
            network.cell.duals
        )
        means = (
            "; another preconditioner may settle: PreconditionerKind.MULTILEVEL "
            "(ann-dc circuit --preconditioner multilevel)"
        )
        raise NetworkError(
            "circuit: the network has to settle for scaling; otherwise set the duration of its "
            f"run (duration=T or --duration T); {run.status}" + means * alone
        )
    return run.trajectory


LONGER = 1.5
"""Smallest duration of a circuit run relative to the probe run."""

LONGEST = 20.0
"""Largest duration of a circuit run relative to the probe run."""

LIFETIMES = 14.0
"""Smallest duration of a circuit run in time constants of its slowest pole."""

SMALL, LATER = 0.1, 3.0
"""Fraction of their reach below which controls end small, and additional time constants per factor
of e below this fraction: one for the decay, and the rest for observing it.
"""

LEFT = 0.02
"""Deviation that the slowest mode leaves at the end of a run, relative to the predicted error."""


@dataclass(frozen=True, kw_only=True)
class Span:
    """Network time that a simulation lasts, and that wanted by the slowest pole."""

    duration: float
    wanted: float

    @property
    def cut(self) -> str:
        """Clause on why the run may be too short; empty if it is long enough."""
        if self.wanted <= self.duration:
            return ""
        return (
            f"the slowest pole requires a run {self.wanted / self.duration:.2g} times as long, "
            f"beyond {LONGEST:g} times the ideal network"
        )


def span_of(
    circuit: Circuit, level: Level, probe: Trajectory, duration: float | None = None
) -> Span:
    """Return the simulation duration of a circuit; without emulation, by the probe alone."""
    if duration is not None:
        return Span(duration=duration, wanted=0.0)
    ideal = float(probe.time[-1])
    if not level.emulated:
        return Span(duration=LONGER * max(ideal, _ideal_run(probe)), wanted=0.0)
    emulation = emulate(circuit, level)
    slowest = _slowest(emulation, level, probe)
    wanted = slowest * _lifetimes(probe)
    longer = max(wanted, slowest * _lifetimes_of_error(emulation, probe))
    if longer > LONGEST * ideal:  # a probe that starts near its end says little
        ideal = max(ideal, _ideal_run(probe))
    duration = float(np.clip(longer, LONGER * ideal, LONGEST * ideal))
    return Span(duration=duration, wanted=wanted)


def _ideal_run(probe: Trajectory) -> float:
    """Return the network time of an ideal run, by its slowest mode; 0 if a mode grows."""
    abscissa = spectrum(probe.network, probe.final).abscissa
    return LIFETIMES / LONGER / -abscissa if abscissa < 0 else 0.0


def _lifetimes(probe: Trajectory) -> float:
    """Return the time constants for controls that end far below their largest values."""
    fall = SMALL * probe.control_reach / probe.control_size
    return LIFETIMES + LATER * math.log(max(fall, 1.0))


def _lifetimes_of_error(emulation: Emulation, probe: Trajectory) -> float:
    """Return the time constants that leave `LEFT` of the error; 0 without equilibrium."""
    try:
        x = settled_state(emulation, probe.final)
    except NetworkError:
        return 0.0
    left = LEFT * control_error(emulation.controls(x), probe) * probe.control_size
    return math.log(probe.control_reach / left) if 0 < left < probe.control_reach else 0.0


def _slowest(emulation: Emulation, level: Level, probe: Trajectory) -> float:
    """Return the slowest time constant of the pole model; 0 if a pole grows."""
    built = beside_limits(emulation, level.datasheet, probe.final)
    abscissa = pole_spectrum(built, probe.final).abscissa
    return -1 / abscissa if abscissa < 0 else 0.0
