"""How fast op amps have to be against the network: the margin k = 2 pi GBW T / radius.

With too small a margin a circuit oscillates. A large one wastes time, because network time runs as
slowly as the op amps ask for; in between lies the margin at which the circuit settles soonest.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.trajectory import Trajectory
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.emulation import emulate, pole_spectrum
from ann_dc.hardware.parts.levels import Level
from ann_dc.hints.checked import checked

HIGHEST = 1e4
"""Margins above that are none."""

SPARE = 1.5
"""Margin over the smallest one: what a pole model does not know, and time to settle."""


@checked
def smallest_margin(circuit: Circuit, level: Level, probe: Trajectory) -> float:
    """The smallest k = 2 pi GBW T / radius from 1 on with which the circuit is stable, to 1 %.

    Op amps slower than that against the network make it oscillate.

    Parameters
    ----------
    circuit : Circuit
        Of any margin: only its time scale is changed.
    level : Level
        Says how fast its op amps are.
    probe : Trajectory
        The ideal network's run that the circuit was scaled by.

    Returns
    -------
    float
        Infinite if not even 10000 is enough.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.

    Examples
    --------
    >>> from ann_dc.fidelity import smallest_margin
    >>> import ann_dc
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> level = macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> round(smallest_margin(circuit, level, probe))  # it was built with 10
    5
    """
    radius = spectrum(circuit.schematic.network, probe.final).radius
    per_margin = radius / (2 * np.pi * level.datasheet.usable_bandwidth)

    def stable(margin: float) -> bool:
        scaling = replace(circuit.scaling, time=margin * per_margin)
        scaled = replace(circuit, scaling=scaling)
        return pole_spectrum(emulate(scaled, level), probe.final).abscissa < 0

    low, high = 1.0, 1.0
    while not stable(high):
        low, high = high, 2 * high
        if high > HIGHEST:
            return float("inf")
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if stable(middle) else (middle, high)
    return high


@checked
def fitting_margin(circuit: Circuit, level: Level, probe: Trajectory) -> float:
    """A margin that suits a circuit: `SPARE` times the smallest, which is near the fastest one.

    Parameters
    ----------
    circuit, level, probe
        As `smallest_margin` takes them.

    Returns
    -------
    float
        Infinite where that one is.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    return SPARE * smallest_margin(circuit, level, probe)
