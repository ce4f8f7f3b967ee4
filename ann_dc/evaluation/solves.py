"""Derivatives with held neurons: loops of a banded or a dense solve.

A stiffness is solved in bands, with identity rows and columns for held neurons. Its factor is
recomputed from the first stage with a changed set. For any other preconditioner the currents come
from M_CC among the held neurons C, which are few: lambda = -M_CC^{-1} (M d)_C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.formulas import inner
from ann_dc.evaluation.preconditioner_arrays import coordinate
from ann_dc.evaluation.tape import Tape

FREE, HELD, UNKNOWN = 0.0, 1.0, 2.0
"""Marks of neurons; an unknown mark has no factor yet."""
MOST_KEPT = 128
"""Largest number of held neurons for which the factor of a preconditioner other than a stiffness is
cached.
"""


class Couplings(NamedTuple):
    """Fields of a tape that a clamp reads."""

    rates: np.ndarray
    """Rates 1 / tau (P, N)."""
    limits: np.ndarray
    """Saturation limits (P, 2)."""
    reached: np.ndarray
    """Neurons (R,) that the preconditioner couples."""
    chains: np.ndarray
    """Chains of a pyramid (C, 2)."""
    grids: np.ndarray
    """Gains of a pyramid (grid points, C, C)."""
    grid_starts: np.ndarray
    """First grid point of each level (levels + 1,)."""
    hats: np.ndarray
    """Left grid points (2N,)."""
    shares: np.ndarray
    """Interpolation weights of the right grid points (2N,)."""
    coupled: np.ndarray
    """Neurons and stages of a stiffness (S + 1, 3)."""
    stiff: np.ndarray
    """M^{-1} of a stiffness in bands (S, w)."""


class Hold(NamedTuple):
    """Arrays of a clamp; P neurons, N stages."""

    values: np.ndarray
    """States from the second column on (P or more, N + 2)."""
    drives: np.ndarray
    """Net inputs (P, N), not cut at saturation limits."""
    derivatives: np.ndarray
    """Derivatives (P, N), computed for neurons that the preconditioner couples."""
    nodes: np.ndarray
    """Nodes of a pyramid (grid points, chains)."""
    held: np.ndarray
    """Marks of the last call (P, N)."""
    factor: np.ndarray
    """Lower triangle that belongs to the marks, (S, w) or (k, k)."""

    @classmethod
    def of(cls, tape: Tape) -> Hold:
        """Return new arrays for a tape."""
        shape, points = tape.rates.shape, max(int(tape.grid_starts[-1]), 1)
        return cls(
            values=np.zeros((shape[0], shape[1] + 2)),
            drives=np.zeros(shape),
            derivatives=np.zeros(shape),
            nodes=np.zeros((points, max(len(tape.chains), 1))),
            held=np.full(shape, UNKNOWN),
            factor=factor_of(tape),
        )


def factor_of(tape: Tape) -> np.ndarray:
    """Return an empty array for the factor of the held neurons of a tape."""
    if len(tape.stiff):
        return np.zeros(tape.stiff.shape)
    with_limits = np.isfinite(tape.limits[tape.reached]).any(axis=1).sum()
    most = min(int(with_limits) * tape.rates.shape[1], MOST_KEPT)
    return np.zeros((most, most))


class _Spread(NamedTuple):
    """Arrays that a pyramid reads and fills."""

    drives: np.ndarray
    derivatives: np.ndarray
    nodes: np.ndarray


# ---- a stiffness ---------------------------------------------------------------------------------


@inner
def _factor_band(couplings, hold, first):
    """Compute L of M^{-1} in bands from a stage on, with the identity at held neurons.

    The diagonal is stored as its reciprocal.
    """
    stiff, L, coupled = couplings.stiff, hold.factor, couplings.coupled
    count, width = stiff.shape
    for i in range(count):
        if coupled[i, 1] < first:
            continue
        is_held = hold.held[coupled[i, 0], coupled[i, 1]] == HELD
        for j in range(max(i - width + 1, 0), i + 1):
            total, at = stiff[i, j - i + width - 1], j - i + width - 1
            if is_held or hold.held[coupled[j, 0], coupled[j, 1]] == HELD:
                total = 1.0 if i == j else 0.0
            for k in range(max(i - width + 1, 0), j):
                if j - k < width:
                    total -= L[i, k - i + width - 1] * L[j, k - j + width - 1]
            L[i, at] = total * L[j, width - 1] if j < i else 1.0 / np.sqrt(total)


@inner
def _row_of_band(stiff, i, y):
    """Multiply a row of M^{-1} by a vector."""
    count, width = stiff.shape
    total = 0.0
    for j in range(max(i - width + 1, 0), i + 1):
        total += stiff[i, j - i + width - 1] * y[j]
    for j in range(i + 1, min(i + width, count)):
        total += stiff[j, i - j + width - 1] * y[j]
    return total


@inner
def _solve_band(couplings, hold, currents):
    """Solve for the derivatives of coupled neurons and the currents of held ones."""
    stiff, L, coupled = couplings.stiff, hold.factor, couplings.coupled
    count, width = stiff.shape
    y = np.zeros(count)
    for i in range(count):
        p, k = coupled[i, 0], coupled[i, 1]
        total = 0.0 if hold.held[p, k] == HELD else hold.drives[p, k]
        for j in range(max(i - width + 1, 0), i):
            total -= L[i, j - i + width - 1] * y[j]
        y[i] = total * L[i, width - 1]
    for i in range(count - 1, -1, -1):
        y[i] *= L[i, width - 1]
        for j in range(max(i - width + 1, 0), i):
            y[j] -= L[i, j - i + width - 1] * y[i]
    for i in range(count):
        p, k = coupled[i, 0], coupled[i, 1]
        is_held = hold.held[p, k] == HELD
        hold.derivatives[p, k] = 0.0 if is_held else y[i]
        if is_held:
            currents[p, k] = _row_of_band(stiff, i, y) - hold.drives[p, k]


# ---- any other preconditioner --------------------------------------------------------------------


@inner
def _spread(couplings, drives, derivatives, nodes):
    """Compute M d for all neurons."""
    for p in range(drives.shape[0]):
        for k in range(drives.shape[1]):
            derivatives[p, k] = drives[p, k] * couplings.rates[p, k]
    coordinate(couplings, _Spread(drives, derivatives, nodes))


@inner
def _factor_dense(couplings, hold, places, L):
    """Compute L of M_CC for held neurons at the given places."""
    unit, count = np.zeros(hold.drives.shape), places.shape[0]
    for j in range(count):
        unit[places[j, 0], places[j, 1]] = 1.0
        _spread(couplings, unit, hold.derivatives, hold.nodes)
        unit[places[j, 0], places[j, 1]] = 0.0
        for i in range(j, count):
            L[i, j] = hold.derivatives[places[i, 0], places[i, 1]]
    for j in range(count):
        for i in range(j, count):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * L[j, j] if j < i else 1.0 / np.sqrt(total)


@inner
def _solve_dense(couplings, hold, currents, places, is_new):
    """Solve for all derivatives and the currents of held neurons at the given places."""
    count = places.shape[0]
    is_kept = count <= hold.factor.shape[0]
    L = hold.factor if is_kept else np.zeros((count, count))
    if is_new or not is_kept:
        _factor_dense(couplings, hold, places, L)
    _spread(couplings, hold.drives, hold.derivatives, hold.nodes)
    y, pushed = np.zeros(count), hold.drives.copy()
    for i in range(count):
        total = -hold.derivatives[places[i, 0], places[i, 1]]
        for j in range(i):
            total -= L[i, j] * y[j]
        y[i] = total * L[i, i]
    for i in range(count - 1, -1, -1):
        y[i] *= L[i, i]
        for j in range(i):
            y[j] -= L[i, j] * y[i]
        currents[places[i, 0], places[i, 1]] = y[i]
        pushed[places[i, 0], places[i, 1]] += y[i]
    _spread(couplings, pushed, hold.derivatives, hold.nodes)
    for i in range(count):
        hold.derivatives[places[i, 0], places[i, 1]] = 0.0


# ---- both ----------------------------------------------------------------------------------------


@inner
def _held_among(hold, places):
    """Return the places of the held neurons among some places."""
    chosen, count = np.empty(places.shape, np.int64), 0
    for i in range(places.shape[0]):
        if hold.held[places[i, 0], places[i, 1]] == HELD:
            chosen[count, 0], chosen[count, 1] = places[i, 0], places[i, 1]
            count += 1
    return chosen[:count]


@inner
def solve(couplings, hold, currents, places, first):
    """Solve for derivatives and currents with the given marks.

    ``first`` is the first stage with a changed mark.
    """
    is_new = first < hold.drives.shape[1]
    if couplings.stiff.shape[0] > 0:
        if is_new:
            _factor_band(couplings, hold, first)
        _solve_band(couplings, hold, currents)
    else:
        _solve_dense(couplings, hold, currents, _held_among(hold, places), is_new)
