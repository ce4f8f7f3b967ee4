"""Loops over the generated code of one network: Euler steps, power iterations."""

from __future__ import annotations

import math

from ann_dc.evaluation.calls import call
from ann_dc.evaluation.formulas import compiled, inner
from ann_dc.evaluation.rules import LOST, OVERFLOW, RAN, SETTLED


@compiled
def recur(entry, x, derivatives, found, limits, step, count, tolerance):
    """Run up to ``count`` forward Euler steps of ``step`` on a state in place.

    Step, count, tolerance and the results (steps, residual, outcome) are those of `loops.recur`.
    ``entry`` (4,) contains the addresses of ``rhs``, ``residuals`` and their table, and the numbers
    of a ghost chunk; ``limits`` (size, 3) the largest change in a step and the lowest and highest
    state.
    """
    rhs, residuals, table, ghost, last = entry[0], entry[1], entry[2], entry[3], 0.0
    for done in range(count):
        outside = call(rhs, (table, x.ctypes.data, derivatives.ctypes.data), ())
        call(residuals, (table, x.ctypes.data, found.ctypes.data), ())
        last = max(found[0], found[1])
        if last < tolerance:
            return done, last, SETTLED
        if not last < OVERFLOW or outside != 0:
            return done, last, LOST
        reach = step
        for i in range(limits.shape[0]):
            speed = abs(derivatives[i])
            if reach * speed > limits[i, 0]:
                reach = limits[i, 0] / speed
        for i in range(limits.shape[0]):
            moved = x[ghost + i] + reach * derivatives[i]
            x[ghost + i] = min(max(moved, limits[i, 1]), limits[i, 2])
    return count, last, RAN


@inner
def _length(v):
    total = 0.0
    for i in range(len(v)):
        total += v[i] * v[i]
    return math.sqrt(total)


@inner
def _push(drives, places, entries, values, v, length):
    """Compute the net inputs K v / |v|."""
    for i in range(len(v)):
        drives[places[i]] = 0.0
    for e in range(len(values)):
        drives[places[entries[e, 0]]] += values[e] * v[entries[e, 1]] / length


@compiled
def grown(entry, places, rates, entries, values, v, tables, iterations):
    """Return the growth of ``v`` in the last of several iterations v' = M K v / |v|, at least 1.

    The vector is overwritten. ``entry`` (2,) contains the addresses of ``preconditioner`` (zero if
    there is none) and of its table, ``places`` (n,) and ``rates`` (n,) the places and uncoupled
    rates of the state components, ``entries`` (nnz, 4) and ``values`` (nnz,) K as in a tape.
    ``tables`` are the net inputs and derivatives of ``preconditioner``.
    """
    preconditioner, table, rate = entry[0], entry[1], 1.0
    drives, derivatives = tables
    for i in range(len(drives)):
        drives[i] = 0.0
    length = _length(v)
    for _ in range(iterations):
        _push(drives, places, entries, values, v, length)
        for i in range(len(v)):
            derivatives[places[i]] = drives[places[i]] * rates[i]
        if preconditioner != 0:
            call(preconditioner, (table, derivatives.ctypes.data), ())
        for i in range(len(v)):
            v[i] = derivatives[places[i]]
        length = _length(v)
        if not 0.0 < length < math.inf:
            break
        rate = length
    return rate
