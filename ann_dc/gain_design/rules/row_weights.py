r"""Weights of the constraint rows, by equilibration.

Rows that reach their neurons through small numbers are slow, and no common penalty mends that. The
weights w are chosen such that every row is as stiff as the others once the primal neurons have
their time constants: repeat

.. math::
    T_j = \frac{1}{h_j + \max_k \sum_i w_i A_{ij}^2}, \qquad
    s_i = \max_k w_i \sum_j A_{ij}^2 T_j, \qquad
    w_i \leftarrow w_i \sqrt{\bar s / s_i},

with h_j the curvature of the cost in units of the base penalty, maxima over the stages, and the
geometric mean of w kept at one. The curvature keeps the weights finite: without it they run away.
"""

from __future__ import annotations

import numpy as np

from ann_dc.analysis.linearisation import Linearisation


def equilibrated(linear: Linearisation, penalty: float, sweeps: int) -> np.ndarray:
    """Row weights (P,) of the dual neurons, zero for others; all one where ``sweeps`` is zero.

    Parameters
    ----------
    linear : Linearisation
        At a state where it was evaluated.
    penalty : float
        The base penalty rho_0, against which the cost's curvature counts.
    sweeps : int
        How often the weights are improved; fewer sweeps stay nearer to equal weights.

    Returns
    -------
    (P,) array

    References
    ----------
    .. [1] D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices,
       Rutherford Appleton Laboratory, RAL-TR-2001-034, 2001.
    """
    dual = linear.dual
    weights = dual.astype(float)
    curvature = np.maximum(linear.cost_curvature().max(axis=1), 0.0) / penalty
    for _ in range(sweeps):
        stiffness = curvature + linear.row_sums(weights).max(axis=1)
        rate = np.where(
            linear.primal & (stiffness > 0), 1 / np.where(stiffness > 0, stiffness, 1), 0
        )
        row = weights[dual] * linear.column_sums(rate).max(axis=1)[dual]
        if not (np.isfinite(row).all() and (row > 0).all()):
            return dual.astype(float)
        weights[dual] *= np.sqrt(row.mean() / row)
        weights[dual] /= np.exp(np.log(weights[dual]).mean())
    return weights
