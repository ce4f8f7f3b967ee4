r"""Paths that come as near as they can to what has to hold, by damped Gauss-Newton steps.

The map can always be met, by rolling it out; what may be impossible is to arrive. A path and its
controls are moved until the violation

.. math:: \tfrac12 \sum_k \| S^{-1} (f(q_k, u_k) - q_{k+1}) \|^2

vanishes, which proves that the target can be met, or comes to rest above zero: a point from which
no small change of any control brings the end nearer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from ann_dc.optimality.inequality_distances import RowDistances
from ann_dc.optimality.linear_model import LinearModel
from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales
from ann_dc.progress import Progress, silent

MET = 1e-9
"""Violation, in scales of the states, at which the constraints count as met."""
AT_REST = 1e-7
"""Slope of the violation over its size below which no control brings the end nearer."""
STALLED = 1e-3
"""Share of the violation that `PATIENCE` steps have to gain; some infima are at infinity."""
PATIENCE = 10
ITERATIONS = 200
"""Damped Gauss-Newton steps of one search."""
SMALLEST_DAMPING, LARGEST_DAMPING = 1e-12, 1e8


@dataclass(frozen=True, kw_only=True, eq=False)
class Path:
    """States and controls of a problem, with how far they violate its constraints.

    Attributes
    ----------
    q : (n, N+1) array
        States with the end, in the user's units.
    u : (m, N) array
        Within their limits.
    gap : (n, N) array
        f(q_k, u_k) - q_{k+1} in scales of the states.
    distance : (r N + r_e,) array
        Of the inequality rows, stage by stage, then of the end; positive where one is violated.
    size : float
        Largest state, in its scale, and at least one.
    at_rest : bool
        Whether no small change makes the violation smaller.
    """

    q: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    distance: np.ndarray
    size: float
    at_rest: bool = False

    @property
    def violation(self) -> float:
        """Largest gap or distance, in scales; infinite where one is no number."""
        largest = float(np.maximum(np.abs(self.gap).max(), self.distance.max(initial=0.0)))
        return largest if np.isfinite(largest) else np.inf

    @property
    def met(self) -> bool:
        """Whether the constraints hold."""
        return self.violation < MET * self.size


class Search:
    """Damped Gauss-Newton steps towards paths that meet a problem's constraints.

    Parameters
    ----------
    problem : OptimalControlProblem
    weight : float
        Of the map, over that of what may be missed: the inequality rows, or the target where there
        are none.
    progress : Progress
        Takes a line an iteration.
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
        """A path (n, N+1) with its controls (m, N), put within their limits, and its gaps."""
        u = np.clip(u, self.low, self.high)
        gap = (self.problem.functions.map(q[:, :-1], u) - q[:, 1:]) / self.state
        size = max(1.0, float(np.abs(q / self.state).max()))
        return Path(q=q, u=u, gap=gap, distance=self.rows.of(q, u), size=size)

    def with_ends(self, q: np.ndarray) -> np.ndarray:
        """States (n, N+1) with the ends of the problem in place."""
        first, last = self.problem.ends
        ends = np.column_stack([first, np.broadcast_to(last[:, None], (len(last), q.shape[1] - 1))])
        return np.where(self.free, q, ends)

    def jacobian(self, path: Path) -> sparse.csr_array:
        """Of the gaps (stage by stage) in the free states and the controls, all in scales."""
        F, B = self.problem.functions.map_jacobian(path.q[:, :-1], path.u)
        F = F * self.state[None] / self.state[:, None]
        B = B * self.control[None] / self.state[:, None]
        blocks = np.concatenate([F, B], axis=1).transpose(2, 0, 1).ravel()
        entries = np.concatenate([blocks, np.full(path.gap.size, -1.0)])[self.kept]
        return sparse.csr_array((entries, self.places), shape=self.shape)

    def _places(self) -> None:
        """Where the entries of the Jacobian stand: those of F and B, stage by stage, then -1."""
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
        """What a small step of the free states and the controls changes."""
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
        """A path after a step of its free states and its controls, in scales."""
        n, stages = path.gap.shape
        moves = np.zeros(self.free.size)
        count = int(self.free.sum())
        moves[self.free.T.ravel()] = step[:count]
        q = path.q + self.state * moves.reshape(stages + 1, n).T
        return self.path(q, path.u + self.control * step[count:].reshape(stages, -1).T)

    def least_violation(self, q: np.ndarray, u: np.ndarray, iterations: int = ITERATIONS) -> Path:
        """The path of least violation near one; its ends are put in place first.

        Parameters
        ----------
        q : (n, N+1) array
        u : (m, N) array
        iterations : int
            Gauss-Newton steps, at most.
        """
        path, damping, sizes = self.path(self.with_ends(q), u), 1e-3, []
        for _ in range(iterations):
            if path.met or not np.isfinite(path.violation):
                return path
            self.progress(f"prospects: a path that misses the constraints by {path.violation:.1e}")
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
        """One accepted step, with ever more damping until the violation falls."""
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
