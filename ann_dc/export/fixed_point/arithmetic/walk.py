"""A program in floating point: where every word goes on the way to rest, and what is there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.formulas import check_written, compiled, value_at
from ann_dc.export.fixed_point.arithmetic.program import (
    DRIVE,
    FUNCTION,
    PRODUCT,
    RECTIFY,
    UPDATE,
    Program,
)


class Ranges(NamedTuple):
    """What a walk has seen of every word."""

    low: np.ndarray
    """(W,)."""
    high: np.ndarray
    """(W,)."""
    end: np.ndarray
    """(n,): the state after the last step."""


def walked(program: Program, steps: int) -> Ranges:
    """Walk from the start, and look at every word after every operation.

    Parameters
    ----------
    program : Program
    steps : int
        At least one.

    Returns
    -------
    Ranges

    Raises
    ------
    NetworkError
        If there is no formula for a function block of the program.
    """
    words = program.words.copy()
    words[program.states] = program.start
    low, high = words.copy(), words.copy()
    kind, written = program.operations[:, :2].T
    check_written(program.operations[kind == FUNCTION, 2].tolist())
    low[written[kind != UPDATE]], high[written[kind != UPDATE]] = np.inf, -np.inf
    state = program.start.copy()
    _walk(
        (program.operations, program.sources, program.weights),
        (program.states, program.limits),
        steps,
        state,
        (words, low, high),
    )
    return Ranges(low, high, state)


@compiled
def _walk(code, neurons, steps, state, seen):  # noqa: C901 - one branch an operation
    operations, sources, weights = code
    places, limits = neurons
    words, low, high = seen
    for _ in range(steps):
        for k in range(operations.shape[0]):
            kind, target, a, b, neuron = operations[k]
            if kind == PRODUCT:
                total = words[a] * words[b]
            elif kind == FUNCTION:
                total = value_at(a, words[b])
            elif kind == RECTIFY:
                total = max(words[b], 0.0)
            else:
                total = 0.0
                for e in range(a, b):
                    total += weights[e] * words[sources[e]]
            if kind == DRIVE:
                if state[neuron] <= limits[neuron, 0] and total < 0.0:
                    total = 0.0
                if state[neuron] >= limits[neuron, 1] and total > 0.0:
                    total = 0.0
            if kind == UPDATE:
                total = min(max(state[neuron] + total, limits[neuron, 0]), limits[neuron, 1])
                state[neuron] = total
                target = places[neuron]
            words[target] = total
            low[target] = min(low[target], total)
            high[target] = max(high[target], total)
