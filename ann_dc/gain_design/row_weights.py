r"""Weights of the constraint rows: by equilibration, or by what the controls reach.

Rows that reach their neurons through small numbers are slow, and no common penalty mends that. The
weights w are chosen such that every row is as stiff as the others once the primal neurons have
their time constants: repeat

.. math::
    T_j = \frac{1}{h_j + \max_k \sum_i w_i A_{ij}^2}, \qquad
    s_i = \max_k w_i \sum_j A_{ij}^2 T_j, \qquad
    w_i \leftarrow w_i \sqrt{\bar s / s_i},

with h_j the curvature of the cost in units of the base penalty, maxima over the stages, and the
geometric mean of w kept at one. The curvature keeps the weights finite: without it they run away.

Or a row weighs the less the further the controls move its state at the price of one,
:math:`1 / w_i = \sum_k (\Phi_k B R^{-1} B^T \Phi_k^T)_{ii}` over a quarter of the horizon.
"""

from __future__ import annotations

import numpy as np

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation

WINDOWS = 4
"""In how many parts of the horizon it is looked at what the controls reach."""


def equilibrated(
    linear: Linearisation | MeanLinearisation,
    penalty: float,
    sweeps: int,
    weights: np.ndarray | None = None,
) -> np.ndarray:
    """Row weights (P,) of the dual neurons, zero for others.

    Parameters
    ----------
    linear : Linearisation
        At a state where it was evaluated.
    penalty : float
        The base penalty rho_0, against which the cost's curvature counts.
    sweeps : int
        How often the weights are improved; fewer sweeps stay nearer to where they begin.
    weights : (P,) array, optional
        Where they begin; equal weights by default.

    Returns
    -------
    (P,) array

    References
    ----------
    .. [1] D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices,
       Rutherford Appleton Laboratory, RAL-TR-2001-034, 2001.
    """
    dual = linear.dual
    start = dual.astype(float) if weights is None else weights
    weights = np.array(start)
    curvature = np.maximum(linear.cost_curvature().max(axis=1), 0.0) / penalty
    for _ in range(sweeps):
        stiffness = curvature + linear.row_sums(weights).max(axis=1)
        rate = np.where(
            linear.primal & (stiffness > 0), 1 / np.where(stiffness > 0, stiffness, 1), 0
        )
        row = weights[dual] * linear.column_sums(rate).max(axis=1)[dual]
        if not (np.isfinite(row).all() and (row > 0).all()):
            return start
        weights[dual] *= np.sqrt(row.mean() / row)
        weights[dual] /= np.exp(np.log(weights[dual]).mean())
    return weights


def by_reach(linear: Linearisation | MeanLinearisation) -> np.ndarray:
    """Row weights (P,) of the dual neurons, zero for others: the inverse of what controls reach.

    Both rows of a chain have the same weight, a chain that no control moves the mean one, and the
    geometric mean is one.

    Parameters
    ----------
    linear : Linearisation
        At a state where it was evaluated.

    Returns
    -------
    (P,) array
    """
    F, _, _ = linear.stage_matrices()
    B, R = linear.control_matrices()
    stages, chains, _ = B.shape
    cheap = R > 0
    effort = B / np.sqrt(np.where(cheap, R, R[cheap].mean() if cheap.any() else 1.0))
    length, reached = max(stages // WINDOWS, 1), np.zeros(chains)
    for first in range(0, stages - length + 1, length):
        gramian = np.zeros((chains, chains))
        for k in range(first, first + length):
            gramian = F[k] @ gramian @ F[k].T + effort[k] @ effort[k].T
        reached += gramian.diagonal()
    weights = linear.dual.astype(float)
    known = np.isfinite(reached) & (reached > 0)
    if known.any():
        size = np.exp(np.log(reached[known]).mean())
        of_chain = np.where(known, size / np.where(known, reached, 1.0), 1.0)
        rows = [linear.network.neuron_index[dual.neuron] for dual in linear.network.cell.duals]
        weights[rows] = np.resize(of_chain, len(rows))
    return weights
