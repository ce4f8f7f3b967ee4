r"""Gains of the coarse-level neurons and of inequalities, from one linearisation.

The coarse neurons of grid point a, one per component, move the chain by their hat function. Their
stiffness is G_a = hat' (H + A'WA) hat, a (C, C) matrix, and their gain is gamma / G_a: Jacobi, one
grid point at a time. Active inequalities are among the constraints of A.

With T the primal time constants before any diode conducts, an active constraint has the weight

.. math:: w_i = \frac{1}{\max_k \sum_j G_{ij}^2 T_j}

over the stages at which it is active, z + w g > 0; if there is none, at the stage nearest to
activity. Alone, such a constraint satisfies s^2 + s + eta = 0, the mode of an equality. With the
full preconditioner in place of T, w would be smaller by the contribution of the coarse neurons.
Then w G'G no longer outweighs the curvature due to the multiplier, and the optimum is unstable. A
compliant constraint has the weight 1 / (G T G' + d), because a leak reduces its multiplier.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from scipy import sparse

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.network.preconditioners.multilevel import Multilevel, hat_positions

# ---- weights of inequality rows, from the time constants that cost and equalities alone would gi


def diode_weights(linear: Linearisation | MeanLinearisation, rate: np.ndarray) -> np.ndarray:
    """Return the weights w (P,) of rectifying multiplier neurons, zero for others.

    `linear` must be evaluated at one state, or be the mean of several. `rate` (P,) is 1 / tau of
    the primal neurons; other entries are ignored.
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
        active = felt[row] & (drawn > 0) & (drawn < price[row])
        nearest = felt[row] & (g[row] >= g[row][felt[row]].max())
        weights[row] = 1.0 / stiffness[row][active if active.any() else nearest].max()
    return weights


def active_weights(linear: Linearisation, weights: np.ndarray) -> np.ndarray:
    """Return the weights (P, N) of constraints that are active at a state, else zero.

    A soft constraint at its penalty weight counts as inactive: its multiplier does not move.
    `linear` must be evaluated at a state. `weights` (P,) are those of all constraints; equalities
    are always active.
    """
    return np.where(linear.is_active(weights), weights[:, None], 0.0)


# ---- the gains of the coarse coordinators, from one linearisation


def pyramid(
    linear: Linearisation | MeanLinearisation,
    rho: np.ndarray,
    gamma: float,
    *,
    coupled: bool = False,
) -> Multilevel | None:
    """Return the multilevel preconditioner at the state of a linearisation.

    `rho` (P,) is the penalty of every dual neuron's constraint, `gamma` the fraction of the Jacobi
    gain (0.5). If `coupled`, all components of a grid point have one gain matrix; otherwise each
    has its separate gain per level. Returns None if the cell array is too short for a level, or no
    position is live.
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
    return Multilevel(gains=tuple(gains))


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
    """Return hat' (H + A'WA) hat (points, C, C) of all levels, finest first.

    The constraints under a hat are c_k = F_k q_k - t_k and r_k = q_k - t_{k-1}. Their squares are
    expanded into products of hat values, which weight the sums over the stages.
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
    """Return G'WG (N, C, C) of the active inequalities, in q and in t."""
    if not linear.diode.any():
        return 0.0, 0.0
    rows, of_q, of_t = linear.inequality_matrices()
    weight = active_weights(linear, rho)[rows].T
    q, t = (np.einsum("kia,ki,kib->kab", G, weight, G) for G in (of_q, of_t))
    return q, t


@lru_cache(maxsize=4)
def _shares(count: int) -> Any:
    """Return hat values q^2, t^2, b^2, qt and qb (points of all levels, 5N).

    b is the t of the previous stage. The matrix is sparse, because a position lies under two hats
    of a level; ``count`` is 2N.
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
    """Return the number of levels over 2N positions; the finest has no more intervals."""
    return int(np.floor(np.log2(max(count - 1, 1))))
