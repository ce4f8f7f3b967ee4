"""Analog-computer elements of a program: integrators, sums, products and functions.

Every operation of a `Program` of step one is an element, and every word that no operation writes is
a constant. An update is an integrator with the rates of the state as coefficients. A net input that
a single sum reads is part of that sum.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.lowering.program import (
    DRIVE,
    ONE,
    PRODUCT as PRODUCT_OPERATION,
    RECTIFY,
    SUMS,
    UPDATE,
    ZERO,
    Program,
)
from ann_dc.network.functions import FUNCTIONS

KINDS = ("integrator", "constant", "sum", "product", "function")
INTEGRATOR, CONSTANT, SUM, PRODUCT, FUNCTION = KINDS


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """Analog-computer element: reads earlier elements, or any element if it is an integrator.

    The ``wires`` are the weights of an integrator or a sum, by index of the source, and ``reads``
    are the factors of a product or the argument of a function. The ``value`` is that of a constant
    or the initial value of an integrator, which has the saturation limits.
    """

    name: str
    kind: str
    wires: Mapping[int, float] = field(default_factory=dict)
    reads: tuple[int, ...] = ()
    function: str = ""
    value: float = 0.0
    low: float = -np.inf
    high: float = np.inf


def elements_of(program: Program, labels: Sequence[str]) -> list[Element]:
    """Return the elements of a program of step one, in network units.

    The first n elements are integrators, with the given names (n,). A sum follows the elements that
    it reads.
    """
    return _Wiring(program, labels).elements


class _Wiring:
    """Elements of the operations, and the element of every word."""

    def __init__(self, program: Program, labels: Sequence[str]) -> None:
        self.program, self.names = program, _names_of(program, labels)
        self.places = {word: place for place, word in enumerate(program.states.tolist())}
        self.elements = [
            Element(name=name, kind=INTEGRATOR, value=value, low=low, high=high)
            for name, value, (low, high) in zip(
                labels, program.start.tolist(), program.limits.tolist()
            )
        ]
        self.inlined: dict[int, dict[int, float]] = {}
        counts = _reads_of(program)
        for kind, target, a, b, neuron in program.operations.tolist():
            if kind == UPDATE:
                self.elements[neuron] = replace(self.elements[neuron], wires=self._wires(a, b))
            elif kind == DRIVE and counts[target] == 1:
                self.inlined[target] = self._wires(a, b)
            else:
                self._add(target, self._element(kind, target, a, b))

    def _add(self, word: int, element: Element) -> int:
        self.places[word] = len(self.elements)
        self.elements.append(element)
        return self.places[word]

    def _place(self, word: int) -> int:
        """Return the element of a word; a word that no operation writes becomes a constant."""
        if word in self.places:
            return self.places[word]
        value = float(self.program.words[word])
        return self._add(word, Element(name=self.names[word], kind=CONSTANT, value=value))

    def _wires(self, first: int, last: int) -> dict[int, float]:
        wires: dict[int, float] = defaultdict(float)
        edges = slice(first, last)
        sources, weights = self.program.sources[edges], self.program.weights[edges]
        for word, weight in zip(sources.tolist(), weights.tolist()):
            inner = self.inlined[word] if word in self.inlined else {self._place(word): 1.0}
            for place, factor in inner.items():
                wires[place] += factor * weight
        return dict(wires)

    def _element(self, kind: int, target: int, a: int, b: int) -> Element:
        name = self.names[target]
        if kind in SUMS:
            return Element(name=name, kind=SUM, wires=self._wires(a, b))
        if kind == PRODUCT_OPERATION:
            return Element(name=name, kind=PRODUCT, reads=(self._place(a), self._place(b)))
        function = "rectify" if kind == RECTIFY else FUNCTIONS[a].name
        return Element(name=name, kind=FUNCTION, reads=(self._place(b),), function=function)


def _reads_of(program: Program) -> Counter[int]:
    """Return the number of sums that read each word."""
    counts: Counter[int] = Counter()
    for kind, _, a, b, _ in program.operations.tolist():
        if kind in SUMS:
            counts.update(program.sources[a:b].tolist())
    return counts


def _names_of(program: Program, labels: Sequence[str]) -> list[str]:
    """Return the names (W,) of all words: row and position in the row."""
    positions: Counter[int] = Counter()
    names = []
    for row in program.rows.tolist():
        names.append(f"{program.names[row]}[{positions[row]}]")
        positions[row] += 1
    for word in (ZERO, ONE):
        names[word] = program.names[program.rows[word]]
    for kind, target, _, _, neuron in program.operations.tolist():
        if kind == DRIVE:
            names[target] = f"drive {labels[neuron]}"
    return names
