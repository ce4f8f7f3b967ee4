"""Duration of a circuit simulation, from the slowest pole and the probe run.

The duration is at least 14 time constants of the slowest pole, limited to between 1.5 and 20 probe
durations. The probe run shows the settling of the ideal network; if it starts near its end, the
slowest mode is used instead. Op amps can add modes slower than those of the network, and so do
clamps at an output that is close to a rail. The slowest pole of the pole model shows these modes,
and the run covers it up to a bound.

Controls that end far below their largest values take longer to settle, so the run is longer. A run
ends after the slowest mode has decayed below the predicted error, which is read at its end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.trajectory import Trajectory, control_error
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.clamps import beside_rails
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.states import pole_spectrum, settled_state
from ann_dc.hardware.parts.levels import Level

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
    """Duration of a circuit simulation.

    Attributes
    ----------
    duration : float
        Network time.
    wanted : float
        Network time required by the slowest pole; longer than ``duration`` if the bound is reached.

    Examples
    --------
    >>> Span(duration=300.0, wanted=200.0).cut
    ''
    >>> Span(duration=300.0, wanted=450.0).cut
    'its slowest pole asks for a run 1.5 times as long, beyond 20 times the ideal network'
    """

    duration: float
    wanted: float

    @property
    def cut(self) -> str:
        """Clause on why the run may be too short; empty if it is long enough."""
        if self.wanted <= self.duration:
            return ""
        return (
            f"its slowest pole asks for a run {self.wanted / self.duration:.2g} times as long, "
            f"beyond {LONGEST:g} times the ideal network"
        )


def span_of(circuit: Circuit, level: Level, probe: Trajectory) -> Span:
    """Return the simulation duration of a circuit.

    For a level whose circuits are not emulated, the probe alone determines the duration.
    """
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
    built = beside_rails(emulation, level.datasheet, probe.final)
    abscissa = pole_spectrum(built, probe.final).abscissa
    return -1 / abscissa if abscissa < 0 else 0.0
