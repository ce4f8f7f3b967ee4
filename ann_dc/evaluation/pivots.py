"""Projection of derivatives on saturation limits as loops over numbers.

The NumPy version is in `projection`. The set of held neurons and its factor are cached between
calls. The cache saves time and does not change results.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ann_dc.evaluation import rules
from ann_dc.evaluation.formulas import compiled, inlined, inner
from ann_dc.evaluation.rules import BLOCKS, PIVOTS, ROUNDING
from ann_dc.evaluation.solves import FREE, HELD, UNKNOWN, Couplings, Hold, solve
from ann_dc.evaluation.tape import Tape

_pushes_out = inner(rules.pushes_out)
_lets_go = inner(rules.lets_go)


@inner
def _mark(hold, p, k, mark, first):
    """Set a mark and return the first stage with a change, or 0 after an unknown mark."""
    before = hold.held[p, k]
    hold.held[p, k] = mark
    if before == UNKNOWN:
        return 0
    return min(first, k) if before != mark else first


@inner
def _at_limits(couplings, hold):
    """Return the places of coupled neurons at limits and the first changed stage.

    Neurons between their limits are marked free.
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
    """Exchange the wrongly held or free neurons, or only the last of them.

    Returns the first stage of an exchange, or the number of stages if there is none.
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
            wrong, mark = _pushes_out(x, hold.derivatives[p, k], low, high), HELD
        if wrong:
            first = _mark(hold, p, k, mark, first)
            if only_last:
                return first
    return first


@inlined
def has_limit(limits, p):
    """Return True if a neuron has a saturation limit."""
    return limits[p, 0] > -np.inf or limits[p, 1] < np.inf


@inlined
def stands_at_limit(tape, values):
    """Return True if a neuron that the preconditioner couples to others is at a limit."""
    found = False
    for p in tape.reached:
        if has_limit(tape.limits, p):
            low, high = tape.limits[p, 0], tape.limits[p, 1]
            for k in range(tape.rates.shape[1]):
                x = values[p, k + 1]
                found |= (x <= low or x >= high) and tape.rates[p, k] != 0.0
    return found


@inner
def clamp(couplings, hold):
    """Compute the derivatives of coupled neurons, some at limits; see `rules`.

    The values and drives of the `Hold` are read; its moves and marks are overwritten.
    """
    places, first = _at_limits(couplings, hold)
    stages, currents = hold.drives.shape[1], np.zeros(hold.drives.shape)
    for pivot in range(PIVOTS):
        solve(couplings, hold, currents, places, first)
        first = _exchange(couplings, hold, currents, places, pivot >= BLOCKS)
        if first == stages:
            return
    solve(couplings, hold, currents, places, first)
    for i in range(places.shape[0]):  # numbers that are rounded: none moves outward all the same
        p, k = places[i, 0], places[i, 1]
        low, high = couplings.limits[p, 0], couplings.limits[p, 1]
        if _pushes_out(hold.values[p, k + 1], hold.derivatives[p, k], low, high):
            hold.derivatives[p, k] = 0.0


@compiled
def _derivatives_while_held(couplings, hold, places, is_new):
    """Compute the derivatives of a `Hold` for given marks.

    The drives and marks are read and the moves are overwritten. ``places`` (h, 2) contains neuron
    and stage of the held neurons; ``is_new`` is True if the marks have no factor yet.
    """
    currents = np.zeros(hold.drives.shape)
    solve(couplings, hold, currents, places, 0 if is_new else hold.drives.shape[1])


def clamped_derivative(tape: Tape, held: np.ndarray) -> Callable[[np.ndarray], np.ndarray] | None:
    """Return a function from net inputs (n,) to derivatives (n,) with held neurons.

    Returns None if the preconditioner couples no held neuron, given by a mask (n,), to others.
    """
    held = held & np.isin(tape.places[:, 0], tape.reached)
    if not held.any():
        return None
    couplings = Couplings(*(getattr(tape, name) for name in Couplings._fields))
    hold, everywhere, places = Hold.of(tape), tuple(tape.places.T), tape.places[held]
    hold.held[everywhere] = np.where(held, HELD, FREE)
    own, coupled = tape.rates[everywhere], np.isin(tape.places[:, 0], tape.reached)
    hold.drives[everywhere] = 0.0
    _derivatives_while_held(couplings, hold, places, True)

    def derivatives(drive: np.ndarray) -> np.ndarray:
        hold.drives[everywhere] = drive
        _derivatives_while_held(couplings, hold, places, False)
        return np.where(coupled, hold.derivatives[everywhere], own * drive)

    return derivatives
