"""Feasibility check: search for a path that satisfies all constraints.

With linear dynamics and constraints, one search that converges to a nonzero violation proves
infeasibility. Otherwise several searches must agree. With inequalities or limits, a search may
converge on the wrong side of an obstacle or swing in the wrong direction. Searches then start from
simulated paths of the plant, which differ more, and some must converge to the same violation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ann_dc.optimality.feasibility_search import Path, Search
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales, straight_line
from ann_dc.progress import Progress, silent

STARTS = (1.0, 1.0, 5.0)
"""Amplitudes of the random controls of further initial guesses, in control scales."""
WAVES = (1.0, 3.0, 10.0, 30.0, 1.0, 3.0)
"""Amplitudes of slow waves of controls, which N stages sum to one scale of the states."""
HARMONICS = 3
"""Number of sine waves in a wave."""
AGREE = 3
"""Searches that must converge to the same violation if there are inequalities."""
SAME = 0.01
"""Relative difference up to which violations count as equal."""


def feasible_path(
    problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, progress: Progress = silent
) -> Path:
    """Return the path of least violation found by searches from several guesses.

    The first guess is q (n, N+1) and u (m, N) in the user's units. The nearest path is returned if
    no search finds a feasible one. With inequalities or limits, `at_rest` is True only if `AGREE`
    searches found its violation.

    Examples
    --------
    >>> from ann_dc.problem import plants, straight_line
    >>> problem = plants.double_integrator(N=5)
    >>> line = straight_line(problem)
    >>> feasible_path(problem, line.q, line.u).met
    True
    """
    search, found = Search(problem, progress=progress), []
    with np.errstate(all="ignore"):
        for start in _starts(problem, q, u) if not search.is_held else _wide_starts(problem, q, u):
            found.append(search.least_violation(*start))
            if found[-1].met:
                return found[-1]
    nearest = min(found, key=lambda path: path.violation)
    if not search.is_held:
        return nearest
    same = [path for path in found if path.violation <= (1 + SAME) * nearest.violation]
    return replace(nearest, at_rest=sum(path.at_rest for path in same) >= AGREE)


def _starts(problem, q, u) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the given path, the straight line, and seeded random controls."""
    yield q, u
    line, scales = straight_line(problem), natural_scales(problem)
    yield line.q, line.u
    rng = np.random.default_rng(0)
    for size in STARTS:
        drawn = rng.standard_normal(u.shape) * scales.control_factors[:, None]
        yield line.q, line.u + size * drawn


def _wide_starts(problem, q, u) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the given path, the straight line, and simulations of slow control waves."""
    yield q, u
    line, rng = straight_line(problem), np.random.default_rng(0)
    yield line.q, line.u
    middle, (low, high) = line.u.mean(axis=1, keepdims=True), problem.control_limits.T[:, :, None]
    factor = line.scales.control_factors[:, None] / problem.horizon
    turns = np.pi * np.linspace(0.0, 1.0, problem.horizon, endpoint=False)
    for size in WAVES:
        wave = np.zeros_like(u)
        for number in range(1, HARMONICS + 1):
            height, phase = rng.standard_normal((problem.m, 1)), rng.random((problem.m, 1))
            wave += height * np.sin(number * turns + 2 * np.pi * phase)
        swung = np.clip(middle + size * factor * wave, low, high)
        yield problem.functions.rollout(problem.ends[0], swung), swung
