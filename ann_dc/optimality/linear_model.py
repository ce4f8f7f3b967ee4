r"""What a small step of a path changes, to first order, and the damped step that gains most.

With gaps c that should be zero, distances d that should not be positive and limits of the controls,

.. math::
    \min_s \tfrac12 \|c + C s\|^2 + \tfrac12 \|\max(0, d + D s)\|^2 + \tfrac12 \lambda \|s\|^2,
    \qquad s_{low} \le s \le s_{high}.

Which rows count and which limits hold is found in a few rounds: after each, rows that the step
would violate join and others leave, and what would leave its limits is held there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

ROUNDS = 10
"""Of rows and limits, at most; a step that is no gain then is taken again, with more damping."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LinearModel:
    """Gaps, distances and limits around a path, to first order, all in scales.

    Attributes
    ----------
    gap : (E,) array
    of_gap : (E, K) sparse array
        Its slopes in the unknowns.
    distance : (R,) array
    of_distance : (R, K) sparse array
    low, high : (K,) arrays
        Room of a step.
    """

    gap: np.ndarray
    of_gap: sparse.csr_array
    distance: np.ndarray
    of_distance: sparse.csr_array
    low: np.ndarray
    high: np.ndarray

    @property
    def size(self) -> float:
        """Root of the gaps and the violated distances, squared."""
        over = np.maximum(self.distance, 0.0)
        return float(np.hypot(np.linalg.norm(self.gap), np.linalg.norm(over)))

    def slope(self) -> np.ndarray:
        """(K,) array: of half the violation squared, without what limits hold."""
        slope = self._slope(self.gap, self.distance)
        return np.where(self._holds(slope, np.zeros(len(slope))), 0.0, slope)

    def step(self, damping: float) -> np.ndarray:
        """(K,) array: the step that gains most, for damping over the mean size of the gaps' slopes.

        Raises
        ------
        RuntimeError
            If a matrix is singular.
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
        """The step of what is not held, given that of what is."""
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
