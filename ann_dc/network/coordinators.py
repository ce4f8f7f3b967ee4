r"""Coarse coordinators: the pyramid above the row, which makes settling independent of N.

Neighbour-only wiring passes news one stage at a time, so settling grows as N^2. The coordinators
are neurons on grids of 2, 4, ..., 2^J intervals over the chain t_0, q_1, t_1, ..., q_{N-1}, whose
fixed ends are the ends of every grid. Each adds up the drives below its hat, integrates them, and
adds the result back through the same hat:

.. math::
    y_a' = S_a \sum_p \phi_a(p)\, d_p, \qquad
    z_p' = \tau_p^{-1} d_p + \sum_a \phi_a(p)\, y_a',

with d the drives of the chain's neurons. Because down and up are transposes and S is positive
semi-definite, the metric diag(1/tau) + (hats) S (hats)' is positive definite and no equilibrium
changes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ann_dc.errors import NetworkError


@dataclass(frozen=True, kw_only=True, eq=False)
class Coordinators:
    """Gains of the pyramid.

    Attributes
    ----------
    gains : tuple of (2**j + 1, C, C) arrays
        S of every grid point, finest level first; zero where a grid point has no neuron (the
        fixed ends). C is the number of chains, one a state component.

    Raises
    ------
    NetworkError
        If a level has not half the intervals of the one before, or a gain has another number of
        chains or is not finite.

    References
    ----------
    .. [1] J. H. Bramble, J. E. Pasciak, J. Xu, Parallel multilevel preconditioners, Mathematics of
       Computation 55, 1990, 1-22.

    Examples
    --------
    One chain under a single hat, on a grid of two intervals:

    >>> gain = np.zeros((3, 1, 1))
    >>> gain[1] = 4.0
    >>> Coordinators(gains=(gain, np.zeros((2, 1, 1)))).metric(3).round(2).tolist()
    [[0.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 0.0]]
    """

    gains: tuple[np.ndarray, ...]

    def __post_init__(self) -> None:
        intervals = [len(gain) - 1 for gain in self.gains]
        if not intervals:
            raise NetworkError("coordinators: no levels given; use None for a network without any")
        halved = all(fine == 2 * coarse for fine, coarse in itertools.pairwise(intervals))
        if not halved or intervals[-1] < 1:
            raise NetworkError(
                f"coordinators: each level needs half the intervals of the one "
                f"before, got {intervals}"
            )
        for gain in self.gains:
            if gain.shape[1:] != (self.chains, self.chains):
                raise NetworkError(
                    f"coordinators: gains of shape {gain.shape} do not fit {self.chains} chains"
                )
            if not np.isfinite(gain).all():
                raise NetworkError("coordinators: a gain is not finite")
            gain.setflags(write=False)

    @property
    def chains(self) -> int:
        """C, the number of state components."""
        return self.gains[0].shape[-1]

    def hats(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """For ``count`` positions: the finest grid point to the left, the share to the right."""
        return hat_positions(count, len(self.gains[0]) - 1)

    def apply(self, drive: np.ndarray) -> np.ndarray:
        """What the pyramid adds to z': ``drive`` and the result have shape (..., C, 2N)."""
        index, share = self.hats(drive.shape[-1])
        grid = np.zeros((*drive.shape[:-1], len(self.gains[0])), drive.dtype)
        np.add.at(grid, (..., index), (1 - share) * drive)  # pyright: ignore[reportArgumentType]
        np.add.at(grid, (..., index + 1), share * drive)  # pyright: ignore[reportArgumentType]
        rates = []
        for gain in self.gains:
            rates.append(np.einsum("aij,...ja->...ia", gain, grid))
            grid = _coarsen(grid)
        move = rates.pop()
        while rates:
            move = rates.pop() + _refine(move)
        return (1 - share) * move[..., index] + share * move[..., index + 1]

    def metric(self, count: int) -> np.ndarray:
        """The pyramid over ``count`` positions as a dense (C count, C count) matrix."""
        unit = np.eye(self.chains * count).reshape(-1, self.chains, count)
        return self.apply(unit).reshape(len(unit), -1).T

    def size(self) -> int:
        """Number of coarse neurons."""
        return sum(int((np.abs(gain).sum(axis=-1) > 0).sum()) for gain in self.gains)

    def wires(self, live: np.ndarray) -> int:
        """Number of connections from the row to the coarse neurons (as many lead back).

        ``live`` (C, 2N) says which positions of the chains hold a neuron.
        """
        total = 0
        for gain in self.gains:
            index, share = hat_positions(live.shape[1], len(gain) - 1)
            active = np.abs(gain).sum(axis=-1) > 0
            total += (live.T & active[index] & (share < 1)[:, None]).sum()
            total += (live.T & active[index + 1] & (share > 0)[:, None]).sum()
        return int(total)


def hat_positions(count: int, intervals: int) -> tuple[np.ndarray, np.ndarray]:
    """Place ``count`` chain positions on a grid of ``intervals``.

    Parameters
    ----------
    count : int
        Positions, two or more.
    intervals : int
        Of the grid.

    Returns
    -------
    index : (count,) array of int
        Grid point to the left.
    share : (count,) array
        Of the way to the grid point on the right.

    Examples
    --------
    >>> index, share = hat_positions(5, 2)
    >>> index.tolist(), share.tolist()
    ([0, 0, 1, 1, 1], [0.0, 0.5, 0.0, 0.5, 1.0])
    """
    coordinate = np.arange(count) * intervals / (count - 1)
    index = np.minimum(coordinate.astype(np.int64), intervals - 1)
    return index, coordinate - index


def _coarsen(grid: np.ndarray) -> np.ndarray:
    coarse = grid[..., 0::2].copy()
    coarse[..., :-1] += 0.5 * grid[..., 1::2]
    coarse[..., 1:] += 0.5 * grid[..., 1::2]
    return coarse


def _refine(coarse: np.ndarray) -> np.ndarray:
    fine = np.empty((*coarse.shape[:-1], 2 * coarse.shape[-1] - 1), coarse.dtype)
    fine[..., 0::2] = coarse
    fine[..., 1::2] = 0.5 * (coarse[..., :-1] + coarse[..., 1:])
    return fine
