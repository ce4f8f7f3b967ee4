"""Can the constraints be met at all? A path that does, looked for from several starts.

Where map and rows are linear, one search that comes to rest above zero is a proof that there is
none; elsewhere several searches have to agree. With inequalities or limits a search may come to
rest on the wrong side of an obstacle, or swing the wrong way: then it begins at paths that the
plant takes by itself, which differ more, and some have to come to rest at the same violation.
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
"""Sizes of the random controls, in their scales, from which further searches begin."""
WAVES = (1.0, 3.0, 10.0, 30.0, 1.0, 3.0)
"""The same of slow waves of controls, which N stages add up to a scale of the states."""
HARMONICS = 3
"""Sines of which a wave consists."""
AGREE = 3
"""Searches that have to come to rest at the same violation where there are inequalities."""
SAME = 0.01
"""Share by which their violations may differ."""


def feasible_path(
    problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray, progress: Progress = silent
) -> Path:
    """The path of least violation that searches from a path and from other starts find.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end, in the user's units: where the first search begins.
    u : (m, N) array
    progress : Progress
        Takes a line an iteration.

    Returns
    -------
    Path
        One that meets the constraints, if any search found one; else the nearest. Where the problem
        has inequalities or limits, it is at rest only if `AGREE` searches found its violation.

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
    """The given path, the straight line, and controls drawn from a seed."""
    yield q, u
    line, scales = straight_line(problem), natural_scales(problem)
    yield line.q, line.u
    rng = np.random.default_rng(0)
    for size in STARTS:
        drawn = rng.standard_normal(u.shape) * scales.control_factors[:, None]
        yield line.q, line.u + size * drawn


def _wide_starts(problem, q, u) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The given path, the straight line, and what slow waves of controls make of the plant."""
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
