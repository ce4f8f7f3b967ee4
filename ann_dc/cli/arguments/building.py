"""What ``circuit`` and ``ladder`` do before anything is built: the network gets its gains."""

from __future__ import annotations

import math

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.errors import ProblemError
from ann_dc.fidelity.margins import fitting_margin
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import Level, macro
from ann_dc.hardware.schematic.buildable import check_metric
from ann_dc.network.metrics.contract import Kind
from ann_dc.network.network import Network
from ann_dc.optimality.prospects.prospect import Hopeless, Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.solution.doubt import doubt_of
from ann_dc.solver import synthesize


def network_to_build(
    problem: OptimalControlProblem,
    kind: Kind,
    *,
    simulated: bool = True,
    progress: Progress = silent,
) -> Network:
    """The designed network of a problem, with a kind of metric.

    Raises
    ------
    NgspiceMissing
        If it is to be simulated and there is no ngspice: told before the design.
    ProblemError
        If the design did not settle.
    """
    if simulated:
        find_ngspice()
    network, prospect = synthesize(problem), Prospect(problem=problem)
    doubt = doubt_of(prospect, network)
    designed = design(network, kinds=(kind,), progress=progress, doubt=doubt)
    if designed.settled:
        return designed.network
    if isinstance(designed.first.ended, Hopeless):
        raise ProblemError(f"{problem.name}: nothing to build: {designed.first.ended}")
    raise ProblemError(
        f"{problem.name}: the design did not settle in {designed.first.steps} steps, so there "
        "is nothing to build; check that the target is within reach, or try another --metric"
    )


def margin_to_build(
    given: float | None,
    network: Network,
    level: Level | None = None,
    *,
    progress: Progress = silent,
) -> float | None:
    """--margin, or the one that suits the metric of a network on a level of op amps, if any does.

    Raises
    ------
    NetworkError
        If the level cannot build the metric.
    ProblemError
        If no margin makes the circuit stable.
    """
    if given is not None or network.metric.kind is Kind.TIME_CONSTANTS:
        return given
    if level is not None:
        check_metric(network.metric.kind, level)
    chosen = level if level is not None and level.emulated else macro()
    circuit, probe = SpiceBackend(level=chosen, progress=progress).prepare(network)
    margin = fitting_margin(circuit, chosen, probe, progress=progress)
    if not math.isfinite(margin):
        raise ProblemError(
            f"--metric: no margin makes the {network.metric.kind.value} stable with op amps of "
            f"level {chosen.name}; choose another, or --metric time-constants"
        )
    return margin
