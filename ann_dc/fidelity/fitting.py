"""Bandwidth margin and multiplier intervals that suit a circuit.

A circuit oscillates if its bandwidth margin k = 2 pi GBW T / radius is too small. A large margin
wastes time, because network time is scaled to the op amps. The circuit settles fastest at a margin
between these limits.

An op amp of gain A0 with output v has v / A0 at its input. Lagrange multipliers that use half of
their scale therefore halve the constraint errors. The effect of offsets on the neurons that read
the multipliers doubles with it. The parts decide which effect dominates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.error_budget import sensitivity, total_error
from ann_dc.hardware.circuit.circuit import Circuit
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import PICell
from ann_dc.hardware.sizing.bandwidth_margin import (
    SPARE,
    following_margin,
    holding_margin,
    least_margin,
)
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.scale import Scale
from ann_dc.validation import checked

WIDER = (2**0.5, 2.0)
"""Tested widths of the multiplier intervals, relative to the reached values."""


@checked
def smallest_margin(
    circuit: Circuit, level: Level, probe: Trajectory, *, progress: Progress = silent
) -> float:
    """Return the smallest stable bandwidth margin k = 2 pi GBW T / radius, to 1 %.

    The search starts at 1; op amps that are slower relative to the network make the circuit
    oscillate. The circuit can have any margin, since only its time scale is changed. The result is
    infinite if 10000 is not sufficient. Raises `NetworkError` if the circuit has no emulation.

    Examples
    --------
    >>> import ann_dc
    >>> from ann_dc.fidelity import smallest_margin
    >>> problem = ann_dc.plants.double_integrator(N=5)
    >>> network = ann_dc.design(problem, preconditioner=ann_dc.PreconditionerKind.DIAGONAL).network
    >>> level = ann_dc.levels.macro()
    >>> circuit, probe = ann_dc.SpiceBackend(level=level).prepare(network)
    >>> round(smallest_margin(circuit, level, probe))  # it was built with 10
    5
    """
    return least_margin(circuit, level, probe.final, progress=progress)


@checked
def fitting_margin(
    circuit: Circuit, level: Level, probe: Trajectory, *, progress: Progress = silent
) -> float:
    """Return a margin near the fastest settling: `SPARE` times `smallest_margin`.

    The margin is larger if clamps could not otherwise hold neurons at their saturation limits, or
    if idle rectifying multiplier neurons would shift a resistive grid. It is infinite if the
    smallest one is infinite.
    """
    least = smallest_margin(circuit, level, probe, progress=progress)
    holding = holding_margin(circuit, level, probe.final)
    return max(SPARE * least, holding, following_margin(circuit, level))


@checked
def fitting_intervals(backend: SpiceBackend, network: Network) -> Mapping[str, tuple[float, float]]:
    """Return the Lagrange multiplier intervals that minimise the control error.

    Settled circuits are emulated with intervals up to twice as wide as the values of the probe run.
    The criterion is the control error without errors of single parts, combined with the spread by
    the datasheet's tolerances, if any. Wider intervals suit parts without offsets. The result maps
    node names to (low, high) in the user's units, as `ScalingRules` expects. Intervals declared by
    `backend` are preserved.

    Raises `NetworkError` if the network cannot be scaled or built, or if the circuit does not
    settle nearby.
    """
    circuit, probe = backend.prepare(network)
    wide = [_intervals(circuit, backend.intervals, wider) for wider in WIDER]
    tried = [backend.intervals, *wide]
    errors = []
    for intervals in tried:
        circuit = replace(backend, intervals=intervals).prepare(network)[0]
        errors.append(_error(CircuitInstance(circuit=circuit, level=backend.level, probe=probe)))
    return tried[int(np.argmin(errors))]


@checked
def fitted(backend: SpiceBackend, network: Network) -> SpiceBackend:
    """Return a backend with intervals and margin that suit a network.

    Networks with coarse-level neurons need both. Values declared by `backend` are preserved. The
    margin is infinite if none suffices.
    """
    backend = replace(backend, intervals=fitting_intervals(backend, network))
    if backend.bandwidth_margin is not None:
        return backend
    circuit, probe = backend.prepare(network)
    bandwidth_margin = fitting_margin(circuit, backend.level, probe, progress=backend.progress)
    return replace(backend, bandwidth_margin=bandwidth_margin)


def _intervals(
    circuit: Circuit, declared: Mapping[str, tuple[float, float]], wider: float
) -> Mapping[str, tuple[float, float]]:
    """Return the declared intervals; others are `wider` times the values reached."""
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


def _error(instance: CircuitInstance) -> float:
    """Return the control error with the spread by tolerances; infinite if unsettled."""
    tolerances = instance.level.datasheet.tolerances
    try:
        nominal = instance.control_error
    except NetworkError:
        return np.inf
    if tolerances is None:
        return nominal
    found = sensitivity(instance.emulation, instance.settled)
    return float(np.hypot(nominal, total_error(found, instance.level.tolerances)))
