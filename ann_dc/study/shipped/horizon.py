"""How settling, and the computing behind it, depend on the number of stages.

The question: a longer row of cells, over the same time of the plant; does it take longer to settle,
by which power of N, and what does a processor pay for it?
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import StudyError
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.metrics import METRICS, Metric
from ann_dc.study.realisation import Realisation
from ann_dc.study.records import Value
from ann_dc.study.sample import Sample
from ann_dc.study.settings import subject_of
from ann_dc.study.study import Study

SIZES = (9, 18, 36, 72, 144, 288, 576, 1152)
"""Numbers of stages."""
TRIALS = 3
"""Runs of which the quickest counts."""


def computing_time(sample: Sample) -> float:
    """Processor time of an integration over the network time that it covers, least of three."""
    backend, found = OdeBackend(verify=False), []
    for _ in range(TRIALS):
        began = time.process_time()
        run = backend.run(sample.network)
        found.append((time.process_time() - began) / (run.status.time * sample.spectrum.radius))
    return min(found)


COMPUTING = Metric(
    name="computing_time",
    unit="s / fastest time constant",
    definition=" ".join((computing_time.__doc__ or "").split()),
    value=computing_time,
)


def settling_against_horizon(
    subject: str | OptimalControlProblem,
    *,
    sizes: Iterable[int] = SIZES,
    duration: float | None = None,
    kind: str = "tree",
    rho: float | None = None,
) -> dict[int, Study]:
    """A study of one point for every number of stages, over the same time of the plant.

    Parameters
    ----------
    subject : str or OptimalControlProblem
        With a fixed step length.
    sizes : iterable of int
        Numbers of stages N.
    duration : float, optional
        Of the horizon, in the plant's time; N times dt of the subject by default.
    kind : str
        Metric of the designs, a word of 'design.kind'.
    rho : float, optional
        Of every network, the median over its duals as in `median_rho`; by default each design
        chooses its own.

    Returns
    -------
    dict of int to Study
        By N. Measured: settling, the number of neurons, and `computing_time`.

    Raises
    ------
    StudyError
        If the step length is a decision, or the problem declares its map, which has dt within.

    Examples
    --------
    >>> studies = settling_against_horizon("car", sizes=[9, 18])
    >>> [round(study.fixed["problem.dt"], 3) for study in studies.values()]
    [0.1, 0.05]
    """
    problem = subject_of(subject).problem
    if problem is None:
        raise StudyError("subject: a network has the stages that it has; give the problem")
    if not isinstance(problem.dt, float) or problem.map is not None:
        raise StudyError(
            f"subject: {problem.name} has no fixed dt that can be shortened; declare it with "
            "dynamics and a number for dt"
        )
    seconds = problem.horizon * problem.dt if duration is None else duration

    def study(N: int) -> Study:
        fixed: dict[str, Value] = {"problem.N": N, "problem.dt": seconds / N, "design.kind": kind}
        if rho is not None:
            own = Realisation(subject_of(subject)).designed(fixed).network
            fixed["gains.rho"] = rho / median_rho(own)
        return Study(
            subject=subject,
            fixed=fixed,
            metrics=(METRICS["settling_in_fastest"], METRICS["neurons"], COMPUTING),
            title=f"Settling against the number of stages: N = {N}",
        )

    return {N: study(N) for N in sizes}


def median_rho(network: Network) -> float:
    """Penalty of a network: the median over all dual neurons of all stages, in network units.

    Parameters
    ----------
    network : Network

    Examples
    --------
    >>> from ann_dc import hand_gains, apply_gains, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> median_rho(apply_gains(network, hand_gains(network, rho=2.5)))
    2.5
    """
    weights = {c.name: c.weight for c in network.cell.connections}
    return float(np.median([np.median(weights[dual.path]) for dual in network.cell.duals]))
