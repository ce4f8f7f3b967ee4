"""Projection of moves on what rails allow, as loops over numbers: what `projection` says in NumPy.

A stiffness is solved in bands, with the rows and columns of held neurons as the identity, and its
factor is computed anew from the first stage on whose set has changed. For any other metric the
currents come from M_CC among the held neurons C, which are few: lambda = -M_CC^{-1} (M d)_C. The
set and the factor are kept from call to call; they save time and change no result.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ann_dc.evaluation import rules
from ann_dc.evaluation.formulas import compiled, inlined, inner
from ann_dc.evaluation.metric_arrays import coordinate
from ann_dc.evaluation.rules import BLOCKS, PIVOTS, ROUNDING
from ann_dc.evaluation.tape import Tape

FREE, HELD, UNKNOWN = 0.0, 1.0, 2.0
"""Marks of neurons; unknown ones have no factor yet."""
MOST_KEPT = 128
"""Held neurons up to which the factor of a metric that is no stiffness is kept."""

_pushes_out = inner(rules.pushes_out)
_lets_go = inner(rules.lets_go)


class Couplings(NamedTuple):
    """What a clamp reads of a tape, whose fields these are."""

    rates: np.ndarray
    limits: np.ndarray
    reached: np.ndarray
    chains: np.ndarray
    grids: np.ndarray
    grid_starts: np.ndarray
    hats: np.ndarray
    shares: np.ndarray
    coupled: np.ndarray
    stiff: np.ndarray


class Hold(NamedTuple):
    """The arrays of a clamp; P neurons, N stages."""

    values: np.ndarray
    """(P or more, N + 2): states, from the second column on."""
    drives: np.ndarray
    """(P, N): as they arrive, whatever the rails."""
    moves: np.ndarray
    """(P, N): filled in for neurons that the metric couples."""
    nodes: np.ndarray
    """(grid points, chains): of a pyramid."""
    held: np.ndarray
    """(P, N): marks of the last call."""
    factor: np.ndarray
    """(S, w) or (k, k): lower triangle that belongs to these marks."""

    @classmethod
    def of(cls, tape: Tape) -> Hold:
        """Return fresh arrays for a tape."""
        shape, points = tape.rates.shape, max(int(tape.grid_starts[-1]), 1)
        return cls(
            values=np.zeros((shape[0], shape[1] + 2)),
            drives=np.zeros(shape),
            moves=np.zeros(shape),
            nodes=np.zeros((points, max(len(tape.chains), 1))),
            held=np.full(shape, UNKNOWN),
            factor=factor_of(tape),
        )


def factor_of(tape: Tape) -> np.ndarray:
    """Return an empty array for the factor of the held neurons of a tape."""
    if len(tape.stiff):
        return np.zeros(tape.stiff.shape)
    railed = np.isfinite(tape.limits[tape.reached]).any(axis=1).sum()
    most = min(int(railed) * tape.rates.shape[1], MOST_KEPT)
    return np.zeros((most, most))


class _Spread(NamedTuple):
    """What a pyramid reads and fills."""

    drives: np.ndarray
    moves: np.ndarray
    nodes: np.ndarray


# ---- a stiffness ---------------------------------------------------------------------------------


@inner
def _factor_band(couplings, hold, first):
    """L of M^{-1} in bands from a stage on; one over the diagonal, the identity at held neurons."""
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
    """A row of M^{-1} times a vector."""
    count, width = stiff.shape
    total = 0.0
    for j in range(max(i - width + 1, 0), i + 1):
        total += stiff[i, j - i + width - 1] * y[j]
    for j in range(i + 1, min(i + width, count)):
        total += stiff[j, i - j + width - 1] * y[j]
    return total


@inner
def _solve_band(couplings, hold, currents):
    """Moves of all coupled neurons, and the currents of held ones."""
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
        hold.moves[p, k] = 0.0 if is_held else y[i]
        if is_held:
            currents[p, k] = _row_of_band(stiff, i, y) - hold.drives[p, k]


# ---- any other metric ----------------------------------------------------------------------------


@inner
def _spread(couplings, drives, moves, nodes):
    """M d of all neurons."""
    for p in range(drives.shape[0]):
        for k in range(drives.shape[1]):
            moves[p, k] = drives[p, k] * couplings.rates[p, k]
    coordinate(couplings, _Spread(drives, moves, nodes))


@inner
def _factor_dense(couplings, hold, places, L):
    """L of M_CC, for held neurons at these places."""
    unit, count = np.zeros(hold.drives.shape), places.shape[0]
    for j in range(count):
        unit[places[j, 0], places[j, 1]] = 1.0
        _spread(couplings, unit, hold.moves, hold.nodes)
        unit[places[j, 0], places[j, 1]] = 0.0
        for i in range(j, count):
            L[i, j] = hold.moves[places[i, 0], places[i, 1]]
    for j in range(count):
        for i in range(j, count):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total * L[j, j] if j < i else 1.0 / np.sqrt(total)


@inner
def _solve_dense(couplings, hold, currents, places, is_new):
    """Moves of all neurons, and the currents of held ones at these places."""
    count = places.shape[0]
    is_kept = count <= hold.factor.shape[0]
    L = hold.factor if is_kept else np.zeros((count, count))
    if is_new or not is_kept:
        _factor_dense(couplings, hold, places, L)
    _spread(couplings, hold.drives, hold.moves, hold.nodes)
    y, pushed = np.zeros(count), hold.drives.copy()
    for i in range(count):
        total = -hold.moves[places[i, 0], places[i, 1]]
        for j in range(i):
            total -= L[i, j] * y[j]
        y[i] = total * L[i, i]
    for i in range(count - 1, -1, -1):
        y[i] *= L[i, i]
        for j in range(i):
            y[j] -= L[i, j] * y[i]
        currents[places[i, 0], places[i, 1]] = y[i]
        pushed[places[i, 0], places[i, 1]] += y[i]
    _spread(couplings, pushed, hold.moves, hold.nodes)
    for i in range(count):
        hold.moves[places[i, 0], places[i, 1]] = 0.0


# ---- the rule ------------------------------------------------------------------------------------


@inner
def _held_among(hold, places):
    """Places of held neurons among some."""
    chosen, count = np.empty(places.shape, np.int64), 0
    for i in range(places.shape[0]):
        if hold.held[places[i, 0], places[i, 1]] == HELD:
            chosen[count, 0], chosen[count, 1] = places[i, 0], places[i, 1]
            count += 1
    return chosen[:count]


@inner
def _solve(couplings, hold, currents, places, first):
    """Moves and currents for the marks as they are; they have changed from a stage on."""
    is_new = first < hold.drives.shape[1]
    if couplings.stiff.shape[0] > 0:
        if is_new:
            _factor_band(couplings, hold, first)
        _solve_band(couplings, hold, currents)
    else:
        _solve_dense(couplings, hold, currents, _held_among(hold, places), is_new)


@inner
def _mark(hold, p, k, mark, first):
    """Set a mark; the first stage with a change, and none of whose factor is known."""
    before = hold.held[p, k]
    hold.held[p, k] = mark
    if before == UNKNOWN:
        return 0
    return min(first, k) if before != mark else first


@inner
def _at_rails(couplings, hold):
    """Coupled neurons that stand at rails: their places; others are marked free.

    And the first stage whose marks have changed.
    """
    stages, count = hold.drives.shape[1], 0
    places, first = np.empty((couplings.reached.shape[0] * stages, 2), np.int64), stages
    for p in couplings.reached:
        low, high = couplings.limits[p, 0], couplings.limits[p, 1]
        for k in range(stages):
            if couplings.rates[p, k] == 0.0:
                continue
            x = hold.values[p, k + 1]
            if x <= low or x >= high:
                places[count, 0], places[count, 1] = p, k
                count += 1
                if hold.held[p, k] == UNKNOWN:
                    out = _pushes_out(x, hold.drives[p, k], low, high)
                    first = _mark(hold, p, k, HELD if out else FREE, first)
            else:
                first = _mark(hold, p, k, FREE, first)
    return places[:count], first


@inner
def _exchange(couplings, hold, currents, places, only_last):
    """Exchange neurons that are held or free wrongly, or the last of them; the first stage of them.

    The number of stages where there is none.
    """
    stages, slack = hold.drives.shape[1], 0.0
    for i in range(places.shape[0]):
        p, k = places[i, 0], places[i, 1]
        if hold.held[p, k] == HELD:
            slack = max(slack, abs(hold.drives[p, k]) + abs(currents[p, k]))
    first = stages
    for i in range(places.shape[0] - 1, -1, -1):
        p, k = places[i, 0], places[i, 1]
        low, high, x = couplings.limits[p, 0], couplings.limits[p, 1], hold.values[p, k + 1]
        if hold.held[p, k] == HELD:
            wrong, mark = _lets_go(x, currents[p, k], low, high, ROUNDING * slack), FREE
        else:
            wrong, mark = _pushes_out(x, hold.moves[p, k], low, high), HELD
        if wrong:
            first = _mark(hold, p, k, mark, first)
            if only_last:
                return first
    return first


@inlined
def is_railed(limits, p):
    """Whether a neuron has a rail."""
    return limits[p, 0] > -np.inf or limits[p, 1] < np.inf


@inlined
def stands_at_rail(tape, values):
    """Whether a neuron that the metric couples to others stands at a rail."""
    found = False
    for p in tape.reached:
        if is_railed(tape.limits, p):
            low, high = tape.limits[p, 0], tape.limits[p, 1]
            for k in range(tape.rates.shape[1]):
                x = values[p, k + 1]
                found |= (x <= low or x >= high) and tape.rates[p, k] != 0.0
    return found


@compiled
def clamp(couplings, hold):
    """Moves of the neurons that a metric couples, some of which stand at rails: see `rules`.

    Parameters
    ----------
    couplings : Couplings
    hold : Hold
        Its values and drives are read; its moves and marks are overwritten.
    """
    places, first = _at_rails(couplings, hold)
    stages, currents = hold.drives.shape[1], np.zeros(hold.drives.shape)
    for pivot in range(PIVOTS):
        _solve(couplings, hold, currents, places, first)
        first = _exchange(couplings, hold, currents, places, pivot >= BLOCKS)
        if first == stages:
            return
    _solve(couplings, hold, currents, places, first)
    for i in range(places.shape[0]):  # numbers that are rounded: none moves outward all the same
        p, k = places[i, 0], places[i, 1]
        low, high = couplings.limits[p, 0], couplings.limits[p, 1]
        if _pushes_out(hold.values[p, k + 1], hold.moves[p, k], low, high):
            hold.moves[p, k] = 0.0


@compiled
def moves_while_held(couplings, hold, places, is_new):
    """Moves of the drives of a hold, for marks that are given and whose places these are.

    Parameters
    ----------
    couplings : Couplings
    hold : Hold
        Its drives and marks are read; its moves are overwritten.
    places : (h, 2) array of int
        Neuron and stage of those that are held.
    is_new : bool
        Whether the marks have no factor yet.
    """
    currents = np.zeros(hold.drives.shape)
    _solve(couplings, hold, currents, places, 0 if is_new else hold.drives.shape[1])


def clamped_moves(tape: Tape, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return the moves (n,) of drives (n,) while some neurons are held, as a function.

    Parameters
    ----------
    tape : Tape
    held : (n,) array of bool

    Returns
    -------
    callable or None
        None if the metric couples no held neuron to others.
    """
    held = held & np.isin(tape.places[:, 0], tape.reached)
    if not held.any():
        return None
    couplings = Couplings(*(getattr(tape, name) for name in Couplings._fields))
    hold, everywhere, places = Hold.of(tape), tuple(tape.places.T), tape.places[held]
    hold.held[everywhere] = np.where(held, HELD, FREE)
    own, coupled = tape.rates[everywhere], np.isin(tape.places[:, 0], tape.reached)
    hold.drives[everywhere] = 0.0
    moves_while_held(couplings, hold, places, True)

    def moves(drive: np.ndarray) -> np.ndarray:
        hold.drives[everywhere] = drive
        moves_while_held(couplings, hold, places, False)
        return np.where(coupled, hold.moves[everywhere], own * drive)

    return moves
