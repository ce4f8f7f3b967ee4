"""Power iterations on the flow of one network, on generated code."""

from __future__ import annotations

import math

from ann_dc.evaluation.formulas import compiled, inner
from ann_dc.evaluation.vector_code.calls import call


@inner
def _length(v):
    total = 0.0
    for i in range(len(v)):
        total += v[i] * v[i]
    return math.sqrt(total)


@inner
def _push(drives, places, entries, values, v, length):
    """Drives K v / |v|."""
    for i in range(len(v)):
        drives[places[i]] = 0.0
    for e in range(len(values)):
        drives[places[entries[e, 0]]] += values[e] * v[entries[e, 1]] / length


@compiled
def grown(entry, places, rates, entries, values, v, tables, iterations):
    """How much longer the last of some iterations v' = M K v / |v| has made ``v``, in its place.

    Parameters
    ----------
    entry : (2,) array of int
        Addresses of ``metric``, zero where there is none, and of its table.
    places : (n,) array
        Where the components of a state lie in a table without ghosts.
    rates : (n,) array
        Of the neurons, without the metric.
    entries, values : (nnz, 4) and (nnz,) arrays
        Rows, columns and numbers of K, as a tape has them.
    v : (n,) array
    tables : two arrays
        Of drives and moves, which ``metric`` reads and adds to.
    iterations : int

    Returns
    -------
    float
        1 where nothing grows.
    """
    metric, table, rate = entry[0], entry[1], 1.0
    drives, moves = tables
    for i in range(len(drives)):
        drives[i] = 0.0
    length = _length(v)
    for _ in range(iterations):
        _push(drives, places, entries, values, v, length)
        for i in range(len(v)):
            moves[places[i]] = drives[places[i]] * rates[i]
        if metric != 0:
            call(metric, (table, moves.ctypes.data), ())
        for i in range(len(v)):
            v[i] = moves[places[i]]
        length = _length(v)
        if not 0.0 < length < math.inf:
            break
        rate = length
    return rate
