"""Knowledge of a problem for its design: existence, place and cost of an optimum.

Optima are found as network states, without running the network.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.analysis.equilibria import equilibrium
from ann_dc.errors import NetworkError
from ann_dc.evaluation.populations import kkt_point
from ann_dc.evaluation.reference import evaluator
from ann_dc.gain_design.choice import DEARER
from ann_dc.gain_design.knowledge import Found, Knowledge
from ann_dc.network.network import Network
from ann_dc.optimality.barrier import Caution
from ann_dc.optimality.certificate import Certificate, certify
from ann_dc.optimality.existence import Prospect
from ann_dc.optimality.interior_point import RESTORATIONS, Extremum, interior_point
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.initial_guess import InitialGuess, interpolated_guess, random_guess
from ann_dc.progress import Progress, Stopped
from ann_dc.synthesis.row import start_values

RANDOM_STARTS = 4
"""Number of searches from random paths: a problem with several optima often has a cheaper one."""

SAME = 1e-6
"""Relative cost difference up to which the optimum found first is preferred.

That of a random path may turn angles, or lie on another branch of a step length.
"""
FURTHER = 6
"""Restorations of a search from a further path if an optimum is known."""


class Optimum(NamedTuple):
    """Certified optimum with its state (n,), an equilibrium of the problem's network."""

    certificate: Certificate
    state: np.ndarray


def path_of(network: Network, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the states (n, N+1) with the terminal state, and the controls (m, N)."""
    q, u, t, *_ = kkt_point(network, x)
    return np.column_stack([q, t[:, -1]]), u


def _state_of(problem: OptimalControlProblem, network: Network, found: Extremum) -> np.ndarray:
    """Return the network equilibrium (n,) at an optimum, by Newton's method if it converges."""
    beta = np.zeros_like(found.mu)
    beta[:, 1:] = -found.mu[:, :-1]
    start = InitialGuess(q=found.q, u=found.u, mu=found.mu, beta=beta)
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


class Search:
    """Search for the settled point of a design by the interior-point method.

    The searches start on the straight line, on the path of a state and on random paths around the
    line. The cheapest certified optimum is the result. A problem with several objectives is not
    searched. The network must be synthesized from the problem.
    """

    def __init__(self, problem: OptimalControlProblem, network: Network) -> None:
        self.problem, self.network = problem, network
        self._from_line: list[Optimum] | None = None

    def from_line(self, progress: Progress) -> list[Optimum]:
        """Return the optimum reached from the straight line, if any; the result is cached.

        If the first search fails, it is repeated with more caution.
        """
        if self._from_line is None:
            line = interpolated_guess(self.problem)
            paths = [] if self.problem.objectives else [(line.q, line.u)]
            self._from_line = self._from(paths, [], progress, Caution.CONTROLS)
            self._from_line = self._from_line or self._from(paths, [], progress, Caution.ALL)
        return self._from_line

    def find(self, x: np.ndarray, progress: Progress) -> Found | None:
        """Return an optimum of the problem, or None if none is found; see `Knowledge`."""
        if self.problem.objectives:
            return None
        starts = (random_guess(self.problem, seed) for seed in range(RANDOM_STARTS))
        paths = [path_of(self.network, x), *((start.q, start.u) for start in starts)]
        found = self._from(paths, self.from_line(progress), progress)
        if not found:
            return None
        least = min(optimum.certificate.objective for optimum in found)
        near = least + SAME * max(abs(least), SAME)
        first = next(optimum for optimum in found if optimum.certificate.objective <= near)
        return Found(first.state, by="the interior point")

    def cheaper(self, x: np.ndarray, progress: Progress) -> Found | None:
        """Return the optimum reached from the line if cheaper than x; see `Knowledge`."""
        here = certify(self.problem, *kkt_point(self.network, x)).objective
        for optimum in self.from_line(progress):
            if optimum.certificate.objective < here - DEARER * abs(here):
                return Found(optimum.state, by="the interior point")
        return None

    def _from(
        self,
        paths: list[tuple[np.ndarray, np.ndarray]],
        known: list[Optimum],
        progress: Progress,
        caution: Caution = Caution.NONE,
    ) -> list[Optimum]:
        """Return the known optima and those that the interior point finds from some paths."""
        found = [*known]
        try:
            for q, u in paths:
                most = FURTHER if found else RESTORATIONS
                how = {"caution": caution, "restorations": most, "progress": progress}
                extremum = interior_point(self.problem, q, u, **how)
                found += self._certified(extremum)
        except Stopped:
            if not found:  # what is known is kept
                raise
        return found

    def _certified(self, extremum: Extremum) -> list[Optimum]:
        if not extremum.converged:
            return []
        state = _state_of(self.problem, self.network, extremum)
        certificate = certify(self.problem, *kkt_point(self.network, state))
        return [Optimum(certificate, state)] if certificate.certified else []


def knowledge_of(prospect: Prospect, network: Network) -> Knowledge:
    """Return the knowledge of a prospect's problem, from which the network was synthesized."""
    problem = prospect.problem
    search = Search(problem, network)

    def doubt(x: np.ndarray) -> None:
        if not search.from_line(prospect.progress):  # an optimum leaves no doubt
            prospect.doubt(*path_of(network, x))

    return Knowledge(
        doubt=doubt,
        cost=lambda x: certify(problem, *kkt_point(network, x)).objective,
        finder=search.find,
        cheaper=search.cheaper,
    )
