"""TODO: the idea."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from ann_dc.gain_design.freeze import Candidate, _candidate, _settles
from ann_dc.gain_design.recipe import Recipe


def refined(network, linear, state, best: Candidate, progress, evaluations: int = 250):
    """Nelder-Mead on the logarithms of the recipe's factors, objective log ratio."""
    fields = ["penalty", "dual", "dual_coupling", "state", "control", "target"]
    fields += [] if best.recipe.hats is None else ["coarse"]
    components = [q.partition(".")[2] for q, _ in network.cell.chains]

    def recipe_at(z: np.ndarray) -> Recipe:
        factors = np.exp(z)
        rows = dict(zip(components, factors[len(fields) :]))
        row = {
            d.neuron: float(rows[network.neuron(d.neuron).component]) for d in network.cell.duals
        }
        changed = {f: getattr(best.recipe, f) * float(v) for f, v in zip(fields, factors)}
        return replace(best.recipe, row=row, **changed)

    count = 0

    def candidate_at(z: np.ndarray) -> Candidate:
        return _candidate(network, linear, state, recipe_at(z), best.boost)

    def log_ratio(z: np.ndarray) -> float:
        nonlocal count
        count += 1
        if progress:
            progress(f"refine: evaluation {count} of {evaluations}")
        return float(np.log(min(candidate_at(z).ratio, 1e30)))

    size = len(fields) + len(components)
    simplex = np.vstack([np.zeros(size), 0.25 * np.eye(size)])
    found = minimize(
        log_ratio,
        simplex[0],
        method="Nelder-Mead",
        options={"maxfev": evaluations, "initial_simplex": simplex, "adaptive": True},
    )
    better = candidate_at(found.x)
    improves = better.ratio < best.ratio and _settles(network, linear, better)
    return better if improves else best
