"""What ``circuit`` and ``ladder`` do before anything is built: the network gets its gains."""

from __future__ import annotations

from ann_dc.backends.spice.ngspice.process import find_ngspice
from ann_dc.errors import ProblemError
from ann_dc.gain_design.procedure import design
from ann_dc.gain_design.rules.recipe import WITHOUT_COORDINATORS
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.solver import synthesize


def network_to_build(
    problem: OptimalControlProblem,
    *,
    coordinators: bool = False,
    simulated: bool = True,
    progress: Progress = silent,
) -> Network:
    """The designed network of a problem, with coarse coordinators or without.

    Raises
    ------
    NgspiceMissing
        If it is to be simulated and there is no ngspice: told before the design.
    ProblemError
        If the design did not settle.
    """
    if simulated:
        find_ngspice()
    recipe = None if coordinators else WITHOUT_COORDINATORS
    designed = design(synthesize(problem), recipe=recipe, progress=progress)
    if not designed.settled:
        raise ProblemError(
            f"{problem.name}: the design did not settle in {designed.first.steps} steps, so there "
            "is nothing to build; check that the target is within reach"
            + ("" if coordinators else ", or try --coordinators")
        )
    return designed.network
