r"""Linear model of a step of a path, and the damped step of largest gain.

With gaps c that should be zero, distances d that should not be positive and control limits,

.. math::
    \min_s \tfrac12 \|c + C s\|^2 + \tfrac12 \|\max(0, d + D s)\|^2 + \tfrac12 \lambda \|s\|^2,
    \qquad s_{low} \le s \le s_{high}.

The active constraints and limits are found in a few rounds. After each round, constraints that the
step would violate are added and others removed, and unknowns that would exceed their limits are
fixed there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

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

        The damping is relative to the mean diagonal entry of the normal matrix of the gaps. Raises
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
