"""Floating-point execution of a program for many inputs, with the range of every word."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ann_dc.evaluation.formulas import check_written, compiled, value_at
from ann_dc.lowering.program import DRIVE, FUNCTION, GROUP, PRODUCT, RECTIFY, UPDATE, Program


class Ranges(NamedTuple):
    """Lowest and highest value of every word in trajectories."""

    low: np.ndarray
    """Lowest values: (W,)."""
    high: np.ndarray
    """Highest values: (W,)."""


class Walks:
    """Trajectories of a program from its initial state, one per lane.

    Inputs ``loaded`` have the given values (N, B) in network units, other inputs those of the
    program. The arrays ``words``, ``low`` and ``high`` (W, B) are the current words and their
    ranges since the start. Raises `NetworkError` if a function block has no formula.
    """

    def __init__(self, program: Program, loaded: Mapping[str, np.ndarray]) -> None:
        lanes = next((values.shape[1] for values in loaded.values()), 1)
        self.program, self.words = program, np.repeat(program.words[:, None], lanes, axis=1)
        self.words[program.states] = program.start[:, None]
        for name, values in loaded.items():
            self.words[program.inputs[name]] = values
        self.low, self.high = self.words.copy(), self.words.copy()
        kind, written = program.operations[:, :2].T
        check_written(program.operations[kind == FUNCTION, 2].tolist())
        self.low[written[kind != UPDATE]], self.high[written[kind != UPDATE]] = np.inf, -np.inf

    def run(self, steps: int, lanes: np.ndarray) -> None:
        """Execute steps in the given lanes."""
        program, memory = self.program, (self.words, self.low, self.high)
        for at in range(0, len(lanes), GROUP):
            group = lanes[at : at + GROUP]
            own = tuple(np.ascontiguousarray(part[:, group]) for part in memory)
            _walk(
                (program.operations, program.sources, program.weights),
                (program.states, program.limits),
                steps,
                own,
            )
            for part, now in zip(memory, own):
                part[:, group] = now

    def ranges(self, lanes: np.ndarray) -> Ranges:
        """Return the combined ranges of the given lanes."""
        return Ranges(self.low[:, lanes].min(1), self.high[:, lanes].max(1))


@compiled
def _walk(code, neurons, steps, seen):  # noqa: C901 - one branch an operation
    operations, sources, weights = code
    places, limits = neurons
    words, low, high = seen
    lanes = words.shape[1]
    value = np.zeros(lanes)
    for _ in range(steps):
        for k in range(operations.shape[0]):
            kind, target, a, b, neuron = operations[k]
            if kind == PRODUCT:
                for i in range(lanes):
                    value[i] = words[a, i] * words[b, i]
            elif kind == FUNCTION:
                for i in range(lanes):
                    value[i] = value_at(a, words[b, i])
            elif kind == RECTIFY:
                for i in range(lanes):
                    value[i] = max(words[b, i], 0.0)
            else:
                value[:] = 0.0
                for e in range(a, b):
                    source, weight = sources[e], weights[e]
                    for i in range(lanes):
                        value[i] += weight * words[source, i]
            if kind == DRIVE:
                least, most = limits[neuron, 0], limits[neuron, 1]
                for i in range(lanes):
                    state = words[places[neuron], i]
                    if (state <= least and value[i] < 0.0) or (state >= most and value[i] > 0.0):
                        value[i] = 0.0
            if kind == UPDATE:
                target, least, most = places[neuron], limits[neuron, 0], limits[neuron, 1]
                for i in range(lanes):
                    value[i] = min(max(words[target, i] + value[i], least), most)
            for i in range(lanes):
                words[target, i] = value[i]
                low[target, i] = min(low[target, i], value[i])
                high[target, i] = max(high[target, i], value[i])
