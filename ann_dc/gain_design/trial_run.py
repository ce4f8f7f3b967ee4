"""The rehearsal: does a network with constant gains settle from its start, and how fast?

A spectrum knows the neighbourhood of the settled point; whether the start lies in its basin, and
what the way there costs, only a run can say. Candidates are rehearsed with forward Euler steps that
are small against the fastest mode of the moment, those with the smallest ratio first, until no
other can be faster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ann_dc.analysis.spectra import Spectrum
from ann_dc.evaluation.codegen.evaluator import FastEvaluator
from ann_dc.evaluation.domains import Bounds
from ann_dc.evaluation.rules import RAN, SETTLED, SMALLEST_POSITION
from ann_dc.gain_design.candidates import LONG_ROW, Candidate, spectrum_with
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.progress import Paced, Progress, silent
from ann_dc.timing import phase

STEP = 0.2
"""Step, as a share of the largest that is stable at the settled point; shorter where stiffer."""
CHUNK = 100
"""Steps after which the fastest rate is looked at again."""
TOLERANCE = 1e-4
"""KKT residual at which a rehearsal has shown that the start lies in the basin."""
SETTLING = 1e-6
"""KKT residual to which the settling time is extrapolated, with the slowest mode."""
TRANSIENT = 500.0
"""Fastest time constants that the way to the neighbourhood of the settled point may take."""
PATIENCE = 3.0
"""How many times the predicted settling is waited for beyond that."""
AT_BEST = 0.5
"""Settling over its prediction, at best: what cannot win even so is not rehearsed. On a long row,
where a rehearsal takes seconds, settling and prediction are taken for the same."""
STUCK, EARLY = 1e-3, 0.2
"""Share of the time that may pass, below which a rehearsal is given up after a share of its steps.

In a fifth of its steps one that is to settle has come ten times as far."""
ELSEWHERE = 0.05
"""Distance, relative to the largest primal neuron, from which on a run has ended elsewhere."""


class Patience(NamedTuple):
    """Effort that rehearsals may take.

    Attributes
    ----------
    steps : int
        After which a rehearsal is given up.
    failures : int
        Rehearsals of candidates of one kind, with one factor on inequality rows, that may fail
        before the others are given up.
    """

    steps: int
    failures: int


PATIENT = Patience(steps=60_000, failures=3)
"""For settled points that the network itself has found."""
HASTY = Patience(steps=10_000, failures=4)
"""For points that a search found, where presets remain to be tried."""


def rehearse(
    settled: SettledPoint,
    candidate: Candidate,
    within: float = np.inf,
    progress: Progress = silent,
    patience: Patience = PATIENT,
) -> Candidate:
    """Run a network with a candidate's constant gains from its start.

    Parameters
    ----------
    settled : SettledPoint
        Where it should settle.
    candidate : Candidate
        With a finite ratio.
    within : float
        Fastest time constants after which it is of no use any more.
    progress : Progress
        Takes a line every now and then, if it takes long.
    patience : Patience

    Returns
    -------
    Candidate
        With its settling, and where it strayed to.
    """
    network, pace = settled.network, Pace.of(candidate.spectrum)
    trial = settled.trial(candidate.gains)
    rest = candidate.ratio * np.log(TOLERANCE / SETTLING)
    due = candidate.ratio * np.log(1 / TOLERANCE)
    limit = min(TRANSIENT + PATIENCE * due, within - rest)
    x = network.start_state.copy()
    elapsed, outcome = run_with_constants(
        trial,
        x,
        pace,
        limit=limit,
        tolerance=TOLERANCE,
        progress=progress,
        longest=patience.steps,
    )
    if outcome != SETTLED:
        return replace(candidate, settling=np.inf)
    if distance(settled, x) > ELSEWHERE:
        return replace(candidate, settling=np.inf, stray=x)
    return replace(candidate, settling=elapsed + rest)


class Pace(NamedTuple):
    """How fast a frozen network is, near where it settles.

    Attributes
    ----------
    radius : float
        Rate of its fastest mode: one over the fastest time constant.
    step : float
        Of forward Euler, small against that mode.
    """

    radius: float
    step: float

    @classmethod
    def of(cls, *spectra: Spectrum) -> Pace:
        """That of a network at one settled point, or at the stiffest of several."""
        step = STEP * min(spectrum.largest_step for spectrum in spectra)
        return cls(radius=max(spectrum.radius for spectrum in spectra), step=step)


def run_with_constants(
    trial: FastEvaluator,
    x: np.ndarray,
    pace: Pace,
    *,
    limit: float,
    tolerance: float,
    progress: Progress = silent,
    longest: int = PATIENT.steps,
) -> tuple[float, int]:
    """Forward Euler steps, small against the fastest mode of the moment.

    Parameters
    ----------
    trial : FastEvaluator
        Of a network with constant gains.
    x : (n,) array
        Where it starts; overwritten by where it ends.
    pace : Pace
    limit : float
        Fastest time constants after which it is given up.
    tolerance : float
        KKT residual at which it has settled.
    progress : Progress
        Takes a line every now and then.
    longest : int
        Steps after which it is given up.

    Returns
    -------
    elapsed : float
        Fastest time constants.
    outcome : int
        `RAN`, `SETTLED` or `LOST`.
    """
    free = np.full(len(x), np.inf)
    guard = trial.domain_guard(x)
    rails = trial.tape.limits[trial.tape.places[:, 0]]
    bounds = Bounds(slew=free, box=rails, guard=guard)
    elapsed, steps, outcome, told = 0.0, 0, RAN, Paced(progress)
    while outcome == RAN and elapsed < limit and steps < longest:
        if steps >= EARLY * longest and elapsed < STUCK * limit:
            break
        stiffer = max(trial.fastest_rate(x, iterations=8) / pace.radius, 1.0)
        step = pace.step / stiffer
        done, _, outcome = trial.recur(x, step, bounds, count=CHUNK, tolerance=tolerance)
        elapsed, steps = elapsed + done * step * pace.radius, steps + CHUNK
        told(lambda: f"freeze: rehearsed {elapsed:.0f} fastest time constants")  # noqa: B023
    return elapsed, outcome


def distance(settled: SettledPoint, x: np.ndarray) -> float:
    """Return the distance of a state (n,) from the settled point, over the primal neurons.

    It is relative to the largest of them, and to `SMALLEST_POSITION` at least.
    """
    primal = settled.linear.primal[settled.network.places[:, 0]]
    aim = settled.state[primal]
    return float(np.abs(x[primal] - aim).max() / max(np.abs(aim).max(), SMALLEST_POSITION))


def at_another(settled: SettledPoint, candidate: Candidate) -> Candidate:
    """The same gains at another settled point, not rehearsed yet.

    Parameters
    ----------
    settled : SettledPoint
        The other one.
    candidate : Candidate
    """
    found = spectrum_with(settled, candidate.gains)
    return Candidate(
        recipe=candidate.recipe, boost=candidate.boost, gains=candidate.gains, spectrum=found
    )


@phase("rehearsals")
def rehearsed(
    settled: SettledPoint,
    candidates: Iterable[Candidate],
    progress: Progress = silent,
    *,
    take: Callable[[Candidate], None] = lambda candidate: None,
    patience: Patience = PATIENT,
) -> tuple[Candidate, ...]:
    """Candidates with how they settled from the start, the best first.

    Parameters
    ----------
    settled : SettledPoint
        Where they should settle.
    candidates : iterable of Candidate
        One or more; those that have been rehearsed are not rehearsed again.
    progress : Progress
        Takes one line a rehearsal.
    take : callable
        Takes every candidate as soon as it is rehearsed.
    patience : Patience

    Returns
    -------
    tuple of Candidate
        Those that settled, fastest first; then all others, smallest ratio first. One that cannot
        be the fastest, by its ratio, is not rehearsed, nor a kind that keeps failing.
    """
    fastest, seen, failures = np.inf, [], dict[object, int]()
    at_best = 1.0 if settled.network.stages > LONG_ROW else AT_BEST
    for number, candidate in enumerate(sorted(candidates, key=lambda found: found.rank[1]), 1):
        expected = at_best * candidate.ratio * np.log(1 / SETTLING)
        pace = Pace.of(candidate.spectrum)
        is_long = not expected < patience.steps * pace.step * pace.radius
        own = candidate.kind, candidate.recipe.inequality
        has_failed = failures.get(own, 0) >= patience.failures
        hopeless = is_long or has_failed or not expected < fastest
        if np.isnan(candidate.settling) and not hopeless:
            progress(f"freeze: rehearsal {number}")
            candidate = rehearse(settled, candidate, fastest, progress, patience)
            take(candidate)
            if candidate.settling == fastest == np.inf:
                failures[own] = failures.get(own, 0) + 1
        fastest = min(fastest, candidate.rank[0])
        seen.append(candidate)
    return tuple(sorted(seen, key=lambda found: found.rank))
