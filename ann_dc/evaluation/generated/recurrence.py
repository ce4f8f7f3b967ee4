"""Forward Euler steps of one network on generated code, as `loops.recur` does them on a tape."""

from __future__ import annotations

from ann_dc.evaluation.formulas import compiled
from ann_dc.evaluation.rules import LOST, OVERFLOW, RAN, SETTLED
from ann_dc.evaluation.vector_code.calls import call


@compiled
def recur(entry, x, moves, found, limits, step, count, tolerance):
    """Up to ``count`` forward Euler steps of ``step`` on a state in place.

    Parameters
    ----------
    entry : (4,) array of int
        Addresses of ``rhs``, ``residuals`` and their table, and numbers of a ghost chunk.
    x, moves, found : arrays
        A state with ghosts, dx/ds, and what ``residuals`` gives.
    limits : (size, 3) array
        Largest move in a step, lowest and highest state, for the numbers of a state.
    step, count, tolerance
        As `loops.recur`.

    Returns
    -------
    steps, residual, outcome
        As `loops.recur`.
    """
    rhs, residuals, table, ghost, last = entry[0], entry[1], entry[2], entry[3], 0.0
    for done in range(count):
        outside = call(rhs, (table, x.ctypes.data, moves.ctypes.data), ())
        call(residuals, (table, x.ctypes.data, found.ctypes.data), ())
        last = max(found[0], found[1])
        if last < tolerance:
            return done, last, SETTLED
        if not last < OVERFLOW or outside != 0:
            return done, last, LOST
        reach = step
        for i in range(limits.shape[0]):
            speed = abs(moves[i])
            if reach * speed > limits[i, 0]:
                reach = limits[i, 0] / speed
        for i in range(limits.shape[0]):
            moved = x[ghost + i] + reach * moves[i]
            x[ghost + i] = min(max(moved, limits[i, 1]), limits[i, 2])
    return count, last, RAN
