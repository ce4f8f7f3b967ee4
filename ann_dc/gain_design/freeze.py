"""Freezing a network: which wiring and which penalty make the best constants.

The closed form is evaluated once more at the settled point, for each way of wiring the coordinators
(none among them) and a few penalties. The smallest ratio of the spectrum wins, provided that a
rehearsal with constant gains settles from the start; the factors of the winner can be refined.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.analysis.spectra import Spectrum, spectrum
from ann_dc.evaluation.compiled import CompiledEvaluator
from ann_dc.evaluation.domains import Bounds
from ann_dc.evaluation.loops import SETTLED
from ann_dc.gain_design.gains import Gains, apply_gains, tape_with
from ann_dc.gain_design.recipe import WITH_COORDINATORS, WITHOUT_COORDINATORS, Recipe, closed_form
from ann_dc.gain_design.scheduled_run import FirstRun
from ann_dc.network.metrics.contract import Kind
from ann_dc.progress import Progress, silent

RECIPES = (
    WITH_COORDINATORS,
    replace(WITH_COORDINATORS, kind=Kind.COUPLED_PYRAMID),
    WITHOUT_COORDINATORS,
)
"""The wirings among which the freeze chooses; the first one is used in the first run."""

REHEARSAL_STEP = 0.2
"""Step of the rehearsal, as a share of the largest that is stable at the settled point."""

REHEARSAL_TOLERANCE = 1e-4
"""KKT residual at which a rehearsal has shown that the start lies in the basin."""

LONGEST_REHEARSAL = 200_000
"""Steps after which a rehearsal is given up."""

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
    """

    recipe: Recipe
    boost: float
    gains: Gains
    spectrum: Spectrum

    @property
    def ratio(self) -> float:
        """Of the spectrum at the settled point; infinite when it repels."""
        return self.spectrum.ratio

    def __str__(self) -> str:
        return f"{self.recipe.kind.value}, penalty x {self.boost:g}: ratio {self.ratio:.3g}"


def candidate_of(
    linear: Linearisation, state: np.ndarray, recipe: Recipe, boost: float
) -> Candidate:
    """The network frozen by a recipe at a settled state, with its spectrum there.

    Parameters
    ----------
    linear : Linearisation
        At the settled point.
    state : (n,) array
        The settled point.
    recipe : Recipe
    boost : float
        Factor on every penalty of the recipe.

    Returns
    -------
    Candidate
    """
    gains = closed_form(linear, recipe, boost)
    frozen = apply_gains(linear.network, gains)
    return Candidate(recipe=recipe, boost=boost, gains=gains, spectrum=spectrum(frozen, state))


def compare(
    linear: Linearisation,
    first: FirstRun,
    recipes: Iterable[Recipe] = RECIPES,
    progress: Progress = silent,
) -> tuple[Candidate, ...]:
    """Every wiring at the first run's penalty, and downhill from there by octaves.

    Parameters
    ----------
    linear : Linearisation
        At the state where the first run ended.
    first : FirstRun
    recipes : iterable of Recipe
        The wirings among which to choose.
    progress : Progress
        Takes one line a spectrum.

    Returns
    -------
    tuple of Candidate
        All that were tried, in the order of trying.
    """
    octaves = _Octaves(linear, first, tuple(recipes), progress)
    factor = 1.0
    while not np.isfinite(octaves.ratio(factor)) and factor < LARGEST_FACTOR:
        factor *= 2
    direction = min(0.5, 2.0, key=lambda step: octaves.ratio(factor * step))
    while octaves.ratio(factor * direction) < octaves.ratio(factor) and (
        1 / LARGEST_FACTOR < factor < LARGEST_FACTOR
    ):
        factor *= direction
    return tuple(candidate for group in octaves.tried.values() for candidate in group)


class _Octaves:
    """Candidates by their factor on the first run's penalty, each computed once."""

    def __init__(
        self,
        linear: Linearisation,
        first: FirstRun,
        recipes: tuple[Recipe, ...],
        progress: Progress,
    ) -> None:
        self.linear, self.first, self.recipes, self.progress = linear, first, recipes, progress
        self.tried: dict[float, list[Candidate]] = {}

    def ratio(self, factor: float) -> float:
        """The smallest ratio among the recipes."""
        if factor not in self.tried:
            self.tried[factor] = [self._candidate(recipe, factor) for recipe in self.recipes]
        return min(candidate.ratio for candidate in self.tried[factor])

    def _candidate(self, recipe: Recipe, factor: float) -> Candidate:
        boost = factor * self.first.boost
        self.progress(f"freeze: spectrum at {boost:g} times the penalty")
        return candidate_of(self.linear, self.first.state, recipe, boost)


def rehearsed(
    linear: Linearisation, candidates: Iterable[Candidate], progress: Progress = silent
) -> Candidate:
    """The fastest candidate whose constant gains settle from the start; if none, the fastest.

    Parameters
    ----------
    linear : Linearisation
        At the settled point.
    candidates : iterable of Candidate
        One or more.
    progress : Progress
        Takes one line a candidate.

    Returns
    -------
    Candidate
    """
    ranked = sorted(candidates, key=lambda candidate: candidate.ratio)
    for number, candidate in enumerate(ranked):
        progress(f"freeze: rehearsal {number + 1}")
        if np.isfinite(candidate.ratio) and settles(linear, candidate):
            return candidate
    return ranked[0]


def settles(linear: Linearisation, candidate: Candidate) -> bool:
    """Whether forward Euler with constant gains settles from the start in thrice the time due.

    Parameters
    ----------
    linear : Linearisation
        At the settled point.
    candidate : Candidate

    Returns
    -------
    bool
    """
    network = linear.network
    trial = CompiledEvaluator(network, tape_with(network, candidate.gains))
    step = REHEARSAL_STEP * candidate.spectrum.largest_step
    due = np.log(1 / REHEARSAL_TOLERANCE) / -candidate.spectrum.abscissa
    free = np.full(network.size, np.inf)
    guard = trial.domain_guard(network.start_state)
    _, _, outcome = trial.recur(
        network.start_state.copy(),
        step,
        Bounds(slew=free, box=np.column_stack([-free, free]), guard=guard),
        count=int(min(3 * due / step, LONGEST_REHEARSAL)) if step > 0 else 0,
        tolerance=REHEARSAL_TOLERANCE,
    )
    return outcome == SETTLED
