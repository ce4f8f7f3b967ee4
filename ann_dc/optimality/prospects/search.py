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
from scipy.sparse.linalg import splu

from ann_dc.problem.declaration import OptimalControlProblem
from ann_dc.problem.scales import natural_scales

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
    gap : (n, N) array
        f(q_k, u_k) - q_{k+1} in scales of the states.
    size : float
        Largest state, in its scale, and at least one.
    at_rest : bool
        Whether no small change makes the violation smaller.
    """

    q: np.ndarray
    u: np.ndarray
    gap: np.ndarray
    size: float
    at_rest: bool = False

    @property
    def violation(self) -> float:
        """Largest gap, in scales of the states; infinite where one is no number."""
        largest = float(np.abs(self.gap).max())
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
        Of the map, over that of the target.
    """

    def __init__(self, problem: OptimalControlProblem, weight: float = 1.0) -> None:
        self.problem, scales = problem, natural_scales(problem)
        self.state, self.control = scales.state_factors[:, None], scales.control_factors[:, None]
        self.weight = np.full((problem.n, problem.horizon), weight)
        self.weight[np.array(problem.fixed), -1] = 1.0
        self.free = np.ones((problem.n, problem.horizon + 1), bool)
        self.free[:, 0] = ~np.array(problem.fixed_start)
        self.free[:, -1] = ~np.array(problem.fixed)
        self._places()

    def path(self, q: np.ndarray, u: np.ndarray) -> Path:
        """A path (n, N+1) with its controls (m, N) and its gaps."""
        gap = (self.problem.functions.map(q[:, :-1], u) - q[:, 1:]) / self.state
        return Path(q=q, u=u, gap=gap, size=max(1.0, float(np.abs(q / self.state).max())))

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
            sizes.append(self._size(path))
            if len(sizes) > PATIENCE and sizes[-1] > (1 - STALLED) * sizes[-1 - PATIENCE]:
                return replace(path, at_rest=True)
            J = self.jacobian(path)
            weight = self.weight.T.ravel()
            gap = weight * path.gap.T.ravel()
            J = sparse.diags_array(weight) @ J
            if np.linalg.norm(J.T @ gap) < AT_REST * np.linalg.norm(gap):
                return replace(path, at_rest=True)
            path, damping = self._step(path, J, gap, damping)
            if damping > LARGEST_DAMPING:  # to rounding, no step makes it smaller
                return replace(path, at_rest=True)
        return path

    def _step(self, path: Path, J, gap: np.ndarray, damping: float) -> tuple[Path, float]:
        """One accepted step, with ever more damping until the violation falls."""
        normal = (J @ J.T).tocsc()
        size = max(float(normal.diagonal().mean()), 1e-300)
        while damping <= LARGEST_DAMPING:
            shifted = (normal + damping * size * sparse.eye_array(len(gap))).tocsc()
            try:
                ahead = self.moved(path, -(J.T @ splu(shifted).solve(gap)))
            except RuntimeError:  # singular: some entry is no number, or the damping is lost in it
                return path, np.inf
            if self._size(ahead) < np.linalg.norm(gap):
                return ahead, max(damping / 10, SMALLEST_DAMPING)
            damping *= 10
        return path, damping

    def _size(self, path: Path) -> float:
        size = float(np.linalg.norm(self.weight * path.gap))
        return size if np.isfinite(size) else np.inf
