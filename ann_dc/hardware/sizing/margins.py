"""Margins at which a circuit does not ring: the eigenvalues of its emulation decide."""

from __future__ import annotations

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.emulation.building import emulate
from ann_dc.hardware.emulation.states import pole_spectrum
from ann_dc.hardware.parts.levels import Level
from ann_dc.hints.checked import checked
from ann_dc.hints.values import State
from ann_dc.progress import Progress, silent

HIGHEST = 1e4
"""Margins above that are none."""

SPARE = 1.5
"""Margin over the smallest one: what a pole model does not know, and time to settle."""


@checked
def is_stable(circuit: Circuit, level: Level, x: State) -> bool:
    """Whether a circuit comes to rest where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    return pole_spectrum(emulate(circuit, level), x).abscissa < 0


@checked
def least_margin(circuit: Circuit, level: Level, x: State, *, progress: Progress = silent) -> float:
    """The smallest margin from 1 on with which a circuit is stable, to 1 %.

    Parameters
    ----------
    circuit : Circuit
        Of any margin; its resistors are kept.
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network where it settles.
    progress : Progress
        Told every margin that is tried.

    Returns
    -------
    float
        Infinite if not even 10000 is enough.

    Raises
    ------
    NetworkError
        If the circuit has no emulation.
    """
    radius = spectrum(circuit.schematic.network, x).radius
    wanted = radius / (2 * np.pi * level.datasheet.usable_bandwidth)  # time at a margin of one

    def stable(margin: float) -> bool:
        progress(f"smallest margin: is {margin:.3g} enough?")
        return is_stable(circuit.slower(margin * wanted / circuit.scaling.time), level, x)

    low, high = 1.0, 1.0
    while not stable(high):
        low, high = high, 2 * high
        if high > HIGHEST:
            return float("inf")
    while high > 1.01 * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if stable(middle) else (middle, high)
    return high
