r"""Preconditioner given by the inverse of a stiffness between neighbours.

Over the primal neurons z = (q, u, t) of all cells,

.. math:: M = T^{1/2}\, S^{-1}\, T^{1/2}, \qquad T = \mathrm{diag}(1/\tau),

with S dimensionless, symmetric positive definite and block tridiagonal: a neuron is coupled to the
primal neurons of its cell and of the two adjacent cells. With a unit diagonal of S the time
constants are those of T = diag(M^{-1})^{-1}. M is positive definite for all time constants, so
errors of time constants do not move an equilibrium.

The preconditioner has two realisations: a resistive grid between neighbours (`grid`), or
elimination, as a feed-forward tree (`tree`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
from scipy import sparse

from ann_dc.errors import NetworkError
from ann_dc.network.preconditioners.base import ArrayLayout, Clamp, Factors, Preconditioner


@dataclass(frozen=True, kw_only=True, eq=False)
class Stiffness(Preconditioner):
    """Stiffness S between the m primal neurons of every cell and of the next.

    ``own`` (N, m, m) is S within a cell, symmetric; ``following`` (N - 1, m, m) is S between a cell
    (rows) and the next one (columns). Raises `NetworkError` if the shapes disagree, a number is not
    finite, or ``own`` is not symmetric.
    """

    own: np.ndarray
    following: np.ndarray

    def __post_init__(self) -> None:
        own, following = self.own, self.following
        if own.ndim != 3 or own.shape[1] != own.shape[2] or not len(own):
            raise NetworkError(f"own: expected an array (N, m, m), got shape {own.shape}")
        if following.shape != (len(own) - 1, *own.shape[1:]):
            raise NetworkError(
                f"following: expected shape {(len(own) - 1, *own.shape[1:])}, one block per "
                f"pair of neighbours, got {following.shape}"
            )
        if not (np.isfinite(own).all() and np.isfinite(following).all()):
            raise NetworkError("own, following: a stiffness is not finite")
        if not np.array_equal(own, own.transpose(0, 2, 1)):
            raise NetworkError("own: the stiffness within a cell must be symmetric")
        own.setflags(write=False)
        following.setflags(write=False)

    def check(self, row: ArrayLayout) -> None:
        """Raise a `NetworkError` if the size differs or S is not positive definite."""
        self.cholesky(row)

    def cholesky(self, row: ArrayLayout) -> np.ndarray:
        """Return L (2m, N m) of S = L L' in the form of `banded`, without fill outside.

        Raises `NetworkError` if S does not fit the cell array or is not positive definite.
        """
        expected = (row.stages, len(row.primal), len(row.primal))
        if self.own.shape != expected or not len(row.primal):
            raise NetworkError(
                f"{self.kind.value}: made for {self.own.shape[0]} cells of {self.own.shape[1]} "
                f"primal neurons, but the network has {row.stages} of {len(row.primal)}"
            )
        try:
            return scipy.linalg.cholesky_banded(self.banded(row), lower=True)
        except np.linalg.LinAlgError as error:
            raise NetworkError(
                f"{self.kind.value}: the stiffness between neighbours is not positive definite; "
                "raise the penalty above rho*, or lower the couplings"
            ) from error

    def alive(self, row: ArrayLayout) -> np.ndarray:
        """Return (N, m) booleans: True for existing primal neurons."""
        return row.rates[row.primal].T > 0

    def blocks(self, row: ArrayLayout) -> tuple[np.ndarray, np.ndarray]:
        """Return ``own`` and ``following`` with the identity at missing neurons."""
        alive = self.alive(row)
        own = np.where(alive[:, :, None] & alive[:, None, :], self.own, 0.0)
        stage, neuron = np.nonzero(~alive)
        own[stage, neuron, neuron] = 1.0
        pairs = alive[:-1, :, None] & alive[1:, None, :]
        return own, np.where(pairs, self.following, 0.0)

    def banded(self, row: ArrayLayout) -> np.ndarray:
        """Return S (2m, N m) in LAPACK's band form: the diagonal and 2m - 1 rows below it."""
        own, following = self.blocks(row)
        stages, m = own.shape[:2]
        band = np.zeros((2 * m, stages, m))
        i, j = np.tril_indices(m)
        band[i - j, :, j] = own[:, i, j].T
        i, j = np.indices((m, m)).reshape(2, -1)
        band[m + i - j, :-1, j] = following[:, j, i].T
        return band.reshape(2 * m, -1)

    def _dense(self, row: ArrayLayout) -> np.ndarray:
        """Return S (N m, N m)."""
        own, following = self.blocks(row)
        stages, m = own.shape[:2]
        table, stage = np.zeros((stages, m, stages, m)), np.arange(stages)
        table[stage, :, stage] = own
        table[stage[:-1], :, stage[1:]] = following
        table[stage[1:], :, stage[:-1]] = following.transpose(0, 2, 1)
        return table.reshape(stages * m, -1)

    def apply(self, row: ArrayLayout, drives: np.ndarray) -> np.ndarray:
        """Return M d (..., P, N) by one solve for the primal neurons.

        The solve is banded if there are fewer net input vectors than primal neurons.
        """
        derivatives = drives * row.rates
        root = np.sqrt(row.rates[row.primal])
        pushed = np.swapaxes(drives[..., row.primal, :] * root, -1, -2)  # (..., N, m)
        columns = pushed.reshape(-1, root.size).T
        # not checked: a drive that is no number makes moves that are none, as in every evaluator
        if columns.shape[1] < len(columns):
            solved = scipy.linalg.solveh_banded(
                self.banded(row), columns, lower=True, check_finite=False
            )
        else:
            solved = np.linalg.solve(self._dense(row), columns)
        spread = np.swapaxes(solved.T.reshape(pushed.shape), -1, -2) * root
        derivatives[..., row.primal, :] = spread
        return derivatives

    def clamp(self, row: ArrayLayout, held: np.ndarray) -> Clamp:
        """Return the solution with S among unsaturated neurons.

        The solve is banded, for any number of saturated neurons.
        """
        rates = row.rates.copy()
        rates[row.places] = np.where(held, 0.0, row.state_rates)
        band = self.banded(replace(row, rates=rates))  # the identity in the place of held neurons
        factor = scipy.linalg.cholesky_banded(band, lower=True), True
        component = row.component[row.primal].T.ravel()
        there = component >= 0
        root, S = np.sqrt(row.state_rates), self.matrix(row)

        def clamped(drives: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            pushed = np.where(held, 0.0, drives * root).reshape(-1, len(held)).T
            columns = np.zeros((len(component), pushed.shape[1]), pushed.dtype)
            columns[there] = pushed[component[there]]
            solved = scipy.linalg.cho_solve_banded(factor, columns, check_finite=False)
            pushed[component[there]] = solved[there]
            currents = ((S @ pushed).T / root).reshape(drives.shape) - drives
            return pushed.T.reshape(drives.shape) * root, np.where(held, currents, 0.0)

        return clamped

    def matrix(self, row: ArrayLayout) -> sparse.csr_array:
        """Return S (n, n) over state vector components, with a diagonal of one elsewhere."""
        place = row.component[row.primal].T  # (N, m)
        own, following = self.blocks(row)
        tables = (
            (own, place[:, :, None], place[:, None, :]),
            (following, place[:-1, :, None], place[1:, None, :]),
            (following.transpose(0, 2, 1), place[1:, :, None], place[:-1, None, :]),
        )
        rows, columns, values = ([], [], [])
        for table, i, j in tables:
            i, j = np.broadcast_arrays(i, j)
            used = (i >= 0) & (j >= 0) & (table != 0)
            rows.append(i[used])
            columns.append(j[used])
            values.append(table[used])
        other = np.ones(len(row.state_rates), bool)
        other[place[place >= 0]] = False
        others = np.flatnonzero(other)
        entries = np.concatenate([*values, np.ones(len(others))])
        at = np.concatenate([*rows, others]), np.concatenate([*columns, others])
        return sparse.csr_array(sparse.coo_array((entries, at), shape=(len(row.state_rates),) * 2))

    def factors(self, row: ArrayLayout) -> Factors:
        """Return T^{1/2} and S."""
        root = sparse.diags_array(np.sqrt(row.state_rates), format="csr")
        return Factors(spread=root, stiffness=self.matrix(row))

    def reach(self, row: ArrayLayout) -> np.ndarray:
        """Return True for the primal neurons (P,)."""
        reach = np.zeros(len(row.rates), bool)
        reach[row.primal] = True
        return reach
