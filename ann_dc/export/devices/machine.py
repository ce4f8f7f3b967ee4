"""Simulation of analog elements: values at a state and derivatives of integrators.

Elements in machine units are a `Program`, which is executed level by level. A function is evaluated
in network units, so its argument and its result are scaled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ann_dc.export.devices.elements import (
    CONSTANT,
    FUNCTION,
    INTEGRATOR,
    PRODUCT,
    SUM,
    Element,
)
from ann_dc.lowering import program as lowered
from ann_dc.lowering.levels import levels_of, words_of
from ann_dc.lowering.program import Listing, Program
from ann_dc.network.functions import CODE


class Machine:
    """Executable set of analog-computer elements, integrators first.

    Functions use ``scales`` (E,): the value that one machine unit of every element represents.
    """

    def __init__(self, elements: Sequence[Element], scales: np.ndarray | None = None) -> None:
        self.elements = elements
        self.scales = np.ones(len(elements)) if scales is None else scales
        self.integrators = np.flatnonzero([e.kind == INTEGRATOR for e in elements])
        self._words, self._program = _program_of(elements, self.scales)
        self._levels, self._drives = levels_of(self._program), self._program.drives

    @property
    def start(self) -> np.ndarray:
        """Initial values (n,) of the integrators."""
        return self._program.start.copy()

    def values(self, x: np.ndarray) -> np.ndarray:
        """Return the values (E,) of all elements at integrator states x (n,)."""
        return words_of(self._program, self._levels, x)[self._words]

    def moves(self, x: np.ndarray) -> np.ndarray:
        """Return dX/dT (n,) of the integrators; zero if a limit would be exceeded."""
        return words_of(self._program, self._levels, x)[self._drives]

    def within(self, x: np.ndarray) -> np.ndarray:
        """Return the state with every integrator within its limits."""
        return np.clip(x, *self._program.limits.T)


def _program_of(elements: Sequence[Element], scales: np.ndarray) -> tuple[np.ndarray, Program]:
    """Return the words (E,) of the elements, and the program without updates."""
    listing = Listing()
    row = listing.row("element")
    words = listing.new(row, [e.value if e.kind == CONSTANT else 0.0 for e in elements])
    integrators = [(e, word) for e, word in zip(elements, words.tolist()) if e.kind == INTEGRATOR]
    for k, e in enumerate(elements):
        word, read = int(words[k]), words[list(e.reads)].tolist()
        if e.kind == SUM:
            listing.sum(lowered.SUM, word, _edges(e, words))
        elif e.kind == PRODUCT:
            listing.operations.append((lowered.PRODUCT, word, *read, -1))
        elif e.kind == FUNCTION:
            argument, result = listing.word(row), listing.word(row)
            listing.sum(lowered.SUM, argument, [(read[0], float(scales[e.reads[0]]))])
            operation = (lowered.FUNCTION, result, CODE[e.function], argument, -1)
            listing.operations.append(operation)
            listing.sum(lowered.SUM, word, [(result, 1 / float(scales[k]))])
    for neuron, (e, _) in enumerate(integrators):
        listing.sum(lowered.DRIVE, listing.word(row), _edges(e, words), neuron)
    limits = [(e.low, e.high) for e, _ in integrators]
    return words, Program(
        operations=np.array(listing.operations, np.int64).reshape(-1, 5),
        sources=np.array(listing.sources, np.int64),
        weights=np.array(listing.weights),
        words=np.array(listing.values),
        rows=np.array(listing.rows, np.int64),
        names=tuple(listing.names),
        states=np.array([word for _, word in integrators], np.int64),
        start=np.array([e.value for e, _ in integrators]),
        limits=np.array(limits).reshape(-1, 2),
        inputs={},
    )


def _edges(e: Element, words: np.ndarray) -> list[tuple[int, float]]:
    return [(int(words[place]), weight) for place, weight in e.wires.items()]
