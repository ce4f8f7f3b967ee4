"""Network, level and margin of a circuit, for ``circuit``, ``run``, ``levels`` and ``export``."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from ann_dc.backends.spice.backend import SpiceBackend
from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.errors import ProblemError
from ann_dc.fidelity.fitting import fitted
from ann_dc.gain_design.procedure import design
from ann_dc.hardware.parts.levels import Level, macro
from ann_dc.hardware.schematic.buildable import check_preconditioner
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.optimality.existence import Hopeless, Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.solution.knowledge import knowledge_of
from ann_dc.solver import synthesize


def network_to_build(
    problem: OptimalControlProblem,
    kind: PreconditionerKind,
    *,
    simulated: bool = True,
    progress: Progress = silent,
) -> Network:
    """Return the designed network of a problem, with one preconditioner kind.

    Raises `NgspiceMissing` before the design if a simulation is requested without ngspice. Raises
    `ProblemError` if the design did not settle.
    """
    if simulated:
        find_ngspice()
    network, prospect = synthesize(problem), Prospect(problem=problem)
    knowledge = knowledge_of(prospect, network)
    designed = design(network, preconditioner=(kind,), progress=progress, knowledge=knowledge)
    if designed.settled:
        return designed.network
    if isinstance(designed.first.ended, Hopeless):
        raise ProblemError(f"{problem.name}: no circuit: {designed.first.ended}")
    raise ProblemError(
        f"{problem.name}: the design did not settle in {designed.first.steps} steps; check that "
        "the target is within reach, or try another --preconditioner"
    )


def circuit_backend(
    network: Network, level: Level, *, duration: float | None = None, **parts: Any
) -> SpiceBackend:
    """Return the backend of a circuit, fitted to its network if the network has to settle.

    ``parts`` are further attributes of the backend. Raises the errors of `fitted_to_build`.
    """
    backend = SpiceBackend(level=level, duration=duration, **parts)
    return backend if duration is not None else fitted_to_build(backend, network)


def fitted_to_build(backend: SpiceBackend, network: Network) -> SpiceBackend:
    """Return the backend with a margin and intervals that suit the preconditioner.

    A diagonal preconditioner needs no change. Raises `NetworkError` if the level cannot realise the
    preconditioner, and `ProblemError` if no margin gives a stable circuit.
    """
    kind = network.preconditioner.kind
    if kind is PreconditionerKind.DIAGONAL:
        return backend
    check_preconditioner(kind, backend.level)
    if not backend.level.emulated:
        bandwidth_margin = fitted_to_build(
            replace(backend, level=macro()), network
        ).bandwidth_margin
        return replace(backend, bandwidth_margin=bandwidth_margin)
    found = fitted(backend, network)
    if not math.isfinite(found.bandwidth_margin or 0.0):
        raise ProblemError(
            f"--preconditioner: no bandwidth margin makes the {kind.value} stable with op amps "
            f"of level {backend.level.name}; choose another, or --preconditioner diagonal"
        )
    return found
