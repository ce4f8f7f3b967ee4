"""Settling of a network against its gains, stages, recurrent steps and constraints."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ann_dc.analysis.spectra import spectrum
from ann_dc.backends.ode import OdeBackend
from ann_dc.backends.step_rules import ORDERS
from ann_dc.errors import StudyError
from ann_dc.network.network import Network
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.study.metrics import metric_of
from ann_dc.study.realisation import Realisation
from ann_dc.study.records import Value
from ann_dc.study.sample import Sample
from ann_dc.study.settings import subject_of
from ann_dc.study.study import Study
from ann_dc.study.table import Table
from ann_dc.validation import Count, Index, checked

# ---- gains: is the design optimal, what does a miss cost, and does the spectrum predict both? ----

FACTORS = tuple(10 ** (k / 3) for k in range(-6, 7))
"""Factors on a gain, over four decades."""
TOLERANCE = 1e-6
"""Default residual tolerance of a run."""


def settling_by_spectrum(sample: Sample) -> float:
    """Return ln(1 / tolerance) times radius / |abscissa| at the designed equilibrium.

    The equilibrium is that near the designed point.
    """
    tolerance = float(sample.setting.get("run.tolerance", TOLERANCE))  # type: ignore[arg-type]
    return math.log(1 / tolerance) * sample.equilibrium_spectrum.stiffness_ratio


BY_SPECTRUM = metric_of(settling_by_spectrum, "tau_min")


def settling_against_gains(
    subject: str | OptimalControlProblem | Network,
    *,
    preconditioner: str = "multilevel",
    factors: Sequence[float] = FACTORS,
    gains: Sequence[str] | None = None,
) -> dict[str, Study]:
    """Declare one study per gain, which factors multiply while others stay fixed.

    Times are in fastest time constants (1 / spectral radius) of each network. A gain that makes one
    neuron faster than the hardware therefore does not appear as an improvement.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network. A network keeps its own preconditioner.
    preconditioner : str
        Preconditioner, a value of 'design.preconditioner'. Default "multilevel".
    factors : sequence of float
        Positive factors in ascending order. Default: 0.01 to 100.
    gains : sequence of str, optional
        Gains to vary. Default: 'rho' and the time constant of every population.

    Returns
    -------
    dict of str to Study
        Studies by gain. Metrics: settling, its prediction by the spectrum, and the decay rate at
        the optimum, negative if it is unstable.

    Examples
    --------
    >>> study = settling_against_gains("car", factors=[0.5, 1.0, 2.0])["tau.mu"]
    >>> len(study), study.columns[2:4]
    (3, ('design.preconditioner', 'gains.tau.mu'))
    """
    if gains is None:
        neurons = subject_of(subject).wired.cell.neurons
        gains = ["rho", *dict.fromkeys(f"tau.{neuron.population}" for neuron in neurons)]
    return {
        gain: Study(
            subject=subject,
            vary={f"gains.{gain}": list(factors)},
            fixed={} if isinstance(subject, Network) else {"design.preconditioner": preconditioner},
            metrics=("normalised_settling_time", BY_SPECTRUM, "resting_decay_rate"),
            title=f"Settling against {gain}",
        )
        for gain in gains
    }


def boundaries(table: Table, gain: str) -> tuple[float, ...]:
    """Return the factors on a gain at which the stability of the optimum changes.

    Stability is given by the spectrum. The decay rate is interpolated over the logarithm of the
    factor. The result is empty if the stability does not change.

    Parameters
    ----------
    table : Table
        Result of one study of `settling_against_gains`.
    gain : str
        Name of the gain.

    Examples
    --------
    >>> rates = np.array([-1.0, 1.0, 2.0])
    >>> columns = {"gains.rho": np.array([0.01, 1.0, 100.0]), "resting_decay_rate": rates}
    >>> [round(edge, 3) for edge in boundaries(Table(columns=columns, spec={}), "rho")]
    [0.1]
    """
    factors, rates = np.log(table[f"gains.{gain}"]), table["resting_decay_rate"]
    edges = []
    for (low, before), (high, after) in pairwise(zip(factors, rates)):
        if before * after < 0:
            edges.append(math.exp(low + (high - low) * before / (before - after)))
    return tuple(edges)


# ---- stages: with which power of N do settling and processor time grow? --------------------------

SIZES = (9, 18, 36, 72, 144, 288, 576, 1152)
"""Numbers of stages."""
TRIALS = 3
"""Number of runs, of which the fastest counts."""


def computing_time(sample: Sample) -> float:
    """Return the processor time per network time of an integration, least of three."""
    backend, times = OdeBackend(verify=False), []
    for _ in range(TRIALS):
        began = time.process_time()
        run = backend.run(sample.network)
        times.append((time.process_time() - began) / (run.status.time * sample.spectrum.radius))
    return min(times)


COMPUTING = metric_of(computing_time, "s / fastest time constant")


def settling_against_horizon(
    subject: str | OptimalControlProblem,
    *,
    sizes: Iterable[int] = SIZES,
    duration: float | None = None,
    preconditioner: str = "cyclic-reduction",
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
    preconditioner : str
        Preconditioner, a value of 'design.preconditioner'. Default "cyclic-reduction".
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
        raise StudyError(
            "subject: expected a problem (the stages of a network are fixed), got a network"
        )
    if not isinstance(problem.dt, float) or problem.map is not None:
        raise StudyError(
            f"subject: {problem.name} has no fixed dt that can be shortened; declare it with "
            "dynamics and a number for dt"
        )
    seconds = problem.horizon * problem.dt if duration is None else duration
    studies = {}
    for N in sizes:
        fixed: dict[str, Value] = {
            "problem.N": N,
            "problem.dt": seconds / N,
            "design.preconditioner": preconditioner,
        }
        if rho is not None:
            designed = Realisation(subject_of(subject)).designed(fixed).network
            fixed["gains.rho"] = rho / median_rho(designed)
        studies[N] = Study(
            subject=subject,
            fixed=fixed,
            metrics=("normalised_settling_time", "neurons", COMPUTING),
            title=f"Settling against the number of stages: N = {N}",
        )
    return studies


def median_rho(network: Network) -> float:
    """Return the median penalty over all dual neurons of all stages, in network units.

    Examples
    --------
    >>> from ann_dc import manual_gains, apply_gains, plants, synthesize
    >>> network = synthesize(plants.double_integrator(N=3))
    >>> median_rho(apply_gains(network, manual_gains(network, rho=2.5)))
    2.5
    """
    weights = {c.name: c.weight for c in network.cell.connections}
    return float(np.median([np.median(weights[dual.path]) for dual in network.cell.duals]))


# ---- recurrent steps: which order needs fewest steps, and which is the largest that settles? -----

SHARES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2, 1.35, 1.5)
"""Fixed steps relative to the largest stable step."""


class Steps(NamedTuple):
    """Studies of the same samples with adaptive and with fixed steps.

    `limit` is the largest stable Jacobi step of the designed network, min 2a / (a^2 + b^2) over the
    eigenvalues -a +- ib at its equilibrium, in network time.
    """

    limit: float
    adaptive: Study
    fixed: Study


def settling_against_steps(
    subject: str | OptimalControlProblem,
    *,
    vary: Mapping[str, Any],
    preconditioner: str = "multilevel",
    samples: int = 100,
    shares: Sequence[float] = SHARES,
    limit: int = 3000,
) -> Steps:
    """Declare studies of update orders and steps over the same initial guesses.

    The orders are all neurons at once (Jacobi), primal-then-dual, and stage by stage
    (Gauss-Seidel).

    Parameters
    ----------
    subject : str or OptimalControlProblem
        Plant name or problem.
    vary : mapping of str to pair
        Ranges of sampled settings, such as ``{"input.q_d.x": (4, 6)}``. Random initial guesses and
        targets are equal in all studies.
    preconditioner : str
        Preconditioner, a value of 'design.preconditioner'. Default "multilevel".
    samples : int
        Number of samples. Default 100.
    shares : sequence of float
        Fixed steps relative to the largest stable step of the designed network. Default: `SHARES`.
    limit : int
        Largest number of steps. Default 3000.

    Returns
    -------
    Steps
        Metrics: steps and network time to settle. With adaptive steps also the largest stable step
        at the final state.

    Raises
    ------
    StudyError
        If the design does not settle.

    Examples
    --------
    >>> studies = settling_against_steps("car", vary={"input.q_d.x": (4, 6)}, samples=10)
    >>> len(studies.adaptive), len(studies.fixed) // len(SHARES)
    (30, 30)
    """
    designed = Realisation(subject_of(subject)).designed({"design.preconditioner": preconditioner})
    longest = spectrum(designed.network, designed.settled).largest_step

    def study(steps: Sequence[float | str], words: str, *further: str) -> Study:
        return Study(
            subject=subject,
            vary={"run.order": list(ORDERS), "run.step": list(steps), **vary},
            fixed={
                "design.preconditioner": preconditioner,
                "run.backend": "recurrent",
                "run.limit": limit,
            },
            samples=samples,
            metrics=("settling_steps", "settling_time", *further),
            title=f"Update orders with {words} steps",
        )

    adaptive = study(["adaptive"], "adaptive", "largest_step")
    return Steps(longest, adaptive, study([share * longest for share in shares], "fixed"))


# ---- constraints: what does every constraint that becomes active cost in settling time? ----------

MEASURED = (
    "settling_time",
    "normalised_settling_time",
    "active_rows",
    "predicted_decay_rate",
    "certified",
    "objective",
)


@checked
def tightened(
    subject: str | OptimalControlProblem | Network,
    limits: Mapping[str, Sequence[float]],
    *,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    samples: Count = 1,
    seed: Index = 0,
) -> Study:
    """Declare a study of settling against the number of active constraints.

    The gains are those of the declared limits. The limits are inputs, so the network does not
    change.

    Parameters
    ----------
    subject : str, OptimalControlProblem or Network
        Plant name, problem or network.
    limits : mapping of input to sequence of float
        Values of the inputs that occur in constraints. Every combination is run.
    ranges : mapping of input to (low, high), optional
        Further inputs, such as targets, that are sampled.
    samples : int
        Samples at every combination of limits, equal for all. Default 1.
    seed : int
        Seed of the samples. Default 0.

    Examples
    --------
    >>> import sympy as sp
    >>> from dataclasses import replace
    >>> import ann_dc
    >>> most, problem = sp.symbols("most"), ann_dc.plants.double_integrator(N=10)
    >>> push = {"push": problem.controls[0] <= most}
    >>> limited = replace(problem, inputs={most: 100.0}, constraints=push)
    >>> study = tightened(limited, {"most": [100.0, 3.0, 2.6]})
    >>> study.run(workers=0)["active_rows"].tolist()
    [0, 5, 7]
    """
    listed = {f"input.{name}": [*values] for name, values in limits.items()}
    sampled = {f"input.{name}": (*ends,) for name, ends in (ranges or {}).items()}
    return Study(
        subject=subject,
        vary={**listed, **sampled},
        metrics=MEASURED,
        samples=samples,
        seed=seed,
        title="settling against active constraints",
    )
