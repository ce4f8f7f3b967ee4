r"""How slow a flow is, as a smooth function of its eigenvalues, and how that changes with a gain.

With M the metric over the primal neurons, K the rates of the dual ones and W the penalties of the
rows, the flow at a settled point is

.. math:: J = \begin{pmatrix} -M (H + A^T W A) & -M A^T \\ K A & 0 \end{pmatrix}, \qquad
    d\lambda = y^* \, dJ \, x

for an eigenvalue with left and right vectors y and x, y*x = 1. An objective says how fast each mode
decays, b > 0, in units of its own: the fastest time constant, or a step. The slowest mode counts:

.. math:: \log \max_i \frac{1}{b_i} \;\le\; \frac{1}{p} \log \sum_i b_i^{-p} ,

which is smooth, and sharper with larger p. One eigenvalue problem gives the value and its gradient
by all gains.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, final

import numpy as np
import scipy.linalg

from ann_dc.analysis.blas import one_thread
from ann_dc.analysis.saddle import Saddle
from ann_dc.network.metrics.contract import Metric, Row
from ann_dc.network.metrics.pyramid import Pyramid
from ann_dc.network.metrics.stiffness import Stiffness


class Slope(NamedTuple):
    """A value and its derivatives: d value = Re sum by_eigenvalue dlambda + by_step d log h."""

    value: float
    by_eigenvalue: np.ndarray
    by_step: float = 0.0


class Objective(ABC):
    """What is to be small; see the module.

    Attributes
    ----------
    unit : str
        In what the slowest mode's time is told.
    stepped : bool
        Whether a step h counts, which is then chosen too.
    dual_late : bool
        Whether the dual neurons of a step move on the new residual, which acts as h K more penalty.
    """

    unit: str
    stepped: bool = False
    dual_late: bool = False

    @abstractmethod
    def decays(self, eigenvalues: np.ndarray, step: float) -> np.ndarray:
        """How fast every mode (n,) decays, in the unit of the objective; negative: it grows."""

    @abstractmethod
    def smoothed(
        self, eigenvalues: np.ndarray, step: float, sharpness: float, floor: float
    ) -> Slope:
        """Log of the slowest mode's time, smoothed.

        Parameters
        ----------
        eigenvalues : (n,) complex array
            Of the flow, in 1 / network time.
        step : float
            h, in network time.
        sharpness : float
            p.
        floor : float
            Decay below which the logarithm goes on straight, through zero: where a mode grows, the
            value still says how to make it decay.
        """

    def slowness(self, eigenvalues: np.ndarray, step: float) -> float:
        """Time of the slowest mode, not smoothed; infinite if one grows.

        Parameters
        ----------
        eigenvalues : (n,) complex array
        step : float
            h, in network time.
        """
        slowest = self.decays(eigenvalues, step).min()
        return float(1 / slowest) if slowest > 0 else float("inf")


@final
class _SettlingTime(Objective):
    unit = "ratio"

    def decays(self, eigenvalues, step):
        return -eigenvalues.real / np.abs(eigenvalues).max()

    def smoothed(self, eigenvalues, step, sharpness, floor):
        moduli = np.maximum(np.abs(eigenvalues), 1e-300)
        scaled = (moduli / moduli.max()) ** sharpness
        radius = moduli.max() * scaled.sum() ** (1 / sharpness)
        fast = scaled / scaled.sum() * eigenvalues.conj() / moduli**2  # d log radius
        b = -eigenvalues.real / radius
        value, by_decay = _log_slowest(b, sharpness, floor)
        return Slope(value, -by_decay / radius - (by_decay @ b) * fast)


@final
class _Steps(Objective):
    unit = "steps a factor of e:"
    stepped = True

    def __init__(self, *, dual_late: bool) -> None:
        self.dual_late = dual_late

    def decays(self, eigenvalues, step):
        return -np.log(np.maximum(np.abs(1 + step * eigenvalues), 1e-300))

    def smoothed(self, eigenvalues, step, sharpness, floor):
        value, by_decay = _log_slowest(self.decays(eigenvalues, step), sharpness, floor)
        left = 1 + step * eigenvalues
        by_eigenvalue = -by_decay * step / np.where(left == 0, 1e-300, left)
        return Slope(value, by_eigenvalue, float(np.real(by_eigenvalue @ eigenvalues)))


SETTLING_TIME: Objective = _SettlingTime()
"""The ratio radius / |abscissa|: settling in fastest time constants, per factor of e."""

STEPS: Objective = _Steps(dual_late=False)
"""Steps of all neurons at once at the best h, per factor of e: -1 / log max |1 + h lambda|."""

TWO_PHASE_STEPS: Objective = _Steps(dual_late=True)
"""The same where dual neurons move after the primal ones, on the new residual."""


def _log_slowest(decays: np.ndarray, sharpness: float, floor: float) -> tuple[float, np.ndarray]:
    """(1/p) log sum b^-p and its gradient (n,)."""
    above = np.maximum(decays, floor)
    below = np.minimum(decays - floor, 0.0) / floor
    logs = -np.log(above) - below
    largest = logs.max()
    shares = np.exp(sharpness * (logs - largest))
    value = largest + np.log(shares.sum()) / sharpness
    return float(value), -shares / shares.sum() / above


class DenseMetric(ABC):
    """M over the primal neurons (z, z) as a function of their rates T and of its nodes' factors."""

    @abstractmethod
    def matrix(self, rates: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """M (z, z) for rates (z,) and factors (m,) on the gains of the nodes."""

    @abstractmethod
    def slope(
        self, by_matrix: np.ndarray, rates: np.ndarray, nodes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives by log rates (z,) and log factors (m,), given those by M (z, z)."""


@final
@dataclass(frozen=True, eq=False)
class _Added(DenseMetric):
    """M = diag(T) + (hats D) S (hats D)', D^2 the factors: no node for time constants alone."""

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
class _Between(DenseMetric):
    """M = T^{1/2} S^{-1} T^{1/2}; the stiffness S stays as it is."""

    compliance: np.ndarray

    def matrix(self, rates, nodes):
        root = np.sqrt(rates)
        return root[:, None] * self.compliance * root

    def slope(self, by_matrix, rates, nodes):
        symmetric = 0.5 * (by_matrix + by_matrix.T)
        return (symmetric * self.matrix(rates, nodes)).sum(axis=1), np.zeros(len(nodes))


def dense_metric(metric: Metric, row: Row, primal: np.ndarray) -> DenseMetric:
    """A metric as a function of its gains.

    Parameters
    ----------
    metric : Metric
    row : Row
    primal : (z,) array of int
        Components of the state vector.

    Returns
    -------
    DenseMetric
        A pyramid's nodes are its coarse neurons in the order of its wires; others have none.
    """
    if isinstance(metric, Stiffness):
        return _Between(np.linalg.inv(metric.matrix(row)[primal][:, primal].toarray()))
    hats = metric.wires(row).weights[primal].toarray()
    if not isinstance(metric, Pyramid):
        return _Added(hats, np.zeros((0, 0)))
    S = scipy.linalg.block_diag(*(point for gain in metric.gains for point in gain))
    active = np.abs(S).sum(axis=1) > 0
    return _Added(hats, S[np.ix_(active, active)])


@dataclass(frozen=True, kw_only=True, eq=False)
class DenseFlow:
    """The flow at a settled point as a function of its gains.

    A vector of gains is (T, K, W, nodes, h): rates of the z primal and of the d dual neurons,
    penalties (d,) of the rows, factors on the metric's m nodes, and the step.

    Attributes
    ----------
    saddle : Saddle
        H and A at the settled point.
    metric : DenseMetric
        M as a function of T and of the nodes.
    """

    saddle: Saddle
    metric: DenseMetric

    @cached_property
    def H(self) -> np.ndarray:
        """Hessian of the Lagrangian (z, z)."""
        return self.saddle.H.toarray()

    @cached_property
    def A(self) -> np.ndarray:
        """Jacobian of the constraints (d, z)."""
        return self.saddle.A.toarray()

    def split(self, gains: np.ndarray) -> list[np.ndarray]:
        """T, K, W, nodes and h."""
        d, z = self.A.shape
        return np.split(gains, [z, z + d, z + 2 * d, len(gains) - 1])

    def jacobian(self, gains: np.ndarray, objective: Objective) -> np.ndarray:
        """J (z + d, z + d), with the penalty that the objective's order of steps adds."""
        T, K, W, nodes, (h,) = self.split(gains)
        if objective.dual_late:
            W = W + h * K
        M, A = self.metric.matrix(T, nodes), self.A
        stiffness = self.H + (A.T * W) @ A
        corner = np.zeros((len(A), len(A)))
        return np.block([[-M @ stiffness, -M @ A.T], [K[:, None] * A, corner]])

    def slowness(self, gains: np.ndarray, objective: Objective) -> float:
        """Of the slowest mode, not smoothed; infinite where the point repels."""
        with one_thread():
            eigenvalues = scipy.linalg.eigvals(self.jacobian(gains, objective), check_finite=False)
        return objective.slowness(np.asarray(eigenvalues), float(gains[-1]))

    def smoothed(
        self, gains: np.ndarray, objective: Objective, sharpness: float, floor: float
    ) -> Evaluation:
        """The objective at these gains, and its gradient by their logarithms.

        Parameters
        ----------
        gains : (z + 2d + m + 1,) array
            Positive.
        objective : Objective
        sharpness, floor : float
            See `Objective.smoothed`.

        Returns
        -------
        Evaluation

        Raises
        ------
        numpy.linalg.LinAlgError
            If the eigenvectors do not span the space.
        """
        with one_thread():
            found = scipy.linalg.eig(self.jacobian(gains, objective), check_finite=False)
            eigenvalues, right = np.asarray(found[0]), np.asarray(found[1])
            h = float(gains[-1])
            slope = objective.smoothed(eigenvalues, h, sharpness, floor)
            by_jacobian = np.real((right * slope.by_eigenvalue) @ np.linalg.inv(right)).T
            gradient = self._chained(gains, by_jacobian, objective)
        gradient[-1] += slope.by_step
        return Evaluation(slope.value, gradient, objective.slowness(eigenvalues, h))

    def _chained(self, gains: np.ndarray, by_J: np.ndarray, objective: Objective) -> np.ndarray:
        """Derivatives by the logarithms of the gains, given those by J."""
        T, K, W, nodes, (h,) = self.split(gains)
        A, z, late = self.A, len(T), float(objective.dual_late)
        M = self.metric.matrix(T, nodes)
        stiffness = self.H + (A.T * (W + late * h * K)) @ A
        zz, zd, dz = by_J[:z, :z], by_J[:z, z:], by_J[z:, :z]
        by_T, by_nodes = self.metric.slope(-(zz @ stiffness + zd @ A), T, nodes)
        by_W = -((A @ M @ zz) * A).sum(axis=1)
        by_K = (dz * A).sum(axis=1) + late * h * by_W
        by_h = late * h * (K @ by_W)
        return np.concatenate([by_T, K * by_K, W * by_W, by_nodes, [by_h]])


class Evaluation(NamedTuple):
    """What one eigenvalue problem says."""

    value: float
    """Log of the slowest mode's time, smoothed."""
    gradient: np.ndarray
    """By the logarithms of the gains."""
    slowness: float
    """Time of the slowest mode, not smoothed."""
