r"""The gains of the coarse coordinators, from one linearisation.

The coarse neurons of grid point a, one a component, move the chain by their hat. The stiffness
that they feel is G_a = hat' (H + A'WA) hat, a (C, C) matrix, and their gain is gamma / G_a: Jacobi,
one grid point at a time. Inequalities that press are among the rows of A.

With T the primal time constants before any diode conducts, a row that is pressed gets

.. math:: w_i = \frac{1}{\max_k \sum_j G_{ij}^2 T_j}

over the stages at which it is pressed, z + w g > 0; where it is at none, at that where it is
nearest. By itself such a row obeys s^2 + s + eta = 0, the mode of an equality. The full metric in
place of T would make w smaller by what coordinators move; then w G'G no longer outweighs the
curvature that the multiplier brings, and the optimum repels. A compliant row gets
1 / (G T G' + d): its multiplier takes part of what it presses from a leak.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy import sparse

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.network.preconditioners.multilevel import Pyramid, hat_positions

# ---- weights of inequality rows, from the time constants that cost and equalities alone would gi


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


# ---- the gains of the coarse coordinators, from one linearisation


def pyramid(
    linear: Linearisation | MeanLinearisation,
    rho: np.ndarray,
    gamma: float,
    *,
    coupled: bool = False,
) -> Pyramid | None:
    """Coordinators for a network at the state where ``linear`` was evaluated.

    Parameters
    ----------
    linear : Linearisation
    rho : (P,) array
        Penalty of every dual neuron's row.
    gamma : float
        Share of the Jacobi gain; 0.5.
    coupled : bool
        All components of a grid point through one gain matrix, instead of each by itself with one
        gain a level.

    Returns
    -------
    Pyramid or None
        None where the row is too short for a level, or the plant too stiff to follow.
    """
    live = linear.network.chain_live.T
    levels = _levels(len(live))
    if levels < 1 or not live.any():
        return None
    every = np.mean([_stiffness(member, rho, live) for member in linear.members], axis=0)
    gains, first = [], 0
    for level in range(levels, 0, -1):
        G = every[first : first + (1 << level) + 1]
        first += len(G)
        alive = np.ones(len(G), bool)
        alive[[0, -1]] = live[0].any(), live[-1].any()
        gains.append(np.where(alive[:, None, None], gamma * _inverse(G, alive, coupled), 0.0))
    return Pyramid(gains=tuple(gains))


def _inverse(G: np.ndarray, alive: np.ndarray, coupled: bool) -> np.ndarray:
    if not np.isfinite(G).all():  # a run that overflows is told so, not stopped here
        return np.zeros_like(G)
    if coupled:
        # where the cost is not convex G may be indefinite; a coarse gain must not be
        stiffness, modes = np.linalg.eigh(G)
        usable = stiffness > 1e-10 * stiffness[:, -1:]
        gain = np.where(usable, 1.0 / np.where(usable, stiffness, 1.0), 0.0)
        return np.einsum("aij,aj,akj->aik", modes, gain, modes)
    largest = np.einsum("aii->ai", G)[alive].max(axis=0, initial=0.0)
    return np.broadcast_to(np.diag(1.0 / np.where(largest > 0, largest, np.inf)), G.shape)


def _stiffness(linear: Linearisation, rho: np.ndarray, live: np.ndarray) -> np.ndarray:
    """hat' (H + A'WA) hat (points, C, C) for all grid points of all levels, finest first.

    The rows under a hat are c_k = F_k q_k - t_k and r_k = q_k - t_{k-1}; their squares are
    expanded into products of hat values, with which those of the stages are added up.
    """
    index, duals = linear.network.neuron_index, linear.network.cell.duals
    weight = np.array([rho[index[dual.neuron]] for dual in duals])
    F, H_qq, H_tt = linear.stage_matrices()
    c, r = weight[: live.shape[1]], weight[live.shape[1] :]
    # a dead position has no neuron to move: its columns of A and H vanish
    q, t, before = live[0::2] * 1.0, live[1::2] * 1.0, np.zeros(live[1::2].shape)
    before[1:] = t[:-1]
    F = F * q[:, None, :]
    P_qq, P_tt = _pressed(linear, rho)
    H_qq, H_tt = (
        H * z[:, :, None] * z[:, None, :] for H, z in ((H_qq + P_qq, q), (H_tt + P_tt, t))
    )
    identity = np.eye(live.shape[1])
    qt = np.einsum("kia,i,ki->kai", F, c, t)
    squares = (
        np.einsum("kia,i,kib->kab", F, c, F) + H_qq + (r * q)[:, :, None] * identity,
        (c * t)[:, :, None] * identity + H_tt,
        (r * before)[:, :, None] * identity,
        -qt - qt.transpose(0, 2, 1),
        -2 * (r * q * before)[:, :, None] * identity,
    )
    together = np.concatenate(squares)
    return (_shares(len(live)) @ together.reshape(len(together), -1)).reshape(-1, *identity.shape)


def _pressed(linear: Linearisation, rho: np.ndarray) -> tuple[Any, Any]:
    """G'WG (N, C, C) of the inequalities that press, in q and in t."""
    if not linear.diode.any():
        return 0.0, 0.0
    rows, of_q, of_t = linear.inequality_matrices()
    weight = pressed_weights(linear, rho)[rows].T
    q, t = (np.einsum("kia,ki,kib->kab", G, weight, G) for G in (of_q, of_t))
    return q, t


@lru_cache(maxsize=4)
def _shares(count: int) -> Any:
    """(points of all levels, 5N): hat values q^2, t^2, b^2, qt and qb, b the t of the stage before.

    Sparse, because a position of the chain lies under two hats of a level; ``count`` is 2N.
    """
    place, levels = np.arange(count), []
    for level in range(_levels(count), 0, -1):
        left, share = hat_positions(count, 1 << level)
        entries = np.r_[1 - share, share], (np.r_[left, left + 1], np.r_[place, place])
        points = (1 << level) + 1
        hat: Any = sparse.csc_array(entries, shape=(points, count))
        q, t = hat[:, 0::2], hat[:, 1::2]
        b = sparse.hstack([sparse.csc_array((points, 1)), t[:, :-1]], format="csc")
        pairs = ((q, q), (t, t), (b, b), (q, t), (q, b))
        levels.append(sparse.hstack([one.multiply(other) for one, other in pairs]))
    return sparse.vstack(levels, format="csr")


def _levels(count: int) -> int:
    """Levels of a pyramid over 2N positions: the finest has no more intervals than these."""
    return int(np.floor(np.log2(max(count - 1, 1))))
