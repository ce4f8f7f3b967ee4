r"""Paths of least constraint violation by damped Gauss-Newton steps.

The dynamics can always be satisfied by simulation; the target may be out of reach. A path and its
controls are moved until the violation

.. math:: \tfrac12 \sum_k \| S^{-1} (f(q_k, u_k) - q_{k+1}) \|^2

vanishes, which proves feasibility, or converges above zero, to a point at which no small change of
a control reduces the terminal error.

A step s has the largest gain in the linear model of a path. With gaps c that should be zero,
distances d that should not be positive and control limits,

.. math::
    \min_s \tfrac12 \|c + C s\|^2 + \tfrac12 \|\max(0, d + D s)\|^2 + \tfrac12 \lambda \|s\|^2,
    \qquad s_{low} \le s \le s_{high}.

The active constraints and limits are found in a few rounds. After each round, constraints that the
step would violate are added and others removed, and unknowns that would exceed their limits are
fixed there.

Distances list the inequalities by stage, then those of the end. A constraint g <= 0 is divided by
the length of its gradient on its boundary, in the problem's scales. A positive value is the
distance that a path must move to satisfy the constraint. Soft constraints are omitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from ann_dc.problem.boundary import boundary_slopes
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.inequality import Inequality
from ann_dc.problem.scales import natural_scales, straight_line
from ann_dc.progress import Progress, silent


class WorstStage(NamedTuple):
    """Stage of the largest violation of an inequality, N at the end.

    `distance` is in scales, and `excess` is g in its unit.
    """

    inequality: Inequality
    distance: float
    excess: float
    stage: int


class RowDistances:
    """Distances of paths to the hard constraints, positive if violated, with derivatives.

    `columns` (N+1, n+m) are the indices of the unknowns, -1 if a variable is none. `length`
    (count,) is the value of a distance of one, for all stages and the end.
    """

    def __init__(self, problem: OptimalControlProblem, columns: np.ndarray) -> None:
        self.problem, n, stages = problem, problem.n, problem.horizon
        self.kinds = _hard(problem.inequalities), _hard(problem.end_inequalities)
        r, r_end = map(len, self.kinds)
        self.count = r * stages + r_end
        line = straight_line(problem)
        self.factors = np.array(line.scales.states + line.scales.controls)[:, 0]
        slopes = np.ones(0), np.ones(0)
        if self.count:
            slopes = boundary_slopes(problem.functions, line.q, line.u, self.factors)
            slopes = tuple(slope[kind] for slope, kind in zip(slopes, self.kinds))
        self.length = np.concatenate([np.tile(slopes[0], stages), slopes[1]])
        of_stages = np.repeat(columns[:-1], r, axis=0), np.repeat(columns[-1:, :n], r_end, axis=0)
        column = np.concatenate([part.ravel() for part in of_stages])
        row = np.concatenate(
            [
                np.repeat(np.arange(r * stages), columns.shape[1]),
                np.repeat(np.arange(r * stages, self.count), n),
            ]
        )
        self.kept = column >= 0
        self.places = row[self.kept], column[self.kept]

    def of(self, q: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the distances (count,) of a path (n, N+1) with controls (m, N), scaled."""
        if not self.count:
            return np.zeros(0)
        (rows, _), (end, _) = self._at(q, u)
        return np.concatenate([rows.T.ravel(), end]) / self.length

    def jacobian(self, q: np.ndarray, u: np.ndarray, unknowns: int) -> sparse.csr_array:
        """Return the derivatives (count, unknowns) of the distances."""
        entries = np.zeros(0)
        if self.count:
            (_, rows), (_, end) = self._at(q, u)
            of_stages = rows.transpose(2, 0, 1) * self.factors
            of_end = end * self.factors[: self.problem.n]
            entries = np.concatenate([of_stages.ravel(), of_end.ravel()])[self.kept]
            entries = entries / self.length[self.places[0]]
        return sparse.csr_array((entries, self.places), shape=(self.count, unknowns))

    def worst(self, distance: np.ndarray) -> list[WorstStage]:
        """Return the worst stage of every inequality, the worst inequality first.

        `distance` (count,) is that of a path.
        """
        rows, at_end = (
            [group[i] for i in kind]
            for group, kind in zip(
                (self.problem.inequalities, self.problem.end_inequalities), self.kinds
            )
        )
        last = len(rows) * self.problem.horizon
        places = [np.arange(i, last, len(rows)) for i in range(len(rows))]
        places += [np.array([place]) for place in range(last, self.count)]
        found = []
        for inequality, own in zip((*rows, *at_end), places):
            at = int(own[np.argmax(distance[own])])
            stage = at // len(rows) if at < last else self.problem.horizon
            excess = float(distance[at] * self.length[at])
            found.append(WorstStage(inequality, float(distance[at]), excess, stage))
        return sorted(found, key=lambda row: -row.distance)

    def _at(self, q: np.ndarray, u: np.ndarray):
        """Return values and gradients of the constraints of the stages and of the end."""
        functions, (own, at_end) = self.problem.functions, self.kinds
        rows, end = functions.rows(q[:, :-1], u), functions.end_rows(q[:, -1])
        return (rows.value[own], rows.jacobian[own]), (end.value[at_end], end.jacobian[at_end])


def _hard(rows: Sequence[Inequality]) -> list[int]:
    return [i for i, row in enumerate(rows) if row.soft is None]


ROUNDS = 10
"""Largest number of active-set rounds. A step without gain is repeated with more damping."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """Linearised gaps, distances and limits around a path, in scales.

    `of_gap` (E, K) and `of_distance` (R, K) are the sparse derivatives of `gap` (E,) and `distance`
    (R,) with respect to the unknowns. `low` and `high` (K,) limit a step.
    """

    gap: np.ndarray
    of_gap: sparse.csr_array
    distance: np.ndarray
    of_distance: sparse.csr_array
    low: np.ndarray
    high: np.ndarray

    @property
    def size(self) -> float:
        """Norm of the gaps and the violated distances."""
        over = np.maximum(self.distance, 0.0)
        return float(np.hypot(np.linalg.norm(self.gap), np.linalg.norm(over)))

    def slope(self) -> np.ndarray:
        """Return the gradient (K,) of half the squared violation, zero at active limits."""
        slope = self._slope(self.gap, self.distance)
        return np.where(self._holds(slope, np.zeros(len(slope))), 0.0, slope)

    def step(self, damping: float) -> np.ndarray:
        """Return the damped step (K,) of largest gain.

        The damping is relative to the mean diagonal of the normal matrix of the gaps. Raises
        RuntimeError if a matrix is singular.
        """
        step = np.zeros(len(self.low))
        counts = self.distance > 0.0
        held = self._holds(self._slope(self.gap, self.distance), step)
        for _ in range(ROUNDS):
            size = self._solve(step, counts, held, damping)
            step, wanted = np.clip(step, self.low, self.high), step
            gap, ahead = self.gap + self.of_gap @ step, self.distance + self.of_distance @ step
            slope = self._slope(gap, ahead) + damping * size * step
            before = counts, held
            counts = ahead > 0.0
            held = (step != wanted) | (held & self._holds(slope, step))
            if np.array_equal(before[0], counts) and np.array_equal(before[1], held):
                break
        return step

    def _slope(self, gap: np.ndarray, distance: np.ndarray) -> np.ndarray:
        slope = self.of_gap.T @ gap
        if len(distance):
            slope = slope + self.of_distance.T @ np.maximum(distance, 0.0)
        return slope

    def _holds(self, slope: np.ndarray, step: np.ndarray) -> np.ndarray:
        return np.where(slope > 0.0, step <= self.low, step >= self.high)

    def _solve(self, step, counts, held, damping: float) -> float:
        """Compute the free entries of the step, given the fixed ones."""
        J, gap = self.of_gap, self.gap
        if counts.any():
            J = sparse.csr_array(sparse.vstack([J, self.of_distance[counts]]))
            gap = np.concatenate([gap, self.distance[counts]])
        if held.any():
            gap = gap + J[:, held] @ step[held]
            J = J[:, ~held]
        normal = (J @ J.T).tocsc()
        size = max(float(normal.diagonal().mean()), 1e-300)
        shifted = (normal + damping * size * sparse.eye_array(len(gap))).tocsc()
        step[~held] = -(J.T @ splu(shifted).solve(gap))
        return size


MET = 1e-9
"""Violation, in scales of the states, at which the constraints count as met."""
AT_REST = 1e-7
"""Gradient of the violation over its size below which the search has converged."""
STALLED = 1e-3
"""Relative decrease of the violation due in `PATIENCE` steps; some infima are at infinity."""
PATIENCE = 10
ITERATIONS = 200
"""Damped Gauss-Newton steps of one search."""
SMALLEST_DAMPING, LARGEST_DAMPING = 1e-12, 1e8


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """States and controls of a problem in the user's units, with their constraint violations.

    `gap` (n, N) is f(q_k, u_k) - q_{k+1} in scales. `distance` (r N + r_e,) lists the inequalities
    by stage, then of the end, positive if violated. `size` is the largest state in its scale, at
    least one. `at_rest` is True if no small change reduces the violation.
    """

    q: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    distance: np.ndarray
    size: float
    at_rest: bool = False

    @property
    def violation(self) -> float:
        """Largest gap or distance, in scales; infinite if any value is not finite."""
        largest = float(np.maximum(np.abs(self.gap).max(), self.distance.max(initial=0.0)))
        return largest if np.isfinite(largest) else np.inf

    @property
    def met(self) -> bool:
        """True if the constraints hold."""
        return self.violation < MET * self.size


class Search:
    """Damped Gauss-Newton search for paths that satisfy a problem's constraints.

    `weight` is that of the dynamics, relative to inequalities or otherwise to the target.
    """

    def __init__(
        self, problem: OptimalControlProblem, weight: float = 1.0, progress: Progress = silent
    ) -> None:
        self.problem, scales, self.progress = problem, natural_scales(problem), progress
        self.state, self.control = scales.state_factors[:, None], scales.control_factors[:, None]
        self.low, self.high = problem.control_limits.T[:, :, None]
        self.free = np.ones((problem.n, problem.horizon + 1), bool)
        self.free[:, 0] = ~np.array(problem.fixed_start)
        self.free[:, -1] = ~np.array(problem.fixed)
        self._places()
        self.is_held = bool(self.rows.count or np.isfinite(problem.control_limits).any())
        self.weight = np.full((problem.n, problem.horizon), weight)
        if not self.rows.count:
            self.weight[np.array(problem.fixed), -1] = 1.0

    def path(self, q: np.ndarray, u: np.ndarray) -> Path:
        """Return the path of states (n, N+1) and clipped controls (m, N), with its gaps."""
        u = np.clip(u, self.low, self.high)
        gap = (self.problem.functions.map(q[:, :-1], u) - q[:, 1:]) / self.state
        size = max(1.0, float(np.abs(q / self.state).max()))
        return Path(q=q, u=u, gap=gap, distance=self.rows.of(q, u), size=size)

    def with_ends(self, q: np.ndarray) -> np.ndarray:
        """Return states (n, N+1) with the boundary conditions of the problem inserted."""
        first, last = self.problem.ends
        ends = np.column_stack([first, np.broadcast_to(last[:, None], (len(last), q.shape[1] - 1))])
        return np.where(self.free, q, ends)

    def jacobian(self, path: Path) -> sparse.csr_array:
        """Return the scaled Jacobian of the gaps, by stage, in free states and controls."""
        F, B = self.problem.functions.map_jacobian(path.q[:, :-1], path.u)
        F = F * self.state[None] / self.state[:, None]
        B = B * self.control[None] / self.state[:, None]
        blocks = np.concatenate([F, B], axis=1).transpose(2, 0, 1).ravel()
        entries = np.concatenate([blocks, np.full(path.gap.size, -1.0)])[self.kept]
        return sparse.csr_array((entries, self.places), shape=self.shape)

    def _places(self) -> None:
        """Set the indices of the Jacobian entries: F and B by stage, then the -1 entries."""
        n, stages = self.problem.n, self.problem.horizon
        m, count = self.problem.m, int(self.free.sum())
        states = np.full((stages + 1, n), -1)
        states[self.free.T] = np.arange(count)
        controls = count + np.arange(stages * m).reshape(stages, m)
        columns = np.hstack([states[:-1], controls])  # what stage k reads
        rows = np.arange(stages * n).reshape(stages, n)
        across = (stages, n, n + m)
        row = [np.broadcast_to(rows[:, :, None], across).ravel(), rows.ravel()]
        column = [np.broadcast_to(columns[:, None], across).ravel(), states[1:].ravel()]
        row, column = np.concatenate(row), np.concatenate(column)
        self.kept = column >= 0
        self.places = row[self.kept], column[self.kept]
        self.shape = stages * n, count + stages * m
        at_end = np.concatenate([states[-1], np.full(m, -1)])
        self.rows = RowDistances(self.problem, np.vstack([columns, at_end]))

    def model(self, path: Path) -> LinearModel:
        """Return the linear model of a step of the free states and controls."""
        weight, states = self.weight.T.ravel(), np.full(int(self.free.sum()), np.inf)
        low, high = ((side - path.u) / self.control for side in (self.low, self.high))
        return LinearModel(
            gap=weight * path.gap.T.ravel(),
            of_gap=sparse.diags_array(weight) @ self.jacobian(path),
            distance=path.distance,
            of_distance=self.rows.jacobian(path.q, path.u, self.shape[1]),
            low=np.concatenate([-states, low.T.ravel()]),
            high=np.concatenate([states, high.T.ravel()]),
        )

    def moved(self, path: Path, step: np.ndarray) -> Path:
        """Return the path after a step of its free states and controls, in scales."""
        n, stages = path.gap.shape
        moves = np.zeros(self.free.size)
        count = int(self.free.sum())
        moves[self.free.T.ravel()] = step[:count]
        q = path.q + self.state * moves.reshape(stages + 1, n).T
        return self.path(q, path.u + self.control * step[count:].reshape(stages, -1).T)

    def least_violation(self, q: np.ndarray, u: np.ndarray, iterations: int = ITERATIONS) -> Path:
        """Return the path of least violation near a path; its ends are inserted first.

        `q` is (n, N+1), `u` (m, N). `iterations` limits the Gauss-Newton steps.
        """
        path, damping, sizes = self.path(self.with_ends(q), u), 1e-3, []
        for _ in range(iterations):
            if path.met or not np.isfinite(path.violation):
                return path
            self.progress(f"feasibility: constraint violation {path.violation:.1e}")
            sizes.append(self._size(path))
            if len(sizes) > PATIENCE and sizes[-1] > (1 - STALLED) * sizes[-1 - PATIENCE]:
                return replace(path, at_rest=True)
            model = self.model(path)
            if np.linalg.norm(model.slope()) < AT_REST * model.size:
                return replace(path, at_rest=True)
            path, damping = self._step(path, model, damping)
            if damping > LARGEST_DAMPING:  # to rounding, no step makes it smaller
                return replace(path, at_rest=True)
        return path

    def _step(self, path: Path, model: LinearModel, damping: float) -> tuple[Path, float]:
        """Return one accepted step; damping increases until the violation decreases."""
        while damping <= LARGEST_DAMPING:
            try:
                ahead = self.moved(path, model.step(damping))
            except RuntimeError:  # singular: some entry is no number, or the damping is lost in it
                return path, np.inf
            if self._size(ahead) < model.size:
                return ahead, max(damping / 10, SMALLEST_DAMPING)
            damping *= 10
        return path, damping

    def _size(self, path: Path) -> float:
        over = np.linalg.norm(np.maximum(path.distance, 0.0))
        size = float(np.hypot(np.linalg.norm(self.weight * path.gap), over))
        return size if np.isfinite(size) else np.inf
