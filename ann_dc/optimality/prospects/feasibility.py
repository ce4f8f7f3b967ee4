"""Can the ends be joined at all? A path that meets the constraints, looked for from several starts.

Where the map is linear, one search that comes to rest above zero is a proof that there is none;
elsewhere several starts have to agree.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ann_dc.optimality.prospects.search import Path, Search
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales, straight_line

STARTS = (1.0, 1.0, 5.0)
"""Sizes of the random controls, in their scales, from which further searches begin."""


def feasible_path(problem: OptimalControlProblem, q: np.ndarray, u: np.ndarray) -> Path:
    """The path of least violation that searches from a path and from other starts find.

    Parameters
    ----------
    problem : OptimalControlProblem
    q : (n, N+1) array
        States with the end, in the user's units: where the first search begins.
    u : (m, N) array

    Returns
    -------
    Path
        One that meets the constraints, if any search found one; else the nearest that is at rest.

    Examples
    --------
    >>> from ann_dc.problem import plants, straight_line
    >>> problem = plants.double_integrator(N=5)
    >>> line = straight_line(problem)
    >>> feasible_path(problem, line.q, line.u).met
    True
    """
    search, found = Search(problem), []
    with np.errstate(all="ignore"):
        for start in _starts(problem, q, u):
            found.append(search.least_violation(*start))
            if found[-1].met:
                return found[-1]
    return min(found, key=lambda path: path.violation)


def _starts(problem, q, u) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The given path, the straight line, and controls drawn from a seed."""
    yield q, u
    line, scales = straight_line(problem), natural_scales(problem)
    yield line.q, line.u
    rng = np.random.default_rng(0)
    for size in STARTS:
        drawn = rng.standard_normal(u.shape) * scales.control_factors[:, None]
        yield line.q, line.u + size * drawn
