"""Settling time and computing time against the number of stages.

The horizon has a constant duration, so a longer network has shorter stages. The study determines
the power of N with which settling time and processor time grow.
"""

from __future__ import annotations

import time
from collections.abc import Iterable

import numpy as np

from ann_dc.backends.ode import OdeBackend
from ann_dc.errors import StudyError
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.metrics import METRICS, Metric, definition_of
from ann_dc.study.realisation import Realisation
from ann_dc.study.records import Value
from ann_dc.study.sample import Sample
from ann_dc.study.settings import subject_of
from ann_dc.study.study import Study

SIZES = (9, 18, 36, 72, 144, 288, 576, 1152)
"""Numbers of stages."""
TRIALS = 3
"""Number of runs, of which the fastest counts."""


def computing_time(sample: Sample) -> float:
    """Return the processor time per network time of an integration, least of three."""
    backend, found = OdeBackend(verify=False), []
    for _ in range(TRIALS):
        began = time.process_time()
        run = backend.run(sample.network)
        found.append((time.process_time() - began) / (run.status.time * sample.spectrum.radius))
    return min(found)


COMPUTING = Metric(
    name="computing_time",
    unit="s / fastest time constant",
    definition=definition_of(computing_time),
    value=computing_time,
)


def settling_against_horizon(
    subject: str | OptimalControlProblem,
    *,
    sizes: Iterable[int] = SIZES,
    duration: float | None = None,
    kind: str = "cyclic-reduction",
    rho: float | None = None,
) -> dict[int, Study]:
    """Declare a study of one case per number of stages, at constant duration.

    Parameters
    ----------
    subject : str or OptimalControlProblem
        Plant name or problem with a fixed step length.
    sizes : iterable of int
        Numbers of stages N. Default: 9 to 1152, doubling.
    duration : float, optional
        Duration of the horizon in the plant's time. By default N times dt of the subject.
    kind : str
        Preconditioner kind, a value of 'design.kind'. Default "cyclic-reduction" (cyclic
        reduction).
    rho : float, optional
        Penalty of every network, the median over its dual neurons as in `median_rho`. By default
        each design chooses its rho.

    Returns
    -------
    dict of int to Study
        Studies by N. Metrics: settling, the number of neurons, and `computing_time`.

    Raises
    ------
    StudyError
        If the step length is a decision variable, or the problem declares discrete dynamics, which
        contain dt.

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
            metrics=(METRICS["normalised_settling_time"], METRICS["neurons"], COMPUTING),
            title=f"Settling against the number of stages: N = {N}",
        )

    return {N: study(N) for N in sizes}


def median_rho(network: Network) -> float:
    """Return the median penalty over all dual neurons of all stages, in network units.

    Parameters
    ----------
    network : Network
        Network with gains.

    Returns
    -------
    float

    Examples
    --------
    >>> from ann_dc import manual_gains, apply_gains, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> median_rho(apply_gains(network, manual_gains(network, rho=2.5)))
    2.5
    """
    weights = {c.name: c.weight for c in network.cell.connections}
    return float(np.median([np.median(weights[dual.path]) for dual in network.cell.duals]))
