r"""Odd-even reduction (cyclic reduction) of a block-tridiagonal system.

A stiffness between neighbours, in blocks along the array, is solved by odd-even reduction. The
blocks at even positions add their net inputs to those of their two neighbours and are eliminated,
which leaves an array of half the length. With the hats :math:`W = S_{oe} S_{ee}^{-1}`,

.. math:: d_o \leftarrow d_o - W_{left}\, d_e - W_{right}\, d_{e'}, \qquad
    z_e = S_{ee}^{-1} d_e - W_{right}'^T z_{o'} - W_{left}^T z_o .

The hats of a level are the harmonic extensions of the next coarser level, so they depend on the
plant. The computation is feed-forward, down with W and up with its transpose, in log2 of the length
levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ann_dc.network.preconditioners.base import ArrayLayout
from ann_dc.network.preconditioners.stiffness import Stiffness


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """One halving of the array: E blocks are eliminated, O remain.

    Attributes
    ----------
    inverse : (E, b, b) array
        Inverses S_ee^{-1}.
    left : (O, b, b) array
        Hats of the remaining blocks over the eliminated ones on their left.
    right : (E - 1, b, b) array
        Hats over the eliminated blocks on their right; if E = O the last block has none.
    """

    inverse: np.ndarray
    left: np.ndarray
    right: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Elimination:
    """Inverse S^{-1} of a block array, level by level.

    Attributes
    ----------
    component : (blocks, b) array of int
        State vector components of every block; -1 for empty positions.
    levels : tuple of Level
        Levels from the longest array to a single block.

    References
    ----------
    .. [1] W. Gander, G. H. Golub, Cyclic reduction - history and applications, Scientific
       Computing, Springer, 1997, 73-85.
    """

    component: np.ndarray
    levels: tuple[Level, ...]

    def solve(self, drives: np.ndarray) -> np.ndarray:
        """Return S^{-1} d for net inputs d (blocks, b, ...)."""
        done, rest = [], drives
        for level in self.levels:
            ready, rest = rest[0::2], rest[1::2].copy()
            done.append(np.einsum("eij,ej...->ei...", level.inverse, ready))
            rest -= np.einsum("oij,oj...->oi...", level.left, ready[: len(rest)])
            right = np.einsum("oij,oj...->oi...", level.right, ready[1:])
            rest[: len(right)] -= right
        solved = done.pop()
        for level, own in zip(reversed(self.levels[:-1]), reversed(done)):
            own[: len(solved)] -= np.einsum("oij,oi...->oj...", level.left, solved)
            own[1:] -= np.einsum("oij,oi...->oj...", level.right, solved[: len(level.right)])
            both = np.empty((len(own) + len(solved), *own.shape[1:]), own.dtype)
            both[0::2], both[1::2] = own, solved
            solved = both
        return solved


def eliminate(stiffness: Stiffness, row: ArrayLayout) -> Elimination:
    """Return the elimination of a stiffness that fits the cell array.

    The blocks are (q, u) and t of each stage, or whole cells if the stiffness has no chain
    structure.
    """
    component, own, following = blocks_of(stiffness, row)
    levels = []
    while True:
        inverse = np.linalg.inv(own[0::2])
        inverse = 0.5 * (inverse + inverse.transpose(0, 2, 1))
        before, behind = following[0::2], following[1::2]
        left = before.transpose(0, 2, 1) @ inverse[: len(before)]
        right = behind @ inverse[1:]
        levels.append(Level(inverse=inverse, left=left, right=right))
        if len(own) == 1:
            return Elimination(component=component, levels=tuple(levels))
        own = own[1::2] - left @ before
        own[: len(right)] -= right @ behind.transpose(0, 2, 1)
        own = 0.5 * (own + own.transpose(0, 2, 1))
        following = -right[: len(own) - 1] @ before[1:]


def blocks_of(stiffness: Stiffness, row: ArrayLayout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return components (blocks, b), S of every block and S to the next block."""
    own, following = stiffness.blocks(row)
    is_target = np.isin(row.primal, row.chains[:, 1])
    first, second = np.flatnonzero(~is_target), np.flatnonzero(is_target)
    component = np.where(stiffness.alive(row), row.component[row.primal].T, -1)
    crosses = following.copy()
    crosses[:, second[:, None], first] = 0.0
    if not len(second) or crosses.any():
        return component, own, following
    size, stages = max(len(first), len(second)), len(own)
    places = -np.ones((stages, 2, size), np.int64)
    blocks = np.broadcast_to(np.eye(size), (stages, 2, size, size)).copy()
    between = np.zeros((stages, 2, size, size))
    for half, chosen in enumerate((first, second)):
        places[:, half, : len(chosen)] = component[:, chosen]
        blocks[:, half, : len(chosen), : len(chosen)] = own[:, chosen[:, None], chosen]
    between[:, 0, : len(first), : len(second)] = own[:, first[:, None], second]
    between[:-1, 1, : len(second), : len(first)] = following[:, second[:, None], first]
    flat = 2 * stages, size, size
    return places.reshape(-1, size), blocks.reshape(flat), between.reshape(flat)[:-1]
