r"""Eigenvalues of a flow as functions of its gains: objective and exact gradient.

With M the preconditioner of the primal neurons, K the rates of the dual neurons and W the penalties
of the constraints, the flow at a settled point is

.. math:: J = \begin{pmatrix} -M (H + A^T W A) & -M A^T \\ K A & 0 \end{pmatrix}, \qquad
    d\lambda = y^* \, dJ \, x

for an eigenvalue with left and right vectors y and x, y*x = 1. One eigenvalue problem gives an
objective (`slowness`) and its gradient with respect to all gains.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, final

import numpy as np
import scipy.linalg

from ann_dc.analysis.objectives import SETTLING_TIME, Objective
from ann_dc.analysis.saddle import Saddle
from ann_dc.network.preconditioners.base import ArrayLayout, Preconditioner
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.stiffness import Stiffness

STEPS_TRIED = np.geomspace(0.25, 8.0, 16)
"""Initial steps of a search; 1 is the largest stable step of the simultaneous order."""


class _DenseMetric(ABC):
    """M of the primal neurons (z, z) as a function of their rates T and node factors."""

    @abstractmethod
    def matrix(self, rates: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Return M (z, z) for rates (z,) and factors (m,) on the gains of the nodes."""

    @abstractmethod
    def slope(
        self, by_matrix: np.ndarray, rates: np.ndarray, nodes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return derivatives by log rates (z,) and log factors (m,), from those by M."""


@final
@dataclass(frozen=True, eq=False)
class _Added(_DenseMetric):
    """M = diag(T) + (hats D) S (hats D)', D^2 the factors; no nodes if diagonal."""

    hats: np.ndarray
    S: np.ndarray

    def matrix(self, rates, nodes):
        spread = self.hats * np.sqrt(nodes)
        return np.diag(rates) + spread @ self.S @ spread.T

    def slope(self, by_matrix, rates, nodes):
        root = np.sqrt(nodes)
        by_gain = self.hats.T @ (0.5 * (by_matrix + by_matrix.T)) @ self.hats
        return np.diag(by_matrix) * rates, root * ((by_gain * self.S) @ root)


@final
@dataclass(frozen=True, eq=False)
class _Between(_DenseMetric):
    """M = T^{1/2} S^{-1} T^{1/2} with a constant stiffness S."""

    compliance: np.ndarray

    def matrix(self, rates, nodes):
        root = np.sqrt(rates)
        return root[:, None] * self.compliance * root

    def slope(self, by_matrix, rates, nodes):
        symmetric = 0.5 * (by_matrix + by_matrix.T)
        return (symmetric * self.matrix(rates, nodes)).sum(axis=1), np.zeros(len(nodes))


def dense_preconditioner(
    preconditioner: Preconditioner, row: ArrayLayout, primal: np.ndarray
) -> _DenseMetric:
    """Return a preconditioner as a function of its gains.

    `primal` (z,) are indices of the state vector. The nodes of a multilevel preconditioner are its
    coarse neurons in the order of their wires; other kinds have none.
    """
    if isinstance(preconditioner, Stiffness):
        return _Between(np.linalg.inv(preconditioner.matrix(row)[primal][:, primal].toarray()))
    hats = preconditioner.wires(row).weights[primal].toarray()
    if not isinstance(preconditioner, Multilevel):
        return _Added(hats, np.zeros((0, 0)))
    S = np.asarray(scipy.linalg.block_diag(*(S for gain in preconditioner.gains for S in gain)))
    active = np.abs(S).sum(axis=1) > 0
    return _Added(hats, S[np.ix_(active, active)])


def coarse_neurons(preconditioner: Preconditioner) -> list[tuple[int, int, int]]:
    """Return (level, point, chain) of every coarse neuron, in the order of the wires."""
    if not isinstance(preconditioner, Multilevel):
        return []
    return [
        (level, int(point), int(chain))
        for level, gain in enumerate(preconditioner.gains)
        for point, chain in np.argwhere(np.abs(gain).sum(axis=-1) > 0)
    ]


def scaled_preconditioner(preconditioner: Preconditioner, factors: np.ndarray) -> Preconditioner:
    """Return D S D for multilevel gains S; D^2 are the factors (m,) of coarse neurons."""
    if not isinstance(preconditioner, Multilevel):
        return preconditioner
    roots = [np.ones(gain.shape[:2]) for gain in preconditioner.gains]
    for (level, point, chain), factor in zip(coarse_neurons(preconditioner), factors):
        roots[level][point, chain] = np.sqrt(factor)
    scaled = (
        root[:, :, None] * S * root[:, None, :] for root, S in zip(roots, preconditioner.gains)
    )
    return replace(preconditioner, gains=tuple(scaled))


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseFlow:
    """Flow at a settled point as a function of its gains.

    A vector of gains is (T, K, W, nodes, h): rates of the z primal and d dual neurons, penalties
    (d,) of the constraints, factors on the m nodes of the preconditioner, and the step. `saddle`
    contains H and A at the settled point; `preconditioner` is M as a function of T and of the
    nodes.
    """

    saddle: Saddle
    preconditioner: _DenseMetric

    @cached_property
    def H(self) -> np.ndarray:
        """Hessian of the Lagrangian (z, z)."""
        return self.saddle.H.toarray()

    @cached_property
    def A(self) -> np.ndarray:
        """Jacobian of the constraints (d, z)."""
        return self.saddle.A.toarray()

    def split(self, gains: np.ndarray) -> list[np.ndarray]:
        """Split a gain vector into T, K, W, nodes and h."""
        d, z = self.A.shape
        return np.split(gains, [z, z + d, z + 2 * d, len(gains) - 1])

    def jacobian(self, gains: np.ndarray, objective: Objective) -> np.ndarray:
        """Return J (z + d, z + d), with the penalty that the objective's step order adds."""
        T, K, W, nodes, (h,) = self.split(gains)
        if objective.dual_late:
            W = W + h * K
        M, A = self.preconditioner.matrix(T, nodes), self.A
        stiffness = self.H + (A.T * W) @ A
        corner = np.zeros((len(A), len(A)))
        return np.block([[-M @ stiffness, -M @ A.T], [K[:, None] * A, corner]])

    def slowness(self, gains: np.ndarray, objective: Objective) -> float:
        """Return the unsmoothed time of the slowest mode; infinite if it is unstable."""
        eigenvalues = scipy.linalg.eigvals(self.jacobian(gains, objective), check_finite=False)
        return objective.slowness(np.asarray(eigenvalues), float(gains[-1]))

    def near_best_step(self, gains: np.ndarray, objective: Objective) -> float:
        """Return the h of `STEPS_TRIED` with the smallest slowness; ignore the gains' h."""
        modes = np.linalg.eigvals(self.jacobian(gains, SETTLING_TIME))
        longest = (-2 * modes.real / np.abs(modes) ** 2).min()
        tried = [np.append(gains[:-1], longest * share) for share in STEPS_TRIED]
        return float(min(tried, key=lambda given: self.slowness(given, objective))[-1])

    def smoothed(
        self, gains: np.ndarray, objective: Objective, sharpness: float, floor: float
    ) -> Evaluation:
        """Return the smoothed objective and its gradient by the logarithms of the gains.

        `gains` (z + 2d + m + 1,) are positive; `sharpness` and `floor` as in `Objective.smoothed`.
        Raises numpy.linalg.LinAlgError if the eigenvectors do not span the space.
        """
        found = scipy.linalg.eig(self.jacobian(gains, objective), check_finite=False)
        eigenvalues, right = np.asarray(found[0]), np.asarray(found[1])
        h = float(gains[-1])
        slope = objective.smoothed(eigenvalues, h, sharpness, floor)
        by_jacobian = np.real((right * slope.by_eigenvalue) @ np.linalg.inv(right)).T
        gradient = self._chained(gains, by_jacobian, objective)
        gradient[-1] += slope.by_step
        return Evaluation(slope.value, gradient, objective.slowness(eigenvalues, h))

    def _chained(self, gains: np.ndarray, by_J: np.ndarray, objective: Objective) -> np.ndarray:
        """Return derivatives by the logarithms of the gains, from those by J."""
        T, K, W, nodes, (h,) = self.split(gains)
        A, z, late = self.A, len(T), float(objective.dual_late)
        M = self.preconditioner.matrix(T, nodes)
        stiffness = self.H + (A.T * (W + late * h * K)) @ A
        zz, zd, dz = by_J[:z, :z], by_J[:z, z:], by_J[z:, :z]
        by_T, by_nodes = self.preconditioner.slope(-(zz @ stiffness + zd @ A), T, nodes)
        by_W = -((A @ M @ zz) * A).sum(axis=1)
        by_K = (dz * A).sum(axis=1) + late * h * by_W
        by_h = late * h * (K @ by_W)
        return np.concatenate([by_T, K * by_K, W * by_W, by_nodes, [by_h]])


class Evaluation(NamedTuple):
    """Result of one eigenvalue problem."""

    value: float
    """Logarithm of the slowest mode's time, smoothed."""
    gradient: np.ndarray
    """Gradient by the logarithms of the gains."""
    slowness: float
    """Time of the slowest mode, not smoothed."""
