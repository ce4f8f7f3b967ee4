"""A network as elements of an analog computer: integrators, sums, products, functions.

Nothing is shared and nothing is implied: every stage has elements of its own, and what the metric
does between drives and moves is wired as sums. A metric that is the inverse of a stiffness S is
solved as S = L L': down the row by L, and back by L'.
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
from ann_dc.network.preconditioners.base import Kind

KINDS = ("integrator", "constant", "sum", "product", "function")
INTEGRATOR, CONSTANT, SUM, PRODUCT, FUNCTION = KINDS


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """One element; it reads elements that stand before it, an integrator any.

    Attributes
    ----------
    name, kind : str
    wires : mapping of int to float
        What an integrator or a sum adds up: weight, by the place of the source.
    reads : tuple of int
        Places of the factors of a product, and the argument of a function.
    function : str
        Which function.
    value : float
        Of a constant; of an integrator, at the start.
    low, high : float
        Where an integrator stops.
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
    """The elements of a network, in network units; the first n are its integrators.

    A sum stands behind what it reads.

    Parameters
    ----------
    network : Network
        Without rails at neurons that its metric couples.
    """
    return _Wiring(network).elements


class _Wiring:
    def __init__(self, network: Network) -> None:
        self.network = network
        self.elements = [self._integrator(i) for i in range(network.size)]
        self.constants: dict[str, int] = {}
        self.blocks: dict[tuple[str, int], int] = {}
        self.pins = {(pin.neuron, pin.stage): pin.input for pin in network.pins}
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
        """Place of what a node says at a stage; None where that is zero."""
        network = self.network
        if name == ONE:
            return self._constant(ONE, 1.0)
        if not 0 <= stage < network.stages:
            outside = stage == -1 and name in network.left
            return self._input(network.left[name], 0) if outside else None
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
        if network.metric.kind is Kind.TIME_CONSTANTS:
            moves = [_times(w, r) for w, r in zip(arriving, network.row.state_rates.tolist())]
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
        """M d = spread S^-1 spread' d, with nodes for what neurons move together."""
        factors = self.network.metric.factors(self.network.row)
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
        """Add the drive of a neuron as a sum; return its place."""
        name = f"drive {self.elements[component].name}"
        return self._add(Element(name=name, kind=SUM, wires=wires))

    def _answers(self, spread, stiffness, drives: Mapping[int, int]) -> dict[int, int]:
        """Places of S^-1 spread' d, of the nodes that hear any of the drives."""
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
    """L of S = L L', for S with a narrow band."""
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
    """Rows and values of a column of a CSC array; columns and values of a row of a CSR one."""
    span = slice(table.indptr[k], table.indptr[k + 1])
    return list(zip(table.indices[span].tolist(), table.data[span].tolist()))
