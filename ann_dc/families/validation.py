"""Validation: on inputs that no choice has seen, what share settles to a certified optimum?

A share is told with its Clopper-Pearson interval; a sample that fails is told with the reason.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.spectra import spectrum
from ann_dc.evaluation.reference import evaluator
from ann_dc.families.family import Family, Sample
from ann_dc.families.race import LIMIT, run_on, run_sample
from ann_dc.gain_design.rehearsal import ELSEWHERE, Pace, distance
from ann_dc.gain_design.rules.grid_gains import SettledPoint
from ann_dc.gain_design.rules.recipe import WITH_COORDINATORS
from ann_dc.gain_design.scheduled_run import first_run
from ann_dc.network.network import Network
from ann_dc.progress import Progress, silent
from ann_dc.solution.solution import certificate_of

CERTIFIABLE = 3e-10
"""KKT residual at which a run is judged: well below that of a certificate, which is taken in the
scales of the sample and not in those of the network."""
CONFIDENCE = 0.95
"""Of the interval about a share."""
LONGEST_SEARCH = 20_000
"""Steps of the first run that looks for a settled point of an input that failed."""


class Failure(Enum):
    """Why a network does not settle to a certified optimum for an input."""

    OUTSIDE_BASIN = "its optimum attracts, but the start lies outside the basin"
    PENALTY = "the penalty is too small there: its optimum repels"
    LOST = "it leaves the domain of a function, or diverges, on the way"
    NO_POINT = "no settled point was found, with any gains: is it feasible?"
    NO_OPTIMUM = "it settles to a point that is no certified optimum"
    SLOW = f"it is on its way, but not there after {LIMIT:g} fastest time constants"


@dataclass(frozen=True, kw_only=True, eq=False)
class Validation:
    """What a frozen network does for many inputs.

    Attributes
    ----------
    samples : list of Sample
    settling : (samples,) array
        Fastest time constants to a KKT residual of 1e-6; infinite where it did not settle.
    certified : (samples,) array of bool
    objectives : (samples,) array
        In the user's units; nan where it did not settle.
    failures : dict of int to Failure
        Why, for every sample that is not certified.
    drawn : bool
        True if the samples are independent draws, False if they are the whole family.
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
        """Of the samples that settle to a certified optimum."""
        return float(self.certified.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Clopper-Pearson interval of the share, at 95 %; the share itself of a whole family.

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
        """Fastest time constants within which a share of the certified samples settles."""
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
            "fastest time constants",
        ]
        for failure, count in Counter(self.failures.values()).most_common():
            number = next(i for i, found in self.failures.items() if found is failure)
            lines.append(f"  {count} fail: {failure.value}; e.g. {told(self.samples[number])}")
        return "\n".join(lines)


def told(sample: Sample) -> str:
    """A sample in words: ``q_d.x = 3.2, q_0.phi = 0.1``."""
    each = (
        f"{name} = {value[0]:.4g}" if np.ptp(value) == 0 else f"{name} = {value[0]:.4g} ..."
        for name, value in sample.items()
    )
    return ", ".join(each)


def validated(
    family: Family, pace: Pace, samples: Sequence[Sample], progress: Progress = silent
) -> Validation:
    """Run a family's frozen network for every sample, and certify what it settles to.

    Parameters
    ----------
    family : Family
        Whose network has its constants.
    pace : Pace
    samples : sequence of Sample
    progress : Progress
        Takes one line a sample.

    Returns
    -------
    Validation
    """
    tape = evaluator(family.network).tape
    settling, objectives = np.full((2, len(samples)), np.nan)
    certified, failures = np.zeros(len(samples), bool), {}
    with np.errstate(all="ignore"):  # a run that overflows is data
        for number, sample in enumerate(samples):
            progress(f"validation: input {number} of {len(samples)}, {len(failures)} failed")
            network = family.network_of(sample)
            settling[number], x, lost = run_sample(network, tape, pace)
            if np.isfinite(settling[number]):
                run_on(network, tape, pace, x, CERTIFIABLE)
                certificate = certificate_of(family.problem_of(sample), network, x)
                objectives[number] = certificate.objective
                certified[number] = certificate.certified
            if np.isfinite(settling[number]) and not certified[number]:
                failures[number] = Failure.NO_OPTIMUM
            elif not certified[number]:
                failures[number] = why(network, x, lost=lost)
    return Validation(
        samples=list(samples),
        settling=settling,
        certified=certified,
        objectives=objectives,
        failures=failures,
        drawn=not family.is_listed,
    )


def why(network: Network, x: np.ndarray, *, lost: bool) -> Failure:
    """Why a frozen network did not settle.

    Parameters
    ----------
    network : Network
        With its inputs and its start.
    x : (n,) array
        Where its run ended.
    lost : bool
        Whether it diverged there, or left the domain of a function.

    Returns
    -------
    Failure
    """
    found = first_run(network, WITH_COORDINATORS, limit=LONGEST_SEARCH)
    if not found.settled:
        return Failure.LOST if lost else Failure.NO_POINT
    if not spectrum(network, found.state).abscissa < 0:
        return Failure.PENALTY
    if lost:
        return Failure.LOST
    settled = SettledPoint(Linearisation(network).at(found.state), found.state)
    return Failure.SLOW if distance(settled, x) < ELSEWHERE else Failure.OUTSIDE_BASIN
