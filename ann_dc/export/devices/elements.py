"""Analog-computer elements of a program: integrators, sums, products and functions.

Every operation of a `Program` of step one is an element, and every word that no operation writes is
a constant. An update is an integrator with the rates of the state as coefficients. A net input that
a single sum reads is part of that sum.

In machine units, elements are a `Program` again, which is executed level by level. A function is
evaluated in network units, so its argument and its result are scaled.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ann_dc.lowering import program as lowered
from ann_dc.lowering.levels import levels_of, words_of
from ann_dc.lowering.program import DRIVE, ONE, RECTIFY, SUMS, UPDATE, ZERO, Listing, Program
from ann_dc.network.functions import CODE, FUNCTIONS

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
        if kind == lowered.PRODUCT:
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

    def derivatives(self, x: np.ndarray) -> np.ndarray:
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
