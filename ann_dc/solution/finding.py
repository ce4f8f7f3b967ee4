"""Optima of a problem as states of its network, found without running it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.errors import NetworkError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.knowledge import Finder, Found
from ann_dc.network.network import Network
from ann_dc.optimality.certificate import Certificate, certify
from ann_dc.optimality.interior_point.search import Extremum, interior_point
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.start import Start, line_start, random_start
from ann_dc.progress import Progress
from ann_dc.synthesis.row import start_values

RANDOM_STARTS = 4
"""Searches from random paths: a problem with several optima often has a cheaper one."""


def path_of(network: Network, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (n, N+1) with the end, and controls (m, N), of a state vector of a problem's network.

    Parameters
    ----------
    network : Network
    x : (n,) array
    """
    q, u, t, *_ = kkt_point(network, x)
    return np.column_stack([q, t[:, -1]]), u


def state_of(problem: OptimalControlProblem, network: Network, found: Extremum) -> np.ndarray:
    """Equilibrium (n,) of a network at an optimum of its problem.

    Newton's method on the net inputs refines it where it can.
    """
    beta = np.zeros_like(found.mu)
    beta[:, 1:] = -found.mu[:, :-1]
    start = Start(q=found.q, u=found.u, mu=found.mu, beta=beta)
    values = network.unpack(start_values(network, start))
    for population, given in (("z", found.zeta), ("z_end", found.zeta_end[:, None])):
        neurons = evaluator(network).multipliers.get(population, ((), ()))[0]
        for row, multiplier in zip(neurons, given):
            values[row] = network.cell.neurons[row].scale.network(multiplier)
    state = network.pack(values)
    try:
        return equilibrium(network, state)
    except NetworkError:
        return state


def finder_of(problem: OptimalControlProblem, network: Network) -> Finder:
    """Return the search that a design asks for a settled point.

    The interior point starts on the path of a state, on the straight line and on random paths
    around it. The cheapest certified optimum is the result, None if there is none.

    Parameters
    ----------
    problem : OptimalControlProblem
        A problem with several objectives is not searched.
    network : Network
        Synthesized from it.
    """

    def find(x: np.ndarray, progress: Progress) -> Found | None:
        if problem.objectives:
            return None
        found = _certified(problem, network, _paths(problem, path_of(network, x)), progress)
        if not found:
            return None
        return Found(min(found, key=lambda point: point[0].objective)[1], by="the interior point")

    return find


def _paths(
    problem: OptimalControlProblem, path: tuple[np.ndarray, np.ndarray]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Starts of the search: a path, the straight line, and random ones around it."""
    yield path
    line = line_start(problem)
    yield line.q, line.u
    for seed in range(RANDOM_STARTS):
        start = random_start(problem, seed)
        yield start.q, start.u


def _certified(
    problem: OptimalControlProblem,
    network: Network,
    paths: Iterable[tuple[np.ndarray, np.ndarray]],
    progress: Progress,
) -> list[tuple[Certificate, np.ndarray]]:
    """Certified optima to which the interior point leads from some paths, with their states."""
    found = []
    for q, u in paths:
        extremum = interior_point(problem, q, u, progress=progress)
        if extremum.converged:
            state = state_of(problem, network, extremum)
            certificate = certify(problem, *kkt_point(network, state))
            if certificate.certified:
                found.append((certificate, state))
    return found
