"""Random points around the straight line of a problem, in the problem's own measure."""

import numpy as np

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales


def random_point(
    problem: OptimalControlProblem, rng: np.random.Generator, spread: float = 0.3, pull: float = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States with the end (n, N+1), controls (m, N), multipliers (n, N)."""
    scales, N = natural_scales(problem), problem.horizon
    state, control = scales.state_factors[:, None], scales.control_factors[:, None]
    line = np.linspace(*problem.ends, N + 1).T
    q = line + spread * state * rng.normal(size=(problem.n, N + 1))
    u = spread * control * rng.normal(size=(problem.m, N))
    return q, u, pull * scales.cost / state * rng.normal(size=(problem.n, N))
