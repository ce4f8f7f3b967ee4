r"""Weights of inequality rows, from the time constants that cost and equalities alone would give.

With T the primal time constants before any diode conducts, a row that is pressed gets

.. math:: w_i = \frac{1}{\max_k \sum_j G_{ij}^2 T_j}

over the stages at which it is pressed, z + w g > 0; where it is at none, at that where it is
nearest. By itself such a row obeys s^2 + s + eta = 0, the mode of an equality. The full metric in
place of T would make w smaller by what coordinators move; then w G'G no longer outweighs the
curvature that the multiplier brings, and the optimum repels. A compliant row gets
1 / (G T G' + d): its multiplier takes part of what it presses from a leak.
"""

from __future__ import annotations

import numpy as np

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation


def diode_weights(linear: Linearisation | MeanLinearisation, rate: np.ndarray) -> np.ndarray:
    """Weights w (P,) of the rows of diode neurons, zero for other neurons.

    Parameters
    ----------
    linear : Linearisation
        At a state where it was evaluated, or of several.
    rate : (P,) array
        1 / tau of the primal neurons; those of others are not read.
    """
    weights = np.zeros(len(linear.diode))
    if not linear.diode.any():
        return weights
    stiffness = np.stack([member.column_sums(rate) for member in linear.members], axis=1)
    felt = stiffness > 0
    stiffness = stiffness + np.stack([member.compliance for member in linear.members], axis=1)
    g = np.stack([member.g for member in linear.members], axis=1)
    z = np.stack([member.z for member in linear.members], axis=1)
    price = np.stack([member.price for member in linear.members], axis=1)
    for row in np.flatnonzero(linear.diode):
        if not felt[row].any():
            weights[row] = 1.0
            continue
        drawn = z[row] + g[row] / stiffness[row].max()
        pressed = felt[row] & (drawn > 0) & (drawn < price[row])
        nearest = felt[row] & (g[row] >= g[row][felt[row]].max())
        weights[row] = 1.0 / stiffness[row][pressed if pressed.any() else nearest].max()
    return weights


def pressed_weights(linear: Linearisation, weights: np.ndarray) -> np.ndarray:
    """Weights (P, N) of the rows that press at a state, zero where a diode does not conduct.

    A soft row at its price is as good as idle: its multiplier does not move.

    Parameters
    ----------
    linear : Linearisation
        At a state where it was evaluated.
    weights : (P,) array
        Of all rows; those of equalities always press.
    """
    return np.where(linear.presses(weights), weights[:, None], 0.0)
