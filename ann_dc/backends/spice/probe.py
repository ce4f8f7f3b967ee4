"""Probe runs of the ideal network, by which its circuit is scaled.

Saturation limits of coupled neurons are replaced by constraints before the run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import DOP853, OdeBackend
from ann_dc.backends.trajectory import Trajectory
from ann_dc.errors import NetworkError
from ann_dc.hardware.circuit.scaling import ProbeRun, Scaling, ScalingRules, scale
from ann_dc.hardware.schematic.schematic import schematic_of
from ann_dc.hardware.sizing.rail_rows import BANDWIDTH, intervals_of_inputs, with_rail_rows
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.network.selection import clamped_rows
from ann_dc.progress import Progress

PROBE = OdeBackend(method=DOP853, verify=False)
"""Backend of the run by which a circuit is scaled and with which it is compared."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Probed:
    """Network that is built, its run and the scaling of its circuit.

    ``rate`` is the fastest rate for which op amps are sized, in units of 1 / network time.
    """

    network: Network
    trajectory: Trajectory
    rate: float
    scaling: Scaling


def probed(network: Network, rules: ScalingRules, progress: Progress) -> Probed:
    """Run a network and scale its circuit.

    Constraints replace the saturation limits of coupled neurons. Raises `NetworkError` if the
    network does not settle, so that scaling is impossible.
    """
    if not len(clamped_rows(network)):
        return _probed(network, rules, progress)
    known = {n: ends for n, ends in rules.intervals.items() if n in network.node_index}
    found = _probed(network, replace(rules, intervals=known), progress)
    rows = with_rail_rows(network, found.scaling, found.rate)
    if (
        rows.cell.inequality_duals == network.cell.inequality_duals
    ):  # every rail lies beyond full scale
        return _probed(rows, rules, progress)
    found = _probed(rows, rules, progress, BANDWIDTH * found.rate)
    wide = intervals_of_inputs(schematic_of(rows), found.scaling, found.rate, rules.headroom)
    wider = replace(rules, intervals=wide | dict(rules.intervals))
    return replace(found, scaling=_scaling(found.trajectory, wider, found.rate))


def _probed(
    network: Network, rules: ScalingRules, progress: Progress, least: float = 0.0
) -> Probed:
    """Run a network and scale its circuit for its fastest rate, or the ``least`` rate."""
    trajectory = _run(network, progress)
    rate = max(spectrum(network, trajectory.final).radius, least)
    scaling = _scaling(trajectory, rules, rate)
    return Probed(network=network, trajectory=trajectory, rate=rate, scaling=scaling)


def _scaling(probe: Trajectory, rules: ScalingRules, rate: float) -> Scaling:
    run = ProbeRun(states=probe.states, times=probe.time, radius=rate)
    return scale(probe.network, run, rules)


def _run(network: Network, progress: Progress) -> Trajectory:
    progress("probe run")
    run = replace(PROBE, progress=progress).run(network)
    if not run.status.settled:
        alone = network.preconditioner.kind is PreconditionerKind.DIAGONAL and bool(
            network.cell.duals
        )
        means = (
            "; another preconditioner may settle: PreconditionerKind.MULTILEVEL "
            "(ann-dc circuit --metric multilevel)"
        )
        raise NetworkError(
            f"circuit: the network has to settle to be scaled; {run.status}" + means * alone
        )
    return run.trajectory
