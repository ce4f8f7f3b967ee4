"""Network as analog-computer elements: integrators, sums, products and functions.

Elements are not shared between stages, and every operation is explicit. The map M from net inputs
to state derivatives is built from sums. If M is the inverse of a stiffness S, the system is solved
with S = L L': a forward pass along the stages with L, and a backward pass with L'.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg
from scipy import sparse

from ann_dc.network.cell import ONE, Function, Product
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.base import PreconditionerKind

KINDS = ("integrator", "constant", "sum", "product", "function")
INTEGRATOR, CONSTANT, SUM, PRODUCT, FUNCTION = KINDS


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """Analog-computer element.

    An element reads earlier elements; an integrator reads any element.

    Attributes
    ----------
    wires : mapping of int to float
        Weights of the inputs of an integrator or a sum, by index of the source.
    reads : tuple of int
        Indices of the factors of a product, or of the argument of a function.
    function : str
        Name of the function.
    value : float
        Value of a constant, or initial value of an integrator.
    low, high : float
        Saturation limits of an integrator.
    """

    name: str
    kind: str
    wires: Mapping[int, float] = field(default_factory=dict)
    reads: tuple[int, ...] = ()
    function: str = ""
    value: float = 0.0
    low: float = -np.inf
    high: float = np.inf


def elements_of(network: Network) -> list[Element]:
    """Return the elements of a network in network units; the first n are integrators.

    A sum follows the elements that it reads. The network must not have saturation limits at neurons
    that its preconditioner couples.
    """
    return _Wiring(network).elements


class _Wiring:
    def __init__(self, network: Network) -> None:
        self.network = network
        self.elements = [self._integrator(i) for i in range(network.size)]
        self.constants: dict[str, int] = {}
        self.blocks: dict[tuple[str, int], int] = {}
        self.pins = {(pin.neuron, pin.stage): pin.input for pin in network.fixed}
        self.arriving = defaultdict(list)
        for wire in network.cell.connections:
            weight = np.broadcast_to(np.asarray(wire.weight, float), network.stages)
            self.arriving[wire.target].append((wire.source, int(wire.template), weight))
        for block in network.cell.blocks:
            for stage in range(network.stages):
                self.blocks[block.name, stage] = self._add(self._block(block, stage))
        self._wire_integrators()

    def _add(self, element: Element) -> int:
        self.elements.append(element)
        return len(self.elements) - 1

    def _integrator(self, component: int) -> Element:
        network = self.network
        limiter = network.cell.neurons[network.places[component, 0]].limiter
        return Element(
            name=network.label(component),
            kind=INTEGRATOR,
            value=float(network.start_state[component]),
            low=limiter.low,
            high=limiter.high,
        )

    def _constant(self, name: str, value: float) -> int:
        if name not in self.constants:
            self.constants[name] = self._add(Element(name=name, kind=CONSTANT, value=value))
        return self.constants[name]

    def _input(self, name: str, stage: int) -> int:
        return self._constant(f"{name}[{stage}]", float(self.network.input_values[name][stage]))

    def _source(self, name: str, stage: int) -> int | None:
        """Return the index of a node's element at a stage; None if its value is zero."""
        network = self.network
        if name == ONE:
            return self._constant(ONE, 1.0)
        if not 0 <= stage < network.stages:
            outside = stage == -1 and name in network.left_boundary
            return self._input(network.left_boundary[name], 0) if outside else None
        if name in network.neuron_index:
            component = int(network.state_index[network.neuron_index[name], stage])
            if component >= 0:
                return component
            pin = self.pins.get((name, stage))
            return None if pin is None else self._input(pin, stage)
        return self._input(name, stage) if name in network.cell.inputs else self.blocks[name, stage]

    def _wires(self, target: str, stages: range) -> dict[int, float]:
        wires: dict[int, float] = defaultdict(float)
        for source, template, weight in self.arriving[target]:
            for stage in stages:
                place = self._source(source, stage + template)
                if place is not None and weight[stage]:
                    wires[place] += float(weight[stage])
        return dict(wires)

    def _block(self, block, stage: int) -> Element:
        name, here = f"{block.name}[{stage}]", range(stage, stage + 1)
        if isinstance(block, Product):
            return Element(name=name, kind=PRODUCT, reads=self._reads(stage, block.a, block.b))
        if isinstance(block, Function):
            reads = self._reads(stage, block.x)
            return Element(name=name, kind=FUNCTION, reads=reads, function=block.function)
        return Element(name=name, kind=SUM, wires=self._wires(block.name, here))

    def _reads(self, stage: int, *names: str) -> tuple[int, ...]:
        found = [self._source(name, stage) for name in names]
        return tuple(self._constant("zero", 0.0) if p is None else p for p in found)

    # ---- from drives to moves ----------------------------------------------------------------

    def _wire_integrators(self) -> None:
        network = self.network
        arriving = [self._drive(i) for i in range(network.size)]
        if network.preconditioner.kind is PreconditionerKind.DIAGONAL:
            moves = [_times(w, r) for w, r in zip(arriving, network.layout.state_rates.tolist())]
        else:
            moves = self._moves(arriving)
        for i, wires in enumerate(moves):
            self.elements[i] = replace(self.elements[i], wires=wires)

    def _drive(self, component: int) -> dict[int, float]:
        neuron, stage = self.network.places[component].tolist()
        shared = neuron in self.network.shared
        stages = range(self.network.stages) if shared else range(stage, stage + 1)
        return self._wires(self.network.cell.neurons[neuron].name, stages)

    def _moves(self, arriving: list[dict[int, float]]) -> list[dict[int, float]]:
        """Return M d = spread S^-1 spread' d, with nodes for jointly moved neurons."""
        factors = self.network.preconditioner.factors(self.network.layout)
        spread, stiffness = factors.spread.tocsc(), factors.stiffness.tocsr()
        # nodes that belong to one neuron, and that no other node pulls
        alone = (np.diff(spread.indptr) == 1) & (np.diff(stiffness.indptr) == 1)
        drives = {}
        moves: list[dict[int, float]] = [{} for _ in arriving]
        for node in range(spread.shape[1]):
            for i in spread.indices[spread.indptr[node] : spread.indptr[node + 1]].tolist():
                if alone[node] and spread[[i], :].nnz == 1:
                    moves[i] = _times(arriving[i], spread[i, node] ** 2 / stiffness[node, node])
                elif i not in drives:
                    drives[i] = self._summed(i, arriving[i])
        answers = self._answers(spread, stiffness, drives)
        for node, answer in answers.items():
            for i, weight in _column(spread, node):
                moves[i] = {**moves[i], answer: weight}
        return moves

    def _summed(self, component: int, wires: dict[int, float]) -> int:
        """Add the net input of a neuron as a sum and return its index."""
        name = f"drive {self.elements[component].name}"
        return self._add(Element(name=name, kind=SUM, wires=wires))

    def _answers(self, spread, stiffness, drives: Mapping[int, int]) -> dict[int, int]:
        """Return the indices of S^-1 spread' d for the nodes that depend on any net input."""
        heard = [
            n for n in range(spread.shape[1]) if any(i in drives for i, _ in _column(spread, n))
        ]
        lower = _cholesky(stiffness[heard][:, heard])
        rows, down = lower.tocsr(), []
        for k, node in enumerate(heard):
            own = rows[k, k]
            wires = {drives[i]: weight / own for i, weight in _column(spread, node)}
            wires |= {down[j]: -weight / own for j, weight in _column(rows, k) if j < k}
            down.append(self._add(Element(name=f"down {node}", kind=SUM, wires=wires)))
        columns, answers = lower.tocsc(), {}
        for k in reversed(range(len(heard))):
            own = rows[k, k]
            wires = {down[k]: 1 / own}
            wires |= {answers[heard[j]]: -w / own for j, w in _column(columns, k) if j > k}
            answers[heard[k]] = self._add(Element(name=f"up {heard[k]}", kind=SUM, wires=wires))
        return answers


def _cholesky(stiffness) -> sparse.coo_array:
    """Compute L of S = L L' for S with a narrow band."""
    below = sparse.coo_array(sparse.tril(stiffness))
    i, j = below.coords
    size, width = len(stiffness.indptr) - 1, int((i - j).max(initial=0))
    band = np.zeros((width + 1, size))
    band[i - j, j] = below.data
    lower = scipy.linalg.cholesky_banded(band, lower=True)
    offset, column = np.nonzero(lower)
    at = column + offset, column
    return sparse.coo_array((lower[offset, column], at), shape=(size, size))


def _times(wires: Mapping[int, float], factor: float) -> dict[int, float]:
    return {place: float(weight * factor) for place, weight in wires.items()}


def _column(table, k: int) -> list[tuple[int, float]]:
    """Return rows and values of a CSC column (or columns and values of a CSR row)."""
    span = slice(table.indptr[k], table.indptr[k + 1])
    return list(zip(table.indices[span].tolist(), table.data[span].tolist()))
