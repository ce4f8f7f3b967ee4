"""Tape arrays of the preconditioner, and the loops that compute state derivatives.

A pyramid is stored as grids and hat functions, a stiffness as its triangular factor. The arrays of
the other preconditioner kinds are empty.
"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.formulas import index, inner
from ann_dc.network.preconditioners.base import ArrayLayout, Preconditioner
from ann_dc.network.preconditioners.multilevel import Multilevel, hat_positions
from ann_dc.network.preconditioners.stiffness import Stiffness


def preconditioner_arrays(
    preconditioner: Preconditioner, row: ArrayLayout
) -> dict[str, np.ndarray]:
    """Return the fields of `Tape` from ``chains`` on for a preconditioner.

    The row needs the rates of the tape. Raises `NetworkError` if the preconditioner does not fit
    the row.
    """
    reached = {"reached": np.flatnonzero(preconditioner.reach(row))}
    if isinstance(preconditioner, Stiffness):
        return _EMPTY | reached | _stiffness(preconditioner, row)
    preconditioner.check(row)
    return (
        _EMPTY
        | reached
        | (_pyramid(preconditioner, row) if isinstance(preconditioner, Multilevel) else {})
    )


_EMPTY = {
    "stiff": np.zeros((0, 0)),
    "chains": np.zeros((0, 2), np.int64),
    "grids": np.zeros((0, 0, 0)),
    "grid_starts": np.zeros(1, np.int64),
    "hats": np.zeros(0, np.int64),
    "shares": np.zeros(0),
    "coupled": np.zeros((1, 3), np.int64),
    "factor": np.zeros(0),
    "factor_columns": np.zeros(0, np.int64),
}


def _pyramid(pyramid: Multilevel, row: ArrayLayout) -> dict[str, np.ndarray]:
    sizes = [len(gain) for gain in pyramid.gains]
    hats, shares = hat_positions(2 * row.stages, sizes[0] - 1)
    return {
        "chains": row.chains,
        "grids": np.concatenate(pyramid.gains),
        "grid_starts": np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        "hats": hats,
        "shares": shares,
    }


def _stiffness(stiffness: Stiffness, row: ArrayLayout) -> dict[str, np.ndarray]:
    """Return the arrays of a stiffness: K of K K' = T^{-1/2} S T^{-1/2} in row order.

    In this order, the factor reaches no further than the neighbours.
    """
    band, component = stiffness.cholesky(row), row.component[row.primal].T.ravel()
    below, column = np.nonzero(band)
    used = component[column] >= 0
    column, below = column[used], below[used]
    by_row = np.lexsort((column, column + below))
    column, below = column[by_row], below[by_row]
    live = np.flatnonzero(component >= 0)
    order, starts = component[live], np.searchsorted(column + below, live)
    factor = band[below, column] / np.sqrt(row.state_rates[component[column + below]])
    ends = np.append(starts[1:], len(column)) - 1
    factor[ends] = 1 / factor[ends]
    neuron, stage = _places(row)[order].T
    coupled = np.column_stack([neuron, stage, starts])
    return {
        "coupled": np.vstack([coupled, [-1, -1, len(column)]]).astype(np.int64),
        "factor": factor,
        "factor_columns": np.searchsorted(live, column).astype(np.int64),
        "stiff": _band(stiffness, row, live),
    }


def _band(stiffness: Stiffness, row: ArrayLayout, live: np.ndarray) -> np.ndarray:
    """Return T^{-1/2} S T^{-1/2} over the live neurons in bands, diagonal last."""
    band = stiffness.banded(row)
    below, column = np.nonzero(band)
    used = np.isin(column, live)
    below, column = below[used], column[used]
    i, j = (np.searchsorted(live, place) for place in (column + below, column))
    root = np.sqrt(row.state_rates[row.component[row.primal].T.ravel()[live]])
    width = int((i - j).max(initial=0)) + 1
    rows = np.zeros((len(live), width))
    rows[i, j - i + width - 1] = band[below, column] / (root[i] * root[j])
    return rows


def _places(row: ArrayLayout) -> np.ndarray:
    """Return neuron and stage (n, 2) of the components of the state vector."""
    stage, neuron = np.nonzero(row.rates.T)
    return np.column_stack([neuron, stage])


# ---- as compiled loops apply them ----------------------------------------------------------------

_0 = index(0)


@inner
def clear(table):
    """Set all entries of a table to zero."""
    for row in range(table.shape[0]):
        for column in range(table.shape[1]):
            table[row, column] = 0.0


@inner
def _restrict(tape, drives, grid):
    """Restrict the net inputs to the grids, the finest level from the chains.

    Each coarser level is restricted from the next finer level.
    """
    clear(grid)
    for p in range(tape.hats.shape[0]):
        left, share = tape.hats[p], tape.shares[p]
        for j in range(tape.chains.shape[0]):
            drive = drives[tape.chains[j, p & 1], p >> 1]
            grid[left, j] += (1.0 - share) * drive
            grid[left + 1, j] += share * drive
    for level in range(1, tape.grid_starts.shape[0] - 1):
        fine, first = tape.grid_starts[level - 1], tape.grid_starts[level]
        last = tape.grid_starts[level + 1] - first - 1
        for a in range(last + 1):
            for j in range(tape.chains.shape[0]):
                total = grid[fine + 2 * a, j]
                if a > 0:
                    total += 0.5 * grid[fine + 2 * a - 1, j]
                if a < last:
                    total += 0.5 * grid[fine + 2 * a + 1, j]
                grid[first + a, j] = total


@inner
def _respond(tape, grid):
    """Replace ``grid`` by the rates of its neurons plus those of all coarser levels."""
    chains, levels = tape.chains.shape[0], tape.grid_starts.shape[0] - 1
    rates = np.empty(chains)
    for level in range(levels - 1, -1, -1):
        first, last = tape.grid_starts[level], tape.grid_starts[level + 1]
        for a in range(last - first):
            gain, drive = tape.grids[first + a], grid[first + a]
            for i in range(chains):
                rate = 0.0
                for j in range(chains):
                    rate += gain[i, j] * drive[j]
                rates[i] = rate
            if level < levels - 1:
                above = last + (a >> 1)
                for i in range(chains):
                    rates[i] += 0.5 * (grid[above, i] + grid[above + (a & 1), i])
            for i in range(chains):
                grid[first + a, i] = rates[i]


@inner
def coordinate(tape, work):
    """Add the contribution of the pyramid to the derivatives."""
    drives, derivatives, grid = work.drives, work.derivatives, work.nodes
    _restrict(tape, drives, grid)
    _respond(tape, grid)
    for p in range(tape.hats.shape[0]):
        left, share, stage = tape.hats[p], tape.shares[p], p >> 1
        for i in range(tape.chains.shape[0]):
            row = tape.chains[i, p & 1]
            if tape.rates[row, stage] != 0.0:
                derivatives[row, stage] += (1.0 - share) * grid[left, i] + share * grid[left + 1, i]


@inner
def _relax(coupled, factor, columns, drives, derivatives, y):
    """Solve K K' m = d, K lower triangular, for the neurons that a stiffness couples."""
    for i in range(y.shape[0]):
        total = drives[coupled[i, 0], coupled[i, 1]]
        diagonal = coupled[i + 1, 2] - 1
        for e in range(index(coupled[i, 2]), index(diagonal)):
            total -= factor[e] * y[index(columns[e]), _0]
        y[i, 0] = total * factor[diagonal]
    for i in range(y.shape[0] - 1, -1, -1):
        diagonal = coupled[i + 1, 2] - 1
        z = y[i, 0] * factor[diagonal]
        for e in range(index(coupled[i, 2]), index(diagonal)):
            y[index(columns[e]), _0] -= factor[e] * z
        derivatives[coupled[i, 0], coupled[i, 1]] = z


@inner
def derivative(tape, work):
    """Compute the derivatives (neurons, N), M times the net inputs, after `evaluate`."""
    drives, derivatives = work.drives, work.derivatives
    for p in range(drives.shape[0]):
        for k in range(drives.shape[1]):
            derivatives[p, k] = drives[p, k] * tape.rates[p, k]
    if tape.chains.shape[0] > 0:
        coordinate(tape, work)
    if tape.coupled.shape[0] > 1:
        _relax(tape.coupled, tape.factor, tape.factor_columns, drives, derivatives, work.nodes)
