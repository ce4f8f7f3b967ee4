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
from ann_dc.gain_design.coarse_gains import Hats
from ann_dc.gain_design.gains import tape_with
from ann_dc.gain_design.recipe import WITH_COORDINATORS, WITHOUT_COORDINATORS, Recipe, closed_form
from ann_dc.gain_design.scheduled_run import FirstRun
from ann_dc.network.network import Network

RECIPES = (
    WITH_COORDINATORS,
    replace(WITH_COORDINATORS, hats=Hats.COUPLED),
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
"""How far from the first run's penalty the freeze may go, either way."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One way to freeze a network."""

    recipe: Recipe
    boost: float
    spectrum: Spectrum

    @property
    def ratio(self) -> float:
        """Of the spectrum at the settled point; infinite when it repels."""
        return self.spectrum.ratio

    def __str__(self) -> str:
        hats = (
            "no coordinators"
            if self.recipe.hats is None
            else (f"{self.recipe.hats.name.lower()} coordinators")
        )
        return f"{hats}, penalty x {self.boost:g}: ratio {self.ratio:.3g}"


def _candidate(network, linear, state: np.ndarray, recipe: Recipe, boost: float) -> Candidate:
    tape = tape_with(network, closed_form(linear, recipe, boost))
    return Candidate(recipe=recipe, boost=boost, spectrum=spectrum(network, state, tape))


def compare(
    network, linear, first: FirstRun, recipes: Iterable[Recipe], progress
) -> tuple[Candidate, ...]:
    """The ratio of every wiring at the first run's penalty, and downhill from there by octaves."""
    tried: dict[float, list[Candidate]] = {}

    def ratio(factor: float) -> float:
        if factor not in tried:
            tried[factor] = []
            for recipe in recipes:
                if progress:
                    progress(f"freeze: spectrum at {factor * first.boost:g} times the penalty")
                tried[factor].append(
                    _candidate(network, linear, first.state, recipe, factor * first.boost)
                )
        return min(c.ratio for c in tried[factor])

    factor = 1.0
    while not np.isfinite(ratio(factor)) and factor < LARGEST_FACTOR:
        factor *= 2
    direction = min(0.5, 2.0, key=lambda step: ratio(factor * step))
    while ratio(factor * direction) < ratio(factor) and factor * LARGEST_FACTOR > 1:
        factor *= direction
    return tuple(c for group in tried.values() for c in group)


def rehearsed(network, linear, candidates: Iterable[Candidate], progress) -> Candidate:
    """The fastest candidate whose constant gains settle from the start; if none, the fastest."""
    ranked = sorted(candidates, key=lambda c: c.ratio)
    for number, candidate in enumerate(ranked):
        if progress:
            progress(f"freeze: rehearsal {number + 1}")
        if np.isfinite(candidate.ratio) and _settles(network, linear, candidate):
            return candidate
    return ranked[0]


def _settles(network: Network, linear: Linearisation, candidate: Candidate) -> bool:
    """Whether forward Euler with constant gains settles from the start in thrice the time due."""
    gains = closed_form(linear, candidate.recipe, candidate.boost)
    trial = CompiledEvaluator(network, tape_with(network, gains))
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
