"""The rehearsal: does a network with constant gains settle from its start, and how fast?

A spectrum knows the neighbourhood of the settled point; whether the start lies in its basin, and
what the way there costs, only a run can say. Candidates are rehearsed with forward Euler steps that
are small against the fastest mode of the moment, those with the smallest ratio first, until no
other can be faster.

Freezing a network: which metric, which row weights and which penalty make the best constants.

The closed form is evaluated once more at the settled point, for every kind of metric that the
caller allows: a pyramid and time constants alone with a few penalties, by octaves, and a grid with
a few weights of its path term; each with equal and with equilibrated rows. What is compared is the
ratio of the spectrum; which one is taken is for the rehearsal to say (`rehearsal`). Above
`LONG_ROW` stages, where every spectrum takes long, one choice is made after the other.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ann_dc.analysis.linearisation import MeanLinearisation
from ann_dc.analysis.spectra import Spectrum, spectrum_of
from ann_dc.errors import AnnDcError
from ann_dc.evaluation.codegen.evaluator import FastEvaluator
from ann_dc.evaluation.domains import Bounds
from ann_dc.evaluation.rules import RAN, SETTLED, SMALLEST_POSITION
from ann_dc.gain_design.gain_rule import RECIPES, SWEEPS, Recipe, closed_form, weights_of_rows
from ann_dc.gain_design.gains import Gains, check_gains, row_with
from ann_dc.gain_design.grid_gains import SettledPoint, grid_gains_of
from ann_dc.network.preconditioners.base import Kind
from ann_dc.progress import Paced, Progress, Stopped, silent
from ann_dc.timing import phase

PATHS = (0.3, 1.0, 0.1, 0.03)
"""Weights of a grid's path term that are compared."""

FINER, FINEST, HELPS = 3.0, 3, 2 / 3
"""Factor by which the smallest path term falls further, at most how often, and the factor by which
the ratio has to fall each time: where the start is far from the optimum, the term rules."""

GENTLE = 0.1
"""Factor on the weights of inequality rows of grids that are compared too: rows that press on the
way and not at the end are in no stiffness, and many of them are stiff together."""

LONG_ROW = 128
"""Stages above which weights of rows are compared at one path term or one penalty only, and the
first network that settles is taken, if no other can be faster by its ratio."""

HALF_OCTAVE = 2**0.5

LARGEST_FACTOR = 1024.0
"""How far from the first run's penalty the freeze may go, either way, before the last octave."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One way to freeze a network.

    Attributes
    ----------
    recipe : Recipe
    boost : float
        Factor on every penalty of the recipe.
    gains : Gains
        What the recipe gives at the settled point; refined ones are near it.
    spectrum : Spectrum
        Of the network with these gains, at the settled point.
    settling : float
        Fastest time constants in which a rehearsal settled from the start; infinite where it did
        not, or not before another one had; nan where there was none.
    stray : (n,) array or None
        Where a rehearsal ended that settled to another point.
    """

    recipe: Recipe
    boost: float
    gains: Gains
    spectrum: Spectrum
    settling: float = float("nan")
    stray: np.ndarray | None = None

    @property
    def kind(self) -> Kind:
        """Of the metric; a row too short for a pyramid has time constants alone."""
        return self.gains.metric.kind

    @property
    def ratio(self) -> float:
        """Of the spectrum at the settled point; infinite when it repels."""
        return self.spectrum.ratio

    @property
    def rank(self) -> tuple[float, float]:
        """What a design makes small: the settling, then the ratio, to six digits of each."""
        settling = np.inf if np.isnan(self.settling) else self.settling  # unknown comes last
        return float(f"{settling:.6g}"), float(f"{self.ratio:.6g}")

    def __str__(self) -> str:
        start = "rows by reach" if self.recipe.by_reach else "equal rows"
        rows = f"rows of {self.recipe.sweeps} sweeps" if self.recipe.sweeps else start
        path = f", path {self.recipe.path:g}" if self.kind in (Kind.GRID, Kind.TREE) else ""
        if self.recipe.inequality != 1:
            rows += f", inequalities x {self.recipe.inequality:g}"
        return f"{self.kind.value}, {rows}{path}, penalty x {self.boost:g}: ratio {self.ratio:.3g}"


def gains_of(points: Sequence[SettledPoint], recipe: Recipe, boost: float) -> Gains:
    """What a recipe gives at a settled point, or at several that one network is to have.

    Parameters
    ----------
    points : sequence of SettledPoint
        Of networks that differ in their inputs.
    recipe : Recipe
    boost : float
        Factor on every penalty.

    Returns
    -------
    Gains

    Raises
    ------
    DesignError
        If a grid's penalty lies below rho*, or its settled point is not isolated.
    """
    if len(points) == 1:
        linear, weights = points[0].linear, points[0].row_weights(recipe)
    else:
        linear = MeanLinearisation([settled.linear for settled in points])
        weights = weights_of_rows(linear, recipe)
    if recipe.kind not in (Kind.GRID, Kind.TREE):
        return closed_form(linear, recipe, boost)
    return grid_gains_of(points, weights, recipe, boost)


def candidate_of(
    settled: SettledPoint, recipe: Recipe, boost: float, progress: Progress = silent
) -> Candidate:
    """The network frozen by a recipe, with its spectrum at the settled point.

    Parameters
    ----------
    settled : SettledPoint
    recipe : Recipe
    boost : float
        Factor on every penalty of the recipe.
    progress : Progress
        Takes a line every now and then.

    Returns
    -------
    Candidate

    Raises
    ------
    DesignError, NetworkError
        If there is no grid at this point, or it is not positive definite.
    """
    gains = gains_of([settled], recipe, boost)
    found = spectrum_with(settled, gains, progress)
    return Candidate(recipe=recipe, boost=boost, gains=gains, spectrum=found)


def spectrum_with(settled: SettledPoint, gains: Gains, progress: Progress = silent) -> Spectrum:
    """Spectrum at a settled point of its network with other gains, of which only a tape is made.

    Parameters
    ----------
    settled : SettledPoint
    gains : Gains
    progress : Progress
        Takes a line every now and then, of a long row.

    Returns
    -------
    Spectrum

    Raises
    ------
    DesignError, NetworkError
        If no network can have these gains, or their metric is not positive definite.
    """
    network = settled.network
    check_gains(network, gains)
    trial = settled.trial(gains)
    row, state = row_with(network, gains), settled.state
    found = spectrum_of(trial, gains.metric, row, state, progress=progress)
    moving = (
        found.moving()
    )  # the others are multipliers of dependent rows, if primal neurons are not
    return moving if moving is not found and settled.saddle.is_convex else found


def compare(
    settled: SettledPoint,
    kind: Kind,
    boost: float,
    progress: Progress = silent,
    *,
    recipe: Recipe | None = None,
    penalty: float = 1.0,
    is_brief: bool = False,
    take: Callable[[Candidate], None] = lambda candidate: None,
) -> tuple[Candidate, ...]:
    """The candidates of one kind of metric.

    Parameters
    ----------
    settled : SettledPoint
    kind : Kind
    boost : float
        Where the search for a penalty begins: the factor that the first run arrived at.
    progress : Progress
        Takes one line a spectrum.
    recipe : Recipe, optional
        Compare its penalties only, not other ways to weigh the rows.
    penalty : float
        Factor on the penalties of the kind's own recipe.
    is_brief : bool
        Compare penalties for one way to weigh the rows, as on a long row.
    take : callable
        Takes every candidate as soon as its spectrum is known.

    Returns
    -------
    tuple of Candidate
        All that were tried, in the order of trying; none where there is no grid.
    """
    tried = _Tried(settled, kind, progress, take)
    own = replace(RECIPES[kind], penalty=penalty * RECIPES[kind].penalty)
    rows = [recipe] if recipe else [replace(own, sweeps=sweeps) for sweeps in SWEEPS]
    long = settled.network.stages > LONG_ROW
    if kind in (Kind.GRID, Kind.TREE):
        paths = [recipe.path] if recipe else list(PATHS)
        if long:
            damped = max(paths)  # it settles from the most starts
            paths.remove(damped)
            rows = [min(rows, key=lambda row: tried.ratio(replace(row, path=damped), 1.0))]
        for row, path in itertools.product(rows, paths):
            tried.ratio(replace(row, path=path), 1.0)
        if not recipe:
            _finer(tried)
            if settled.linear.diode.any():
                _gentler(tried)
    else:
        first, is_brief = boost, is_brief or long
        for row in rows if recipe else (*rows, replace(own, by_reach=True)):
            if is_brief and any(found.ratio < np.inf for found in tried.candidates):
                tried.ratio(row, boost)
            else:
                at = lambda factor, row=row: tried.ratio(row, factor)  # noqa: E731
                boost = downhill(at, boost, around=first)
    return tuple(tried.candidates)


def _finer(tried: _Tried) -> None:
    """Try smaller path terms with the best grid's rows, as long as they help."""
    best = tried.best
    if best is None or best.recipe.path > min(PATHS):
        return
    path, ratio = best.recipe.path, best.ratio
    for _ in range(FINEST):
        path, before = path / FINER, ratio
        ratio = tried.ratio(replace(best.recipe, path=path), 1.0)
        if not ratio < HELPS * before:
            return


def _gentler(tried: _Tried) -> None:
    """Try the best grid's rows with inequality rows that push less."""
    best = tried.best
    if best is not None:
        for path in sorted({*PATHS[2:], best.recipe.path}):
            tried.ratio(replace(best.recipe, path=path, inequality=GENTLE), 1.0)


@dataclass(frozen=True)
class _Tried:
    """Candidates of one kind of metric at a settled point, in the order of trying."""

    settled: SettledPoint
    kind: Kind
    progress: Progress
    take: Callable[[Candidate], None]
    candidates: list[Candidate] = field(default_factory=list)

    @property
    def best(self) -> Candidate | None:
        """The smallest ratio of those that attract."""
        attract = [found for found in self.candidates if np.isfinite(found.ratio)]
        return min(attract, key=lambda found: found.ratio, default=None)

    def ratio(self, recipe: Recipe, boost: float) -> float:
        """Of one more candidate; infinite where there is none."""
        self.progress(f"freeze: spectrum {len(self.candidates) + 1} of a {self.kind.value}")
        try:
            found = candidate_of(self.settled, recipe, boost, self.progress)
        except Stopped:
            raise
        except AnnDcError:  # no such grid here: another recipe may have one
            return np.inf
        self.candidates.append(found)
        self.take(found)
        return found.ratio if found.ratio > 0 else np.inf  # nan: the numbers overflow


def downhill(
    ratio: Callable[[float], float], boost: float, *, around: float | None = None
) -> float:
    """The penalty of the smallest ratio that octaves lead to, from the first that attracts.

    At the end half an octave is tried on either side.

    Parameters
    ----------
    ratio : callable
        Of a factor on the penalties.
    boost : float
        Where to begin.
    around : float, optional
        From which it goes no further than `LARGEST_FACTOR` either way; ``boost`` by default.

    Returns
    -------
    float
        ``boost`` itself where none attracts.
    """
    known: dict[float, float] = {}

    def at(factor: float) -> float:
        if factor not in known:
            known[factor] = ratio(factor * boost)
        return known[factor]

    factor = 1.0
    while not np.isfinite(at(factor)):
        factor *= 2
        if factor > 2 * LARGEST_FACTOR:
            return boost
    direction = min(0.5, 2.0, key=lambda step: at(factor * step))
    away = boost / (around or boost)
    while at(factor * direction) < at(factor) and (
        1 / LARGEST_FACTOR < factor * away < LARGEST_FACTOR
    ):
        factor *= direction
    return min((factor, factor * HALF_OCTAVE, factor / HALF_OCTAVE), key=at) * boost


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
