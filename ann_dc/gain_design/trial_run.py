"""Trial runs that test whether a network with fixed gains settles, and how fast.

A spectrum describes only the neighbourhood of the settled point. A run shows whether the initial
guess lies in its basin of attraction, and how long the approach takes. Trial runs use forward Euler
steps that are small relative to the current fastest mode. Candidates run in order of increasing
stiffness ratio, until no other can be faster.

Candidates of constant gains: preconditioner kinds, row weights and penalties.

The closed form is evaluated at the settled point for every allowed preconditioner kind, with equal
and with equilibrated constraint weights. Multilevel and diagonal kinds are compared at several
penalties, by octaves, and grids at several weights of their path term. The criterion is the
stiffness ratio of the spectrum; trial runs make the final choice. Above `LONG_ROW` stages, where
every spectrum takes long, the choices are made one after the other.
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
from ann_dc.gain_design.gain_rule import GAIN_RULES, SWEEPS, GainRule, closed_form, weights_of_rows
from ann_dc.gain_design.gains import Gains, check_gains, row_with
from ann_dc.gain_design.grid_gains import SettledPoint, grid_gains_of
from ann_dc.gain_design.penalty_search import downhill
from ann_dc.network.preconditioners.base import PreconditionerKind
from ann_dc.progress import Paced, Progress, Stopped, silent
from ann_dc.si_prefixes import counted
from ann_dc.timing import phase

PATHS = (0.3, 1.0, 0.1, 0.03)
"""Weights of a grid's path term that are compared."""

FINER, FINEST, HELPS = 3.0, 3, 2 / 3
"""Divisor of the smallest path term, largest number of divisions, and the factor by which each must
reduce the ratio. The term dominates if the initial guess is far from the optimum.
"""

GENTLE = 0.1
"""Inequality factor of additional grids: constraints active only on the way are in no stiffness,
and many of them are stiff together.
"""

LONG_ROW = 128
"""Number of stages above which row weights are compared at one path term or penalty only.

The first network that settles is then chosen if no other can be faster by its ratio.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """Constant gains of a network, with their spectrum and trial result.

    Attributes
    ----------
    penalty_factor : float
        Factor on every penalty of the gain rule.
    gains, spectrum : Gains and Spectrum
        Gains of the rule at the settled point (refined gains are near these), and the spectrum of
        the network there.
    settling : float
        Settling time of the trial run in fastest time constants. Infinite if it did not settle or
        another candidate settled first; nan if there was no trial run.
    stray : (n,) array or None
        Other equilibrium at which a trial run settled.
    """

    gain_rule: GainRule
    penalty_factor: float
    gains: Gains
    spectrum: Spectrum
    settling: float = float("nan")
    other_equilibrium: np.ndarray | None = None

    @property
    def kind(self) -> PreconditionerKind:
        """Preconditioner kind; diagonal if the cell array is too short for multilevel."""
        return self.gains.preconditioner.kind

    @property
    def ratio(self) -> float:
        """Stiffness ratio at the settled point; infinite if the point is unstable."""
        return self.spectrum.stiffness_ratio

    @property
    def rank(self) -> tuple[float, float]:
        """Sort key: settling time, then stiffness ratio, each rounded to six digits."""
        settling = np.inf if np.isnan(self.settling) else self.settling  # unknown comes last
        return float(f"{settling:.6g}"), float(f"{self.ratio:.6g}")

    def __str__(self) -> str:
        start = "reachability" if self.gain_rule.by_reachability else "equal"
        rows = (
            counted(self.gain_rule.equilibration_sweeps, "equilibration sweeps")
            if self.gain_rule.equilibration_sweeps
            else f"{start} row weights"
        )
        path = f", path weight {self.gain_rule.path_weight:g}" if self.kind.is_stiffness else ""
        if self.gain_rule.inequality != 1:
            rows += f", inequality factor {self.gain_rule.inequality:g}"
        penalty = f"penalty factor {self.penalty_factor:g}"
        return f"{self.kind.value}, {rows}{path}, {penalty}: stiffness ratio {self.ratio:.3g}"


def gains_of(points: Sequence[SettledPoint], gain_rule: GainRule, penalty_factor: float) -> Gains:
    """Return the gains of a rule at one settled point or at several in common.

    The points belong to networks that differ in their inputs. `penalty_factor` is a factor on every
    penalty. Raises `DesignError` if a grid's penalty lies below rho* or its settled point is not
    isolated.
    """
    if len(points) == 1:
        linear, weights = points[0].linear, points[0].row_weights(gain_rule)
    else:
        linear = MeanLinearisation([settled.linear for settled in points])
        weights = weights_of_rows(linear, gain_rule)
    if not gain_rule.kind.is_stiffness:
        return closed_form(linear, gain_rule, penalty_factor)
    return grid_gains_of(points, weights, gain_rule, penalty_factor)


def candidate_of(
    settled: SettledPoint, gain_rule: GainRule, penalty_factor: float, progress: Progress = silent
) -> Candidate:
    """Return a candidate of a gain rule, with its spectrum at the settled point.

    `penalty_factor` is a factor on every penalty of the rule; `progress` receives occasional lines.
    Raises `DesignError` or `NetworkError` if no grid exists at this point or the grid is not
    positive definite.
    """
    gains = gains_of([settled], gain_rule, penalty_factor)
    found = spectrum_with(settled, gains, progress)
    return Candidate(
        gain_rule=gain_rule, penalty_factor=penalty_factor, gains=gains, spectrum=found
    )


def spectrum_with(settled: SettledPoint, gains: Gains, progress: Progress = silent) -> Spectrum:
    """Return the spectrum of a network with other gains at its settled point.

    Only a tape of the network is built. For a long cell array, `progress` receives occasional
    lines. Raises `DesignError` or `NetworkError` if no network can have these gains or their
    preconditioner is not positive definite.
    """
    network = settled.network
    check_gains(network, gains)
    trial = settled.trial(gains)
    row, state = row_with(network, gains), settled.state
    found = spectrum_of(trial, gains.preconditioner, row, state, progress=progress)
    moving = (
        found.moving()
    )  # the others are multipliers of dependent rows, if primal neurons are not
    return moving if moving is not found and settled.saddle.is_convex else found


def compare(
    settled: SettledPoint,
    kind: PreconditionerKind,
    penalty_factor: float,
    progress: Progress = silent,
    *,
    gain_rule: GainRule | None = None,
    penalty: float = 1.0,
    is_brief: bool = False,
    take: Callable[[Candidate], None] = lambda candidate: None,
) -> tuple[Candidate, ...]:
    """Return the candidates of one preconditioner kind, in order of evaluation.

    The result is empty if no grid exists. ``penalty_factor`` is the final factor of the first run.
    If ``gain_rule`` is given, only its penalties are compared, not other constraint weights;
    ``penalty`` is a factor on the penalties of the kind's default rule. ``is_brief`` compares
    penalties for one set of constraint weights, as for a long cell array. ``take`` receives every
    candidate as soon as its spectrum is known.
    """
    tried = _Tried(settled, kind, progress, take)
    own = replace(GAIN_RULES[kind], penalty=penalty * GAIN_RULES[kind].penalty)
    rows = (
        [gain_rule]
        if gain_rule
        else [
            replace(own, equilibration_sweeps=equilibration_sweeps)
            for equilibration_sweeps in SWEEPS
        ]
    )
    long = settled.network.stages > LONG_ROW
    if kind.is_stiffness:
        paths = [gain_rule.path_weight] if gain_rule else list(PATHS)
        if long:
            damped = max(paths)  # it settles from the most starts
            paths.remove(damped)
            rows = [min(rows, key=lambda row: tried.ratio(replace(row, path_weight=damped), 1.0))]
        for row, path in itertools.product(rows, paths):
            tried.ratio(replace(row, path_weight=path), 1.0)
        if not gain_rule:
            _finer(tried)
            if settled.linear.diode.any():
                _gentler(tried)
    else:
        first, is_brief = penalty_factor, is_brief or long
        for row in rows if gain_rule else (*rows, replace(own, by_reachability=True)):
            if is_brief and any(found.ratio < np.inf for found in tried.candidates):
                tried.ratio(row, penalty_factor)
            else:
                at = lambda factor, row=row: tried.ratio(row, factor)  # noqa: E731
                penalty_factor = downhill(at, penalty_factor, around=first)
    return tuple(tried.candidates)


def _finer(tried: _Tried) -> None:
    """Try smaller path terms with the best grid's weights, as long as they help."""
    best = tried.best
    if best is None or best.gain_rule.path_weight > min(PATHS):
        return
    path, ratio = best.gain_rule.path_weight, best.ratio
    for _ in range(FINEST):
        path, before = path / FINER, ratio
        ratio = tried.ratio(replace(best.gain_rule, path_weight=path), 1.0)
        if not ratio < HELPS * before:
            return


def _gentler(tried: _Tried) -> None:
    """Try the best grid's weights with smaller inequality weights."""
    best = tried.best
    if best is not None:
        for path in sorted({*PATHS[2:], best.gain_rule.path_weight}):
            tried.ratio(replace(best.gain_rule, path_weight=path, inequality=GENTLE), 1.0)


@dataclass(frozen=True)
class _Tried:
    """Candidates of one kind at a settled point, in order of evaluation."""

    settled: SettledPoint
    kind: PreconditionerKind
    progress: Progress
    take: Callable[[Candidate], None]
    candidates: list[Candidate] = field(default_factory=list)

    @property
    def best(self) -> Candidate | None:
        """Stable candidate with the smallest stiffness ratio."""
        attract = [found for found in self.candidates if np.isfinite(found.ratio)]
        return min(attract, key=lambda found: found.ratio, default=None)

    def ratio(self, gain_rule: GainRule, penalty_factor: float) -> float:
        """Evaluate one more candidate and return its stiffness ratio, infinite on failure."""
        self.progress(f"candidates: spectrum {len(self.candidates) + 1} of a {self.kind.value}")
        try:
            found = candidate_of(self.settled, gain_rule, penalty_factor, self.progress)
        except Stopped:
            raise
        except AnnDcError:  # no such grid here: another gain_rule may have one
            return np.inf
        self.candidates.append(found)
        self.take(found)
        return found.ratio if found.ratio > 0 else np.inf  # nan: the numbers overflow


STEP = 0.2
"""Step relative to the largest stable step at the settled point; shorter where stiffer."""
CHUNK = 100
"""Steps between two estimates of the fastest rate."""
TOLERANCE = 1e-4
"""KKT residual at which a trial run has shown that the initial guess lies in the basin."""
SETTLING = 1e-6
"""KKT residual to which the settling time is extrapolated, with the slowest mode."""
TRANSIENT = 500.0
"""Fastest time constants allowed for the approach to the settled point."""
PATIENCE = 3.0
"""Additional time limit, as a multiple of the predicted settling time."""
_AT_BEST = 0.5
"""Smallest ratio of settling time to prediction; slower candidates are not run.

One for long cell arrays, whose trial runs take seconds.
"""
STUCK, EARLY = 1e-3, 0.2
"""Fraction of the time limit, and of the steps: a run below the first after the second is ended.

A run that is to settle has come ten times as far in a fifth of its steps.
"""
ELSEWHERE = 0.05
"""Distance, relative to the largest primal neuron, of another equilibrium."""


class Patience(NamedTuple):
    """Limits of trial runs: steps of a run, and failures of a kind.

    After `failures` failed runs of candidates of one kind, with one inequality factor, the others
    are skipped.
    """

    steps: int
    failures: int


PATIENT = Patience(steps=60_000, failures=3)
"""Limits for settled points that the network itself has found."""
HASTY = Patience(steps=10_000, failures=4)
"""Limits for points that a search found, if presets remain to be tried."""


def with_trial_run(
    settled: SettledPoint,
    candidate: Candidate,
    within: float = np.inf,
    progress: Progress = silent,
    patience: Patience = PATIENT,
) -> Candidate:
    """Run a network with a candidate's constant gains from its initial guess.

    Returns the candidate with its settling time or the other equilibrium it reached. Its stiffness
    ratio must be finite. `within` is the settling time, in fastest time constants, above which the
    candidate is useless; `progress` receives occasional lines of long runs.
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
        return replace(candidate, settling=np.inf, other_equilibrium=x)
    return replace(candidate, settling=elapsed + rest)


class Pace(NamedTuple):
    """Rate `radius` of the fastest mode near the settled point, and the Euler step.

    The fastest time constant is one over the rate; the forward Euler step is small relative to that
    mode.
    """

    radius: float
    step: float

    @classmethod
    def of(cls, *spectra: Spectrum) -> Pace:
        """Return the pace at one settled point, or at the stiffest of several."""
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
    """Integrate with Euler steps that are small relative to the current fastest mode.

    ``x`` (n,) is overwritten by the final state. ``limit`` is in fastest time constants,
    ``tolerance`` the KKT residual at which the run has settled, ``longest`` the largest number of
    steps. Returns the elapsed fastest time constants and the outcome `RAN`, `SETTLED` or `LOST`.
    """
    free = np.full(len(x), np.inf)
    guard = trial.domain_guard(x)
    rails = trial.tape.limits[trial.tape.places[:, 0]]
    bounds = Bounds(slew=free, box=rails, guard=guard)
    elapsed, steps, outcome, reported = 0.0, 0, RAN, Paced(progress)
    while outcome == RAN and elapsed < limit and steps < longest:
        if steps >= EARLY * longest and elapsed < STUCK * limit:
            break
        stiffer = max(trial.fastest_rate(x, iterations=8) / pace.radius, 1.0)
        step = pace.step / stiffer
        done, _, outcome = trial.recur(x, step, bounds, count=CHUNK, tolerance=tolerance)
        elapsed, steps = elapsed + done * step * pace.radius, steps + CHUNK
        reported(lambda: f"trial run: after {elapsed:.0f} tau_min")  # noqa: B023
    return elapsed, outcome


def distance(settled: SettledPoint, x: np.ndarray) -> float:
    """Return the distance of a state (n,) from the settled point, by primal neurons.

    The distance is relative to the largest of them, and to `SMALLEST_POSITION` at least.
    """
    primal = settled.linear.primal[settled.network.places[:, 0]]
    aim = settled.state[primal]
    return float(np.abs(x[primal] - aim).max() / max(np.abs(aim).max(), SMALLEST_POSITION))


def at_another(settled: SettledPoint, candidate: Candidate) -> Candidate:
    """Return a candidate with equal gains at another settled point, not yet run."""
    found = spectrum_with(settled, candidate.gains)
    return Candidate(
        gain_rule=candidate.gain_rule,
        penalty_factor=candidate.penalty_factor,
        gains=candidate.gains,
        spectrum=found,
    )


@phase("trial runs")
def with_trial_runs(
    settled: SettledPoint,
    candidates: Iterable[Candidate],
    progress: Progress = silent,
    *,
    take: Callable[[Candidate], None] = lambda candidate: None,
    patience: Patience = PATIENT,
) -> tuple[Candidate, ...]:
    """Return candidates with their trial results, the best first.

    Candidates that settled come first, the fastest in front, then all others by increasing
    stiffness ratio. A candidate that cannot be the fastest by its ratio is not run, nor is a kind
    that fails repeatedly. Candidates with a result are not run again. ``take`` receives every
    candidate after its trial run.
    """
    fastest, seen, failures = np.inf, [], dict[object, int]()
    at_best = 1.0 if settled.network.stages > LONG_ROW else _AT_BEST
    for number, candidate in enumerate(sorted(candidates, key=lambda found: found.rank[1]), 1):
        expected = at_best * candidate.ratio * np.log(1 / SETTLING)
        pace = Pace.of(candidate.spectrum)
        is_long = not expected < patience.steps * pace.step * pace.radius
        own = candidate.kind, candidate.gain_rule.inequality
        has_failed = failures.get(own, 0) >= patience.failures
        hopeless = is_long or has_failed or not expected < fastest
        if np.isnan(candidate.settling) and not hopeless:
            progress(f"trial run: candidate {number}")
            candidate = with_trial_run(settled, candidate, fastest, progress, patience)
            take(candidate)
            if candidate.settling == fastest == np.inf:
                failures[own] = failures.get(own, 0) + 1
        fastest = min(fastest, candidate.rank[0])
        seen.append(candidate)
    return tuple(sorted(seen, key=lambda found: found.rank))
