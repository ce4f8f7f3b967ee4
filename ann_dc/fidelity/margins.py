"""How fast op amps have to be against the network: the margin k = 2 pi GBW T / radius.

With too small a margin a circuit oscillates. A large one wastes time, because network time runs as
slowly as the op amps ask for; in between lies the margin at which the circuit settles soonest.
"""

from __future__ import annotations

from ann_dc.backends.trajectory import Trajectory
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.sizing.margins import SPARE, least_margin
from ann_dc.hints.checked import checked
from ann_dc.progress import Progress, silent


@checked
def smallest_margin(
    circuit: Circuit, level: Level, probe: Trajectory, *, progress: Progress = silent
) -> float:
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
    return least_margin(circuit, level, probe.final, progress=progress)


@checked
def fitting_margin(
    circuit: Circuit, level: Level, probe: Trajectory, *, progress: Progress = silent
) -> float:
    """A margin that suits a circuit: `SPARE` times the smallest, which is near the fastest one.

    Parameters
    ----------
    circuit, level, probe, progress
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
    return SPARE * smallest_margin(circuit, level, probe, progress=progress)
