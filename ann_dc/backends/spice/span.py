"""How long a circuit is simulated: as long as its slowest pole takes, and longer than the probe.

The probe run says how long the ideal network takes; its slowest mode, if it starts near its end.
Op amps can add modes that are slower than any
of its own, and so do clamps beside an output that rests near a rail; the slowest pole of the pole
model tells, and up to a bound the run waits for it.
Controls that end far below where they have been take longer to settle, and the run with them.
A run ends after the slowest mode has decayed below the predicted error, which is read at its end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.trajectory import Trajectory, control_error
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.emulation import Emulation
from ann_dc.hardware.emulation.idle_clamps import beside_rails
from ann_dc.hardware.emulation.states import emulated_state, pole_spectrum
from ann_dc.hardware.parts.levels import Level

LONGER = 1.5
"""Duration of a circuit run over that of the probe run, at least."""

LONGEST = 20.0
"""The same, at most."""

LIFETIMES = 14.0
"""Duration of a circuit run in time constants of its slowest pole, at least."""

SMALL, LATER = 0.1, 3.0
"""Share of their reach below which controls end small; time constants that a run is longer for each
factor of e that they end below it: one to fall by that, and the rest that has to be seen."""

LEFT = 0.02
"""Deviation that the slowest mode leaves at the end of a run, over the predicted error."""


@dataclass(frozen=True, kw_only=True)
class Span:
    """How long a circuit is simulated.

    Attributes
    ----------
    duration : float
        Network time.
    wanted : float
        Network time that its slowest pole asks for; longer than ``duration`` where that is at its
        bound.

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
        """Why the run may be too short, in a clause; empty where it is not."""
        if self.wanted <= self.duration:
            return ""
        return (
            f"its slowest pole asks for a run {self.wanted / self.duration:.2g} times as long, "
            f"beyond {LONGEST:g} times the ideal network"
        )


def span_of(circuit: Circuit, level: Level, probe: Trajectory) -> Span:
    """How long to simulate a circuit.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        Where its circuits are not emulated, the probe alone says it.
    probe : Trajectory
        The ideal network's run.

    Returns
    -------
    Span
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
    """Return the time constants after which controls that went far have settled near their end."""
    fall = SMALL * probe.control_reach / probe.control_size
    return LIFETIMES + LATER * math.log(max(fall, 1.0))


def _lifetimes_of_error(emulation: Emulation, probe: Trajectory) -> float:
    """Return the time constants that leave `LEFT` of the error; 0 if there is no equilibrium."""
    try:
        x = equilibrium(emulation.network, emulated_state(emulation, probe.final))
    except NetworkError:
        return 0.0
    left = LEFT * control_error(emulation.controls(x), probe) * probe.control_size
    return math.log(probe.control_reach / left) if 0 < left < probe.control_reach else 0.0


def _slowest(emulation: Emulation, level: Level, probe: Trajectory) -> float:
    """Return the slowest time constant of the pole model; 0 if a pole grows."""
    built = beside_rails(emulation, level.datasheet, probe.final)
    abscissa = pole_spectrum(built, probe.final).abscissa
    return -1 / abscissa if abscissa < 0 else 0.0
