"""What suits a circuit: how fast its op amps are, and what full scale is of Lagrange multipliers.

With too small a margin k = 2 pi GBW T / radius a circuit oscillates. A large one wastes time,
because network time runs as slowly as the op amps ask for; in between lies the margin at which the
circuit settles soonest.

An op amp of gain A0 that holds v has v / A0 at its input, so that Lagrange multipliers that use
half of their scale leave half of the defects. What offsets do to the neurons that read them doubles
with it: which of the two leads is a matter of the parts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import Specimen
from ann_dc.fidelity.error_budget import sensitivity, total_error
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.hardware.sizing.bandwidth_margin import SPARE, following_margin, least_margin
from ann_dc.hardware.sizing.clamps import holding_margin
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.scale import Scale
from ann_dc.validation.checked import checked

WIDER = (2**0.5, 2.0)
"""Intervals of Lagrange multipliers that are tried, over what they reached; more takes time."""


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

    It is larger where clamps could not hold with it what presses neurons against their rails, and
    where idle diode neurons would move a grid.

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
    least = smallest_margin(circuit, level, probe, progress=progress)
    holding = holding_margin(circuit, level, probe.final)
    return max(SPARE * least, holding, following_margin(circuit, level))


@checked
def fitting_intervals(backend: SpiceBackend, network: Network) -> Mapping[str, tuple[float, float]]:
    """Intervals of the Lagrange multipliers of a network with which its circuit is least off.

    Settled circuits are emulated, with intervals up to twice as wide as what the probe run reached.
    What counts is the error of the controls without errors of single parts, and the spread that
    the datasheet's tolerances make, if it has any: wider ones are for parts without offsets.

    Parameters
    ----------
    backend : SpiceBackend
        Intervals that it declares are kept as they are.
    network : Network

    Returns
    -------
    mapping of node name to (low, high)
        As `ScalingRules` takes them, in the user's units.

    Raises
    ------
    NetworkError
        If the network cannot be scaled or built, or the circuit settles nowhere near.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import ann_dc
    >>> from ann_dc.fidelity import Specimen, fitting_intervals
    >>> from ann_dc.hardware.parts import macro
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, kinds=[ann_dc.Kind.TIME_CONSTANTS]).network
    >>> backend = ann_dc.SpiceBackend(level=macro())
    >>> wide = replace(backend, intervals=fitting_intervals(backend, network))
    >>> errors = []
    >>> for built in (backend, wide):
    ...     circuit, probe = built.prepare(network)
    ...     errors.append(Specimen(circuit=circuit, level=macro(), probe=probe).control_error)
    >>> errors[1] < 0.75 * errors[0]
    True
    """
    circuit, probe = backend.prepare(network)
    wide = [_intervals(circuit, backend.intervals, wider) for wider in WIDER]
    tried = [backend.intervals, *wide]
    errors = []
    for intervals in tried:
        circuit = replace(backend, intervals=intervals).prepare(network)[0]
        errors.append(_error(Specimen(circuit=circuit, level=backend.level, probe=probe)))
    return tried[int(np.argmin(errors))]


@checked
def fitted(backend: SpiceBackend, network: Network) -> SpiceBackend:
    """A backend with the intervals and the margin that suit a network: what coordinators need.

    Parameters
    ----------
    backend : SpiceBackend
        What it declares of either is kept.
    network : Network

    Returns
    -------
    SpiceBackend
        With an infinite margin if none is enough.

    Raises
    ------
    NetworkError
        As `fitting_intervals`, and if the circuit has no emulation.
    """
    backend = replace(backend, intervals=fitting_intervals(backend, network))
    if backend.margin is not None:
        return backend
    circuit, probe = backend.prepare(network)
    margin = fitting_margin(circuit, backend.level, probe, progress=backend.progress)
    return replace(backend, margin=margin)


def _intervals(
    circuit: Circuit, declared: Mapping[str, tuple[float, float]], wider: float
) -> Mapping[str, tuple[float, float]]:
    """Declared ones, and so many times as wide as what the other Lagrange multipliers reached."""
    network, peaks = circuit.schematic.network, circuit.scaling.peaks
    cells = [part for part in circuit.schematic.parts if isinstance(part, PICell)]
    found = dict(declared)
    for name in {name for cell in cells for name in (cell.name, cell.dual)} - set(declared):
        known = name in network.neuron_index
        scale = network.neuron(name).scale if known else Scale()
        most = wider * peaks[name].value
        low, high = sorted((scale.user(-most), scale.user(most)))
        if low < high:
            found[name] = low, high
    return found


def _error(specimen: Specimen) -> float:
    """Of the settled controls, with what tolerances spread; infinite where it settles nowhere."""
    tolerances = specimen.level.datasheet.tolerances
    try:
        nominal = specimen.control_error
    except NetworkError:
        return np.inf
    if tolerances is None:
        return nominal
    found = sensitivity(specimen.emulation, specimen.settled)
    return float(np.hypot(nominal, total_error(found, specimen.level.tolerances)))
