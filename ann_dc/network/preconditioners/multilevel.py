r"""Additive multilevel preconditioner (BPX): neurons on coarse grids.

Wiring between neighbours transmits information by one stage at a time, so the settling time grows
as N^2. With the coarse-level neurons settling is independent of N. They are on grids of 2, 4, ...,
2^J intervals over the chain t_0, q_1, t_1, ..., q_{N-1}, whose fixed ends are the ends of every
grid. Each coarse-level neuron sums the net inputs below its hat, integrates the sum, and adds the
result back through the same hat:

.. math::
    y_a' = S_a \sum_p \phi_a(p)\, d_p, \qquad
    z_p' = \tau_p^{-1} d_p + \sum_a \phi_a(p)\, y_a',

with d the net inputs of the chain's neurons. Restriction and prolongation are transposes and S is
positive semi-definite. The preconditioner diag(1/tau) + (hats) S (hats)' is therefore positive
definite and preserves all equilibria.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import scipy.sparse.linalg
from scipy import sparse

from ann_dc.errors import NetworkError
from ann_dc.network.preconditioners.base import (
    ArrayLayout,
    Factors,
    Preconditioner,
    PreconditionerKind,
    Wires,
)

ROUNDING = 1e-6
"""Largest negative eigenvalue or asymmetry of a gain relative to its largest entry: single
precision.
"""


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Multilevel(Preconditioner):
    """Multilevel preconditioner M = diag(1 / tau) + hats S hats', with the gains S.

    Raises `NetworkError` if a level does not have half the intervals of the previous one. The error
    is also raised if a gain has another number of chains, is not finite, or is not symmetric
    positive semi-definite.

    Attributes
    ----------
    gains : tuple of (2**j + 1, C, C) arrays
        S of every grid point, finest level first; zero for grid points without a neuron (the fixed
        ends). C is the number of chains, one per state component.

    References
    ----------
    .. [1] J. H. Bramble, J. E. Pasciak, J. Xu, Parallel multilevel preconditioners, Mathematics of
       Computation 55, 1990, 1-22.

    Examples
    --------
    One chain under a single hat, on a grid of two intervals:

    >>> gain = np.zeros((3, 1, 1))
    >>> gain[1] = 4.0
    >>> Multilevel(gains=(gain, np.zeros((2, 1, 1)))).spread(np.array([[1.0, 2.0, 1.0]])).tolist()
    [[0.0, 8.0, 0.0]]
    """

    gains: tuple[np.ndarray, ...]

    def __post_init__(self) -> None:
        intervals = [len(gain) - 1 for gain in self.gains]
        if not intervals:
            raise NetworkError(
                "gains: expected one level or more, got none; use Diagonal() for none"
            )
        halved = all(fine == 2 * coarse for fine, coarse in itertools.pairwise(intervals))
        if not halved or intervals[-1] < 1:
            raise NetworkError(
                f"gains: each level needs half the intervals of the finer level, got {intervals}"
            )
        for level, gain in enumerate(self.gains):
            if gain.shape[1:] != (self.chains, self.chains):
                raise NetworkError(f"gains: shape {gain.shape} does not fit {self.chains} chains")
            if not np.isfinite(gain).all():
                raise NetworkError("gains: a gain is not finite")
            _check_definite(level, gain)
            gain.setflags(write=False)

    @property
    def chains(self) -> int:
        """Number of chains C, equal to the number of state components."""
        return self.gains[0].shape[-1]

    @property
    def kind(self) -> PreconditionerKind:
        """Kind: `PreconditionerKind.COUPLED_MULTILEVEL` if a gain is not diagonal."""
        beside = ~np.eye(self.chains, dtype=bool)
        coupled = any(gain[:, beside].any() for gain in self.gains)
        return PreconditionerKind.COUPLED_MULTILEVEL if coupled else PreconditionerKind.MULTILEVEL

    @property
    def size(self) -> int:
        """Number of coarse-level neurons."""
        return sum(int((np.abs(gain).sum(axis=-1) > 0).sum()) for gain in self.gains)

    def check(self, row: ArrayLayout) -> None:
        """Raise a `NetworkError` if the cell array has another number of chains."""
        if self.chains != len(row.chains):
            raise NetworkError(
                f"{self.kind.value}: made for {self.chains} chains, but the cell has "
                f"{len(row.chains)}"
            )

    def reach(self, row: ArrayLayout) -> np.ndarray:
        """Return True for the neurons (P,) of the chains, q and t."""
        reach = np.zeros(len(row.rates), bool)
        reach[row.chains.ravel()] = True
        return reach

    def apply(self, row: ArrayLayout, drives: np.ndarray) -> np.ndarray:
        """Return M d (..., P, N) by restriction and prolongation over all levels."""
        derivatives = drives * row.rates
        q, t = row.chains.T
        chain = np.stack([drives[..., q, :], drives[..., t, :]], axis=-1)
        added = self.spread(chain.reshape(*chain.shape[:-2], -1))
        derivatives[..., q, :] += added[..., 0::2]
        derivatives[..., t, :] += added[..., 1::2]
        return np.where(row.rates > 0, derivatives, 0)

    def spread(self, drive: np.ndarray) -> np.ndarray:
        """Return the coarse-level contribution to z', for net inputs (..., C, 2N).

        The result has the same shape.
        """
        index, share = hat_positions(drive.shape[-1], len(self.gains[0]) - 1)
        grid = np.zeros((*drive.shape[:-1], len(self.gains[0])), drive.dtype)
        np.add.at(grid, (..., index), (1 - share) * drive)  # pyright: ignore[reportArgumentType]
        np.add.at(grid, (..., index + 1), share * drive)  # pyright: ignore[reportArgumentType]
        rates = []
        for gain in self.gains:
            rates.append(np.einsum("aij,...ja->...ia", gain, grid))
            grid = _coarsen(grid)
        derivative = rates.pop()
        while rates:
            derivative = rates.pop() + _refine(derivative)
        return (1 - share) * derivative[..., index] + share * derivative[..., index + 1]

    def factors(self, row: ArrayLayout) -> Factors:
        """Return time constants, and one node per eigenvector of a grid point's gain."""
        n = len(row.state_rates)
        spread, stiffness = [sparse.eye_array(n, format="csr")], [1 / row.state_rates]
        for gain in self.gains:
            hats = self._hats(row, len(gain) - 1)
            strength, modes = np.linalg.eigh(gain)
            used = strength > 1e-14 * strength.max(initial=0.0)
            point, mode = np.nonzero(used)
            count, chain = len(point), np.arange(self.chains)
            rows = (point[:, None] * self.chains + chain).ravel()
            columns = np.repeat(np.arange(count), self.chains)
            directions = sparse.csr_array(
                (modes[point, :, mode].ravel(), (rows, columns)), shape=(hats.shape[1], count)
            )
            spread.append(hats @ directions)
            stiffness.append(1 / strength[used])
        return Factors(
            spread=sparse.hstack(spread, format="csr"),
            stiffness=sparse.diags_array(np.concatenate(stiffness), format="csr"),
        )

    def inverse(self, row: ArrayLayout) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function v (n,) -> M^{-1} v, level by level as in `apply`.

        A direct factorisation would fill in with the hats of long levels. With net inputs g
        restricted to every level and the returned displacements e, the equations are T d + R_0' e_0
        = v. Further, g_0 = R_0 d, g_l = R_l g_{l-1}, e_l = S_l g_l + R_{l+1}' e_{l+1}.
        """
        n, levels, chains = len(row.state_rates), len(self.gains), self.chains
        down = [self._hats(row, len(self.gains[0]) - 1).T]
        down += [sparse.kron(_coarsening(len(gain)), np.eye(chains)) for gain in self.gains[1:]]
        rows: list[list[Any]] = [[None] * (1 + 2 * levels) for _ in range(1 + 2 * levels)]
        rows[0][0], rows[0][1 + levels] = sparse.diags_array(row.state_rates), down[0].T
        for level, gain in enumerate(self.gains):
            g, e, size = 1 + level, 1 + levels + level, len(gain) * chains
            point, i, j = np.nonzero(gain)
            at = point * chains + i, point * chains + j
            rows[g][g - 1], rows[g][g] = down[level], -sparse.eye_array(size)
            rows[e][g] = sparse.csr_array((gain[point, i, j], at), shape=(size, size))
            rows[e][e] = -sparse.eye_array(size)
            if level < levels - 1:
                rows[e][e + 1] = down[level + 1].T
        solver = scipy.sparse.linalg.splu(sparse.block_array(rows, format="csc"))
        between = np.zeros(solver.shape[0] - n)
        return lambda v: solver.solve(np.concatenate([v, between]))[:n]

    def wires(self, row: ArrayLayout) -> Wires:
        """Return the hats of the existing coarse-level neurons."""
        weights = []
        for gain in self.gains:
            active = (np.abs(gain).sum(axis=-1) > 0).ravel()
            weights.append(self._hats(row, len(gain) - 1)[:, np.flatnonzero(active)])
        return Wires(weights=sparse.hstack(weights, format="csr"), nodes=self.size, both_ways=True)

    def _hats(self, row: ArrayLayout, intervals: int) -> Any:
        """Return the weights (n, points C) of a level's coarse neurons in all derivatives."""
        index, share = hat_positions(2 * row.stages, intervals)
        components, chain = row.chain_components, np.arange(self.chains)[:, None]
        entries = []
        for point, weight in ((index, 1 - share), (index + 1, share)):
            place = point * self.chains + chain
            used = (components >= 0) & (weight > 0)
            shares = np.broadcast_to(weight, used.shape)[used]
            entries.append((shares, components[used], place[used]))
        values, rows, columns = map(np.concatenate, zip(*entries))
        shape = (len(row.state_rates), (intervals + 1) * self.chains)
        return sparse.csr_array((values, (rows, columns)), shape=shape)


def _check_definite(level: int, gain: np.ndarray) -> None:
    """Raise an error for a level (points, C, C) with an asymmetric or indefinite gain."""
    diagonal = np.einsum("aii->ai", gain)
    least = diagonal.min(axis=1)
    if np.count_nonzero(gain) != np.count_nonzero(diagonal):
        least = np.linalg.eigvalsh(gain)[:, 0]  # several times dearer: designs make many gains
    elif least.min() >= 0:
        return
    allowed = ROUNDING * np.abs(gain).max(axis=(1, 2))
    askew = np.abs(gain - gain.transpose(0, 2, 1)).max(axis=(1, 2)) > allowed
    wrong = askew | (least < -allowed)
    if wrong.any():
        point = int(np.argmax(wrong))
        found = "an unsymmetric one" if askew[point] else f"the eigenvalue {least[point]:.3g}"
        raise NetworkError(
            f"gains: level {level}, grid point {point} of 0 to {len(gain) - 1}: expected a "
            f"symmetric matrix without negative eigenvalues, got {found}; give (S + S') / 2, "
            "with negative eigenvalues replaced by zero"
        )


def hat_positions(count: int, intervals: int) -> tuple[np.ndarray, np.ndarray]:
    """Return grid point and fraction of ``count`` chain positions (two or more).

    The grid has the given number of intervals. ``index`` (count,) is the grid point to the left;
    ``share`` (count,) is the fraction of the distance to the grid point on the right.
    """
    coordinate = np.arange(count) * intervals / (count - 1)
    index = np.minimum(coordinate.astype(np.int64), intervals - 1)
    return index, coordinate - index


def _coarsening(points: int) -> sparse.csr_array:
    """Return `_coarsen` to a number of points as a matrix (points, 2 points - 1)."""
    fine = 2 * points - 1
    half = sparse.diags_array(np.full(fine - 1, 0.5), offsets=1, shape=(fine, fine))
    return sparse.csr_array(sparse.eye_array(fine) + half + half.T)[0::2]


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
