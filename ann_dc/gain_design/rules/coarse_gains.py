r"""The gains of the coarse coordinators, from one linearisation.

The coarse neurons of grid point a, one a component, move the chain by their hat. The stiffness
that they feel is G_a = hat' (H + A'WA) hat, a (C, C) matrix, and their gain is gamma / G_a: Jacobi,
one grid point at a time.
"""

from __future__ import annotations

import numpy as np

from ann_dc.analysis.linearisation import Linearisation, MeanLinearisation
from ann_dc.network.metrics.pyramid import Pyramid, hat_positions


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
    levels = int(np.floor(np.log2(max(len(live) - 1, 1))))
    if levels < 1 or not live.any():
        return None
    stiffness = [_Stiffness(member, rho, live) for member in linear.members]
    gains = []
    for level in range(levels, 0, -1):
        G = np.mean([member.of_level(1 << level) for member in stiffness], axis=0)
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


class _Stiffness:
    """hat' (H + A'WA) hat for all grid points of a level at once.

    The rows under a hat are c_k = F_k q_k - t_k and r_k = q_k - t_{k-1}; their squares are
    expanded into products of hat values, which are matrix products over the stages.
    """

    def __init__(self, linear: Linearisation, rho: np.ndarray, live: np.ndarray) -> None:
        index, duals = linear.network.neuron_index, linear.network.cell.duals
        weight = np.array([rho[index[dual.neuron]] for dual in duals])
        F, H_qq, H_tt = linear.stage_matrices()
        c, r = weight[: live.shape[1]], weight[live.shape[1] :]
        # a dead position has no neuron to move: its columns of A and H vanish
        q, t, before = live[0::2] * 1.0, live[1::2] * 1.0, np.zeros(live[1::2].shape)
        before[1:] = t[:-1]
        F = F * q[:, None, :]
        H_qq, H_tt = (H * z[:, :, None] * z[:, None, :] for H, z in ((H_qq, q), (H_tt, t)))
        diagonal = lambda values: values[:, :, None] * np.eye(live.shape[1])  # noqa: E731
        self._count = len(live)
        self._qq = np.einsum("kia,i,kib->kab", F, c, F) + H_qq + diagonal(r * q)
        self._tt, self._pp = diagonal(c * t) + H_tt, diagonal(r * before)
        self._qt = np.einsum("kia,i,ki,ib->kab", F, c, t, np.eye(live.shape[1]))
        self._qp = diagonal(r * q * before)

    def of_level(self, intervals: int) -> np.ndarray:
        """(intervals + 1, C, C)."""
        left, share = hat_positions(self._count, intervals)
        hat = np.zeros((intervals + 1, self._count))
        columns = np.arange(self._count)
        hat[left, columns] += 1 - share
        hat[left + 1, columns] += share
        q, t, before = hat[:, 0::2], hat[:, 1::2], np.zeros_like(hat[:, 1::2])
        before[:, 1:] = t[:, :-1]

        def total(shares, squares):
            return np.einsum("ak,kij->aij", shares, squares)

        cross = total(q * t, self._qt) + total(q * before, self._qp)
        return (
            total(q * q, self._qq)
            + total(t * t, self._tt)
            + total(before**2, self._pp)
            - cross
            - cross.transpose(0, 2, 1)
        )
