"""Design over an operating range: one network with fixed gains for its inputs.

The network settles for all or nearly all inputs. The design has four steps:

1. Settled points of a space-filling sample of the inputs, each from the straight line between its
   ends.
2. Candidates of every preconditioner kind, derived from the first point or from the mean of all
   points, with several penalties, path terms and multiplier rates.
3. Successive screening (`race`): trial runs from the starts of more and more inputs.
4. Validation (`validated`) on inputs that no selection has used.

A fraction is reported with its Clopper-Pearson interval, and a failed sample with its reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Annotated

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.spectra import spectrum
from ann_dc.decomposition.equations import decompose
from ann_dc.errors import DesignError, such_as
from ann_dc.evaluation.reference import evaluator
from ann_dc.families.family import Family, Over, Sample, family_of
from ann_dc.families.race import GRIDS, LIMIT, ROUNDS, Runner, entered, raced, run_on, run_sample
from ann_dc.gain_design.gain_rule import GAIN_RULES, MULTILEVEL_RULE
from ann_dc.gain_design.gains import Gains, apply_gains
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.scheduled_run import first_run
from ann_dc.gain_design.trial_run import ELSEWHERE, Pace, distance
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import ALL_KINDS, Kinds, PreconditionerKind, several
from ann_dc.optimality.existence import Prospect
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.progress import Progress, silent
from ann_dc.solution.knowledge import knowledge_of
from ann_dc.solution.solution import certificate_of
from ann_dc.summaries import summarised
from ann_dc.synthesis.synthesis import synthesize
from ann_dc.validation import Own, checked

# ---- validation: fraction of unseen inputs that settle to a certified optimum -------------------

CERTIFIABLE = 3e-10
"""KKT residual of an evaluated run, well below that of a certificate, which is computed in the
scales of the sample instead of those of the network.
"""
CONFIDENCE = 0.95
"""Confidence level of the interval of a fraction."""
LONGEST_SEARCH = 20_000
"""Step limit of the gain-scheduled run that searches a settled point of a failed input."""


class Failure(Enum):
    """Reason for which a network does not settle to a certified optimum for an input."""

    OUTSIDE_BASIN = "the initial guess is outside the region of attraction of the optimum"
    PENALTY = "the penalty is too small: the optimum is unstable"
    LOST = "leaves the domain of a function, or diverges"
    NO_POINT = "no settled point was found with any gains (possibly infeasible)"
    NO_OPTIMUM = "settles at a point that is not a certified optimum"
    SLOW = f"not settled after {LIMIT:g} tau_min"


@dataclass(frozen=True, kw_only=True, eq=False)
class Validation:
    """Behaviour of a network with fixed gains for many inputs.

    `settling` (samples,) is the settling time to a KKT residual of 1e-6, in fastest time constants;
    infinite if it did not settle. `objectives` (samples,) are in the user's units; nan if the run
    did not settle. `failures` has the reason for every sample that is not certified. `drawn` is
    False if the samples are the whole operating range instead of independent draws.
    """

    samples: list[Sample]
    settling: np.ndarray
    certified: np.ndarray
    objectives: np.ndarray
    failures: dict[int, Failure]
    drawn: bool = True

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def inputs(self) -> str:
        """Name of the samples in reports."""
        return "held-out inputs" if self.drawn else "listed inputs"

    @property
    def share(self) -> float:
        """Fraction of the samples that settle to a certified optimum."""
        return float(self.certified.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper-Pearson interval of the fraction, at 95 %.

        For listed inputs both limits are the fraction itself.

        References
        ----------
        .. [1] C. J. Clopper, E. S. Pearson, The use of confidence or fiducial limits illustrated in
           the case of the binomial, Biometrika 26, 1934, 404-413.
        """
        if not self.drawn:
            return self.share, self.share
        from scipy import stats  # loads slowly, and few need it

        low, high = stats.binomtest(int(self.certified.sum()), len(self)).proportion_ci(
            CONFIDENCE, "exact"
        )
        return float(low), float(high)

    def settling_quantile(self, share: float) -> float:
        """Return the settling time in fastest time constants of a fraction of the samples.

        Only certified samples count.
        """
        good = self.settling[self.certified]
        return float(np.quantile(good, share)) if len(good) else float("nan")

    def __str__(self) -> str:
        low, high = self.interval
        sure = f"{low:.1%} to {high:.1%}, 95 % confidence" if self.drawn else "the whole list"
        lines = [
            f"{self.inputs:23}{self.certified.sum()} of {len(self)} settle to a certified "
            f"optimum: {self.share:.1%} ({sure})",
            f"settling               median {self.settling_quantile(0.5):.0f}, 99 of 100 within "
            f"{self.settling_quantile(0.99):.0f}, all within {self.settling_quantile(1.0):.0f} "
            "tau_min (fastest time constant)",
        ]
        for failure, count in Counter(self.failures.values()).most_common():
            number = next(i for i, found in self.failures.items() if found is failure)
            lines.append(f"  {count} fail: {failure.value}; e.g. {described(self.samples[number])}")
        return "\n".join(lines)


def described(sample: Sample) -> str:
    """Return a sample as text: ``q_d.x = 3.2, q_0.phi = 0.1``."""
    each = (
        f"{name} = {value[0]:.4g}" if np.ptp(value) == 0 else f"{name} = {value[0]:.4g} ..."
        for name, value in sample.items()
    )
    return ", ".join(each)


def validated(
    family: Family, pace: Pace, samples: Sequence[Sample], progress: Progress = silent
) -> Validation:
    """Run the fixed network for every sample and certify the final states.

    `progress` receives one line per sample.
    """
    tape = evaluator(family.network).tape
    settling, objectives = np.full((2, len(samples)), np.nan)
    certified, failures = np.zeros(len(samples), bool), {}
    with np.errstate(all="ignore"):  # a run that overflows is data
        for number, sample in enumerate(samples):
            progress(f"validation: input {number} of {len(samples)}, {len(failures)} failed")
            network = family.network_of(sample)
            settling[number], x, lost = run_sample(network, tape, pace)
            if not np.isfinite(settling[number]):
                failures[number] = why(network, x, lost=lost)
                continue
            run_on(network, tape, pace, x, CERTIFIABLE)
            certificate = certificate_of(family.problem_of(sample), network, x)
            objectives[number] = certificate.objective
            certified[number] = certificate.certified
            if not certificate.certified:
                failures[number] = Failure.NO_OPTIMUM
    return Validation(
        samples=list(samples),
        settling=settling,
        certified=certified,
        objectives=objectives,
        failures=failures,
        drawn=not family.is_listed,
    )


def why(network: Network, x: np.ndarray, *, lost: bool) -> Failure:
    """Return the reason for which a network with fixed gains did not settle.

    `network` has its inputs and its start, and the run ended at `x` (n,). `lost` is True if the run
    diverged or left the domain of a function.
    """
    search = first_run(network, MULTILEVEL_RULE, limit=LONGEST_SEARCH)
    if not search.settled:
        return Failure.LOST if lost else Failure.NO_POINT
    if not spectrum(network, search.state).abscissa < 0:
        return Failure.PENALTY
    if lost:
        return Failure.LOST
    settled = SettledPoint(Linearisation(network).at(search.state), search.state)
    return Failure.SLOW if distance(settled, x) < ELSEWHERE else Failure.OUTSIDE_BASIN


# ---- design -------------------------------------------------------------------------------------

POINTS = 16
"""Number of inputs from whose settled points the gains are derived."""
GOAL = 0.995
"""Fraction of screened inputs from which slower preconditioner kinds are not tried."""
LONGEST_RUN = 20_000
"""Step limit of the gain-scheduled run of one input."""
HELD_OUT = 1000
"""Number of inputs in the validation."""


@such_as("ann_dc.design(problem, ranges=...)")
@checked
@summarised(
    lambda self: {
        "network": self.network.title,
        "preconditioner": self.gains.preconditioner.kind.value,
        "validation": self.validation,
    }
)
@dataclass(frozen=True, kw_only=True, eq=False)
class FamilyDesign:
    """Network designed for an operating range, with its validation.

    Attributes
    ----------
    network : Network
        Network with fixed gains; it stores the ranges of its design.
    family : Family
        Operating range with this network.
    gains : Gains
        Gains of the network.
    winner : Runner
        Selected candidate, with its settling on the inputs of the screening.
    points : int
        Number of inputs from whose settled points gains were derived.
    validation : Validation
        Validation on held-out inputs; for a listed range, on the list itself.

    Examples
    --------
    >>> from ann_dc import plants
    >>> listed = [{"q_0.x": -0.5}, {"q_0.x": 0.5}]
    >>> designed = design_family(plants.double_integrator(N=3), listed)
    >>> len(designed.validation), designed.validation.share
    (2, 1.0)
    """

    network: Network
    family: Family
    gains: Gains
    winner: Runner
    points: int
    validation: Validation

    def __str__(self) -> str:
        ranges = ", ".join(
            f"{name} from {low:.4g} to {high:.4g}"
            for name, (low, high) in self.family.ranges.items()
        )
        return "\n".join(
            [
                f"family                 {ranges}",
                f"network                {self.winner}",
                f"settled points         {self.points} settled points",
                str(self.validation),
            ]
        )


@checked
def design_family(
    problem: OptimalControlProblem,
    ranges: Annotated[Over, Own()],
    *,
    preconditioner: Kinds = ALL_KINDS,
    held_out: int = HELD_OUT,
    seed: int = 0,
    progress: Progress = silent,
) -> FamilyDesign:
    """Design gains with which one network settles over a whole operating range.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem whose inputs count as one sample; they set the scales of the network.
    ranges : Over
        Operating range; see `family_of`.
    preconditioner : PreconditionerKind, str, or iterable of these
        Preconditioner kinds to choose from. Default: all.
    held_out : int
        Number of inputs in the validation. Default 1000.
    seed : int
        Seed of all samples: the same seed gives the same network. Default 0.
    progress : Progress
        Receives one line per step. Default: silent.

    Returns
    -------
    FamilyDesign
        Network with fixed gains and its validation.

    Raises
    ------
    DesignError
        If no input leads to a settled point, or no candidate is stable at those found.
    ProblemError
        If a range is empty, or a sample has a value that is not a number.
    UnknownNameError
        If the network does not have an input.

    Examples
    --------
    >>> from ann_dc import plants
    >>> designed = design_family(
    ...     plants.double_integrator(N=3), {"q_d.x": (0.5, 2.0)}, held_out=20)
    >>> designed.validation.share
    1.0
    """
    if held_out < 1:
        raise DesignError(f"held_out: expected a number of inputs of at least 1, got {held_out!r}")
    family = family_of(problem, synthesize(decompose(problem)), ranges)
    points, penalty_factor = _settled_points(family, seed, progress)
    networks = [
        family.network_of(sample) for sample in family.samples(ROUNDS[-1][0], seed=seed + 1)
    ]
    winner = _winner(points, penalty_factor, networks, several(preconditioner), progress)
    network = replace(apply_gains(family.network, winner.gains), ranges=dict(family.ranges))
    frozen = replace(family, network=network)
    seen = family.held_out(held_out, seed=seed + 2)
    judged = replace(frozen, network=replace(network, ranges={}))  # a sampler may go beyond
    return FamilyDesign(
        network=network,
        family=frozen,
        gains=winner.gains,
        winner=winner,
        points=len(points),
        validation=validated(judged, winner.pace, seen, progress),
    )


def _settled_points(
    family: Family, seed: int, progress: Progress
) -> tuple[list[SettledPoint], float]:
    """Return settled points of problem and inputs, and the largest penalty factor."""
    samples: list[Sample] = [{}, *family.samples(POINTS - 1, seed=seed)[: POINTS - 1]]
    points, penalty_factor, why = [], 1.0, ""
    with np.errstate(all="ignore"):  # a run that overflows is data
        for number, sample in enumerate(samples, 1):
            progress(f"settled point {number} of {len(samples)}")
            network = family.network_of(sample) if sample else family.network
            prospect = Prospect(problem=family.problem_of(sample), progress=progress)
            found = first_run(
                network,
                MULTILEVEL_RULE,
                limit=LONGEST_RUN,
                progress=progress,
                knowledge=knowledge_of(prospect, network),
            )
            if found.ended is not None:
                why = f"{described(sample)}: {found.ended}" if sample else str(found.ended)
            elif found.settled:
                points.append(SettledPoint(Linearisation(network).at(found.state), found.state))
                penalty_factor = max(penalty_factor, found.penalty_factor)
    if not points:
        raise DesignError(
            f"ranges: none of {len(samples)} inputs leads to a settled point "
            f"({why or described(samples[-1])}); check that the ranges contain feasible inputs"
        )
    return points, penalty_factor


def _winner(
    points: list[SettledPoint],
    penalty_factor: float,
    networks: list[Network],
    kinds: tuple[PreconditionerKind, ...],
    progress: Progress,
) -> Runner:
    """Return the best candidate; kinds are tried fastest first until `GOAL` is met."""
    best: Runner | None = None
    tried = {*kinds}
    if tried >= {*GRIDS}:  # the same preconditioner
        tried.remove(PreconditionerKind.CYCLIC_REDUCTION)
    with np.errstate(all="ignore"):
        for kind in (kind for kind in GAIN_RULES if kind in tried):
            runners = entered(points, kind, penalty_factor)
            if runners:
                raced_best = raced(runners, networks, progress)
                best = raced_best if best is None else min(best, raced_best, key=lambda r: r.rank)
            if best is not None and best.share >= GOAL:
                break
    if best is None:
        raise DesignError(
            "ranges: no network is stable at all settled points of these ranges; narrow them, "
            "or allow other preconditioners"
        )
    return best
