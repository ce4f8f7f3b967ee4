r"""Program as levels of operations that do not read each other.

The depth of an operation is one more than the largest depth that it reads, so the largest depth is
the number of sequential operations of a parallel machine. All operations of one kind and depth form
a level, executed with three array operations: gather, compute, scatter.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

from ann_dc.evaluation.rules import pushes_out
from ann_dc.lowering.program import DRIVE, FUNCTION, PRODUCT, RECTIFY, SUMS, UPDATE, Program
from ann_dc.network.functions import FUNCTIONS


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """Operations of one kind and depth: K operations, E edges.

    The ``targets`` (K,) are the written words, or the neurons of updates. The ``operands`` (2, K)
    are the words that a product reads; a function, whose code is ``code``, and a rectifier read the
    second one. Drives and updates belong to ``neurons`` (K,). Sums read the words ``sources`` (E,)
    with their ``weights`` for the operations ``owners``.
    """

    kind: int
    code: int
    targets: np.ndarray
    operands: np.ndarray
    neurons: np.ndarray
    sources: np.ndarray
    weights: np.ndarray
    owners: np.ndarray

    def results(self, words: np.ndarray) -> np.ndarray:
        """Return the results (K,) for words (W,), without saturation limits."""
        a, b = self.operands
        if self.kind == PRODUCT:
            return words[a] * words[b]
        if self.kind == FUNCTION:
            return FUNCTIONS[self.code].value(words[b])
        if self.kind == RECTIFY:
            return np.maximum(words[b], 0.0)
        return np.bincount(self.owners, self.weights * words[self.sources], len(self.targets))


def levels_of(program: Program) -> tuple[Level, ...]:
    """Return the levels of a program in order of depth; the updates are the last level."""
    kinds, codes = program.operations[:, 0], program.operations[:, 2]
    codes = np.where(kinds == FUNCTION, codes, -1)
    keys = [*zip(depths_of(program).tolist(), kinds.tolist(), codes.tolist())]
    groups = groupby(sorted(range(len(keys)), key=keys.__getitem__), keys.__getitem__)
    return tuple(_level(program, key, np.array(list(own))) for key, own in groups)


def depths_of(program: Program) -> np.ndarray:
    """Return the depth (K,) of every operation, at least 1; updates have one depth."""
    words, depths = [0] * len(program.words), []
    sources = program.sources.tolist()
    for kind, target, a, b, _ in program.operations.tolist():
        read = sources[a:b] if kind in SUMS else (a, b) if kind == PRODUCT else (b,)
        depths.append(1 + max((words[word] for word in read), default=0))
        if kind != UPDATE:
            words[target] = depths[-1]
    last = 1 + max(words, default=0)
    return np.where(program.operations[:, 0] == UPDATE, last, np.array(depths, np.int64))


def words_of(program: Program, levels: tuple[Level, ...], state: np.ndarray) -> np.ndarray:
    """Return all words (W,) at a state (n,); the words of the neurons are the state."""
    words = program.words.copy()
    words[program.states] = state
    for level in levels:
        if level.kind == UPDATE:
            continue
        results = level.results(words)
        if level.kind == DRIVE:
            low, high = program.limits[level.neurons].T
            results[pushes_out(state[level.neurons], results, low, high)] = 0.0
        words[level.targets] = results
    return words


def _level(program: Program, key: tuple[int, int, int], own: np.ndarray) -> Level:
    _, kind, code = key
    _, targets, a, b, neurons = program.operations[own].T
    counts = b - a if kind in SUMS else np.zeros(len(own), np.int64)
    owners = np.repeat(np.arange(len(own)), counts)
    # position of every edge: its sum's first edge, and how many edges of the sum precede it
    edges = np.repeat(a - np.cumsum(counts) + counts, counts) + np.arange(len(owners))
    return Level(
        kind=kind,
        code=code,
        targets=targets,
        operands=np.stack([a, b]),
        neurons=neurons,
        sources=program.sources[edges],
        weights=program.weights[edges],
        owners=owners,
    )
