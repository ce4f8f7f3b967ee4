"""Refinement: Nelder-Mead on the factors of the closed form, from the best candidate.

The logarithm of the spectrum's ratio is made smaller over the logarithms of the recipe's factors
and of one more factor a state component, on the penalties of its rows. What is found is taken only
if it is better and its constant gains settle from the start.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from ann_dc.analysis.linearisation import Linearisation
from ann_dc.gain_design.freeze import Candidate, candidate_of
from ann_dc.gain_design.grid_gains import SettledPoint
from ann_dc.gain_design.recipe import Recipe
from ann_dc.gain_design.rehearsal import rehearse
from ann_dc.network.metrics.contract import Kind
from ann_dc.progress import Progress, silent

FIELDS = ("penalty", "dual", "dual_coupling", "state", "control", "target")
"""Factors of a recipe that any network has; `coarse` joins them where there are coordinators."""
EVALUATIONS = 250
"""Spectra that a refinement may take."""
FIRST_STEP = 0.25
"""Edge of the first simplex: each factor times exp(1/4)."""
LARGEST_RATIO = 1e30
"""What a candidate that repels counts as."""


def refined(
    linear: Linearisation,
    state: np.ndarray,
    best: Candidate,
    progress: Progress = silent,
    evaluations: int = EVALUATIONS,
) -> Candidate:
    """A better candidate than ``best`` near it, or ``best`` itself.

    Parameters
    ----------
    linear : Linearisation
        At ``state``.
    state : (n,) array
        The settled point.
    best : Candidate
        With a finite ratio.
    progress : Progress
        Takes one line an evaluation.
    evaluations : int
        Largest number of spectra.

    Returns
    -------
    Candidate
    """
    around = _Neighbourhood(linear, state, best)
    count = itertools.count(1)

    def log_ratio(z: np.ndarray) -> float:
        progress(f"refine: evaluation {next(count)} of {evaluations}")
        return float(np.log(min(around.candidate(z).ratio, LARGEST_RATIO)))

    simplex = np.vstack([np.zeros(around.size), FIRST_STEP * np.eye(around.size)])
    found = minimize(
        log_ratio,
        simplex[0],
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex, "adaptive": True},
    )
    better = rehearse(SettledPoint(linear, state), around.candidate(found.x))
    return better if better.ratio < best.ratio and better.settling < np.inf else best


@dataclass(frozen=True)
class _Neighbourhood:
    """Candidates around one of them, by the logarithms z of the factors that are changed."""

    linear: Linearisation
    state: np.ndarray
    best: Candidate

    @property
    def fields(self) -> tuple[str, ...]:
        """Factors of the recipe, the first part of z."""
        return FIELDS if self.best.recipe.kind is Kind.TIME_CONSTANTS else (*FIELDS, "coarse")

    @property
    def components(self) -> list[str]:
        """State components whose rows have a factor of their own, the rest of z."""
        return [q.partition(".")[2] for q, _ in self.linear.network.cell.chains]

    @property
    def size(self) -> int:
        """Of z."""
        return len(self.fields) + len(self.components)

    def candidate(self, z: np.ndarray) -> Candidate:
        """The candidate at z; the best one stands at zero."""
        return candidate_of(SettledPoint(self.linear, self.state), self._recipe(z), self.best.boost)

    def _recipe(self, z: np.ndarray) -> Recipe:
        network, factors = self.linear.network, np.exp(z)
        changed = {
            field: getattr(self.best.recipe, field) * float(factor)
            for field, factor in zip(self.fields, factors)
        }
        rows = dict(zip(self.components, factors[len(self.fields) :]))
        row = {
            d.neuron: float(rows[network.neuron(d.neuron).component]) for d in network.cell.duals
        }
        return replace(self.best.recipe, row=row, **changed)
