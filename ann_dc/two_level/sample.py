"""One sample of a network for both levels: neuron rows, net inputs, Newton steps.

q, u and mu belong to the stages, t and beta to the coordinator.
"""

from __future__ import annotations

import copy
from dataclasses import astuple
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import splu

from ann_dc.errors import NetworkError, ProblemError
from ann_dc.evaluation.codegen.evaluator import fast_evaluator
from ann_dc.evaluation.reference import evaluator
from ann_dc.network.network import COORDINATION, Network
from ann_dc.problem.declaration import OptimalControlProblem

STAGE = ("q", "u", "mu")
"""Populations of the lower level."""


class Rows(NamedTuple):
    """Masks (n,) of a state vector by level and population."""

    lower: np.ndarray
    """Neurons q, u and mu."""
    v: np.ndarray
    """Neurons q and u, v_k of the paper."""
    mu: np.ndarray
    """Neurons mu."""
    t: np.ndarray
    """Neurons t."""
    beta: np.ndarray
    """Neurons beta."""
    chain: np.ndarray
    """Neurons q and t, whose changes a Newton step limits."""


def check_problem(problem: OptimalControlProblem) -> None:
    """Raise `ProblemError` if a problem has inequalities, bounds or objectives."""
    names = map(str, (*problem.constraints, *problem.terminal_constraints, *problem.bounds))
    if problem.objectives:
        raise ProblemError(
            f"two levels: {problem.name} has the objectives "
            f"{', '.join(problem.objective_names)}, which the algorithm does not support; use "
            "ann_dc.solve(problem)"
        )
    if reported := ", ".join(names):
        raise ProblemError(
            f"two levels: {problem.name} has inequalities or bounds ({reported}), which the "
            "algorithm does not support; use ann_dc.solve(problem)"
        )


def rows_of(network: Network) -> Rows:
    """Return the masks of both levels in the state vector of a network.

    Raises `NetworkError` if a population is missing, because the network does not represent a
    problem, and for populations or saturation limits that belong to inequalities.
    """
    of = [neuron.population for neuron in network.cell.neurons]
    missing = [name for name in (*STAGE, *COORDINATION) if name not in of]
    if missing:
        raise NetworkError(
            f"two levels: {network.title} has no {', '.join(missing)}; the algorithm needs the "
            "network of a problem"
        )
    others = [n.name for n in network.cell.neurons if n.population not in (*STAGE, *COORDINATION)]
    others += [n.name for n in network.cell.neurons if np.isfinite(astuple(n.limiter)).any()]
    if others:
        raise NetworkError(
            f"two levels: {network.title} has {', '.join(others)} for inequalities or limits, "
            "which the algorithm does not support; use ann_dc.solve"
        )

    of_population = network.of_population
    return Rows(
        lower=of_population(*STAGE),
        v=of_population("q", "u"),
        mu=of_population("mu"),
        t=of_population("t"),
        beta=of_population("beta"),
        chain=of_population("q", "t"),
    )


class _Blocks(NamedTuple):
    """Jacobian entries inside stages and their places in one block per stage."""

    inside: np.ndarray
    """Mask (nnz,) of the entries."""
    stage: np.ndarray
    row: np.ndarray
    column: np.ndarray
    slot: np.ndarray
    """Rows (L,) of the lower neurons in the block of their stage."""


class Sample:
    """Network with its inputs as one sample; ``number`` is its index in a batch."""

    def __init__(self, network: Network, number: int = 0) -> None:
        self.network, self.number, self.rows = network, number, rows_of(network)
        self.compiled = fast_evaluator(network)
        self.lower = np.flatnonzero(self.rows.lower)
        self.stage = network.places[self.lower, 1]
        """(L,) stages of the lower level's neurons."""

    def numbered(self, number: int) -> Sample:
        """Return the sample with another number."""
        other = copy.copy(self)
        other.number = number
        return other

    def drives(self, x: np.ndarray) -> np.ndarray:
        """Return the net inputs (n,) of all neurons at a state x (n,)."""
        return self.network.pack(self.compiled.drives(x))

    def residual(self, x: np.ndarray) -> float:
        """Return the relative KKT residual; infinite if a number is not finite."""
        return float(max(self.compiled.residuals(x)))

    @cached_property
    def step_limit(self) -> float:
        """Minimum of rho tau over the PI duals, at most two fastest time constants.

        For h > rho tau, one step of a dual exceeds the damping of its proportional path.
        """
        network, own = self.network, evaluator(self.network)
        found = [2.0 / own.fastest_rate(network.start_state)]
        for path, neuron in zip(*own.penalty_paths):
            rho, live = own.tape.weights[path], network.live[neuron]
            counts = live & (rho > 0)
            found += (rho[counts] / network.layout.rates[neuron][counts]).tolist()
        return min(found)

    @cached_property
    def rates(self) -> np.ndarray:
        """Rates 1 / tau of every neuron (n,)."""
        return self.network.pack(self.network.layout.rates)

    def stage_steps(self, x: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Return the Newton steps (L,) of the lower level, each stage separately."""
        of, size = self._blocks, self._size
        blocks = np.repeat(np.eye(size)[None], self.network.stages, axis=0)
        blocks[self.stage, of.slot, of.slot] = 0.0
        blocks[of.stage, of.row, of.column] = self.compiled.jacobian_entries(x)[of.inside]
        right = np.zeros((self.network.stages, size, 1))
        right[self.stage, of.slot, 0] = -drives
        try:
            return np.linalg.solve(blocks, right)[self.stage, of.slot, 0]
        except np.linalg.LinAlgError:
            return np.full(len(self.lower), np.nan)

    @cached_property
    def _size(self) -> int:
        """Largest number of lower neurons in a stage."""
        return int(self._blocks.slot.max()) + 1

    @cached_property
    def _blocks(self) -> _Blocks:
        place = np.full(self.network.size, -1)
        order = np.argsort(self.stage, kind="stable")
        first = np.searchsorted(self.stage[order], self.stage[order])
        slot = np.empty(len(self.lower), np.int64)
        slot[order] = np.arange(len(self.lower)) - first
        place[self.lower] = slot
        row, column = self.compiled.tape.entries[:, :2].T
        stage = self.network.places[:, 1]
        inside = (place[row] >= 0) & (place[column] >= 0) & (stage[row] == stage[column])
        row, column = row[inside], column[inside]
        return _Blocks(inside, stage[row], place[row], place[column], slot)

    def newton_step(self, x: np.ndarray, drives: np.ndarray) -> np.ndarray:
        """Return the Newton step (n,) of the whole network; nan if it does not exist."""
        try:
            return -splu(self.compiled.drive_jacobian(x).tocsc()).solve(drives)
        except RuntimeError:
            return np.full(self.network.size, np.nan)
