r"""Cell as ONNX operations: outputs of its blocks and net inputs of its neurons.

A node of the cell is a tensor (N, B): stages, samples. The shape is (N, 1) or (1, 1) if the values
are equal for all samples or stages. The value of a neighbour is the same tensor, shifted by a
stage.

Function blocks are written from the trees of their formulas. In float64, onnxruntime has no tan,
sinh, cosh, atan, asin and acos. The inverse functions are computed in float32 and corrected once by
an addition theorem, with s and c the sine and cosine of the float32 value :math:`y_0`:

.. math:: \arctan x = y_0 + \arctan\frac{x c - s}{c + x s}, \qquad
    \arcsin x = y_0 + \arcsin(x c - r s), \quad r = \sqrt{1 - x^2},

where the correction is so small that two terms of its series are exact.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ann_dc.export.onnx.graph import Graph
from ann_dc.network.cell import ONE, Connection, Function, Product, Sum, Template
from ann_dc.network.functions import FunctionBlock, Tree, function_block
from ann_dc.network.network import Network

KINDS = {"add": "Add", "subtract": "Sub", "multiply": "Mul", "divide": "Div", "where": "Where"}
KINDS |= {"at_most": "LessOrEqual", "above": "Greater"}
"""ONNX operations of trees; those of elementary operations are capitalised: ``Sin``, ``Atan``."""
SMALL = 0.5
"""Argument below which sinh is computed from the hyperbolic tangent of its half."""

BELOW_RIGHT_ANGLE = 6.123233995736766e-17
"""Rounding remainder of pi / 2 in float64."""


def value(graph: Graph, function: str, x: str) -> str:
    """Return y = g(x) of a function block, element by element."""
    return _of_tree(graph, function_block(function).trees[0], x)


def _of_tree(graph: Graph, tree: Tree, x: str) -> str:
    if not isinstance(tree, tuple):
        return x if isinstance(tree, str) else graph.number(tree)
    operation, first = tree[0], tree[1]
    if operation == "divide" and first == 1.0:
        return graph.op("Reciprocal", _of_tree(graph, tree[2], x))
    given = [_of_tree(graph, part, x) for part in tree[1:]]
    if operation == "maximum":  # nan in the first operand passes
        a, b = given
        return graph.op("Where", graph.op("LessOrEqual", a, b), b, a)
    if operation in _COMPOSED and graph.dtype != np.float32:
        return _COMPOSED[operation](graph, *given)
    return graph.op(KINDS.get(operation) or operation.capitalize(), *given)


def inside(graph: Graph, block: FunctionBlock, x: str, side: str | None) -> str | None:
    """Return a number that is positive if x is in the domain of a block; None if all x are.

    If the block has a pole, ``side`` is the required sign of x; None permits both signs.
    """
    if block.has_pole:
        return graph.op("Abs", x) if side is None else graph.op("Mul", x, side)
    low, high = block.domain
    if not block.is_limited:
        return None
    if low == -high:
        return graph.op("Sub", graph.number(high), graph.op("Abs", x))
    return x if low == 0.0 else graph.op("Sub", x, graph.number(low))


def side_of_pole(graph: Graph, x: str) -> str:
    """Return -1 for a negative argument, else 1."""
    negative = graph.op("Less", x, graph.number(0.0))
    return graph.op("Where", negative, graph.number(-1.0), graph.number(1.0))


def _tan(graph: Graph, x: str) -> str:
    """Compute sin x / sin(pi/2 - |x|); a cosine would lose digits near the poles."""
    apart = graph.op("Sub", graph.number(np.pi / 2), graph.op("Abs", x))
    apart = graph.op("Add", apart, graph.number(BELOW_RIGHT_ANGLE))
    return graph.op("Div", graph.op("Sin", x), graph.op("Sin", apart))


def _exponentials(graph: Graph, kind: str, x: str) -> str:
    pair = graph.op("Exp", x), graph.op("Exp", graph.op("Neg", x))
    return graph.op("Mul", graph.number(0.5), graph.op(kind, *pair))


def _cosh(graph: Graph, x: str) -> str:
    return _exponentials(graph, "Add", x)


def _sinh(graph: Graph, x: str) -> str:
    """Compute 2 t / (1 - t^2) with t = tanh(x / 2) for small x.

    Exponentials would cancel there.
    """
    t = graph.op("Tanh", graph.op("Mul", graph.number(0.5), x))
    below = graph.op("Sub", graph.number(1.0), graph.op("Mul", t, t))
    near = graph.op("Div", graph.op("Add", t, t), below)
    is_small = graph.op("Less", graph.op("Abs", x), graph.number(SMALL))
    return graph.op("Where", is_small, near, _exponentials(graph, "Sub", x))


def _first(graph: Graph, kind: str, x: str) -> tuple[str, str, str]:
    """Return the value in float32, its sine, and its cosine."""
    from onnx import TensorProto

    single = graph.op(kind, graph.op("Cast", x, to=TensorProto.FLOAT))
    y = graph.op("Cast", single, to=TensorProto.DOUBLE)
    return y, graph.op("Sin", y), graph.op("Cos", y)


def _corrected(graph: Graph, y: str, small: str, third: float) -> str:
    """Compute y + small + third small^3."""
    square = graph.op("Mul", small, small)
    factor = graph.op("Mul", graph.number(third), square)
    return graph.op("Add", y, graph.op("Add", small, graph.op("Mul", factor, small)))


def _atan(graph: Graph, x: str) -> str:
    y, s, c = _first(graph, "Atan", x)
    above = graph.op("Sub", graph.op("Mul", x, c), s)
    below = graph.op("Add", c, graph.op("Mul", x, s))
    return _corrected(graph, y, graph.op("Div", above, below), -1 / 3)


def _root(graph: Graph, x: str) -> str:
    """Compute sqrt(1 - x^2), exact also near one."""
    one = graph.number(1.0)
    return graph.op("Sqrt", graph.op("Mul", graph.op("Sub", one, x), graph.op("Add", one, x)))


def _asin(graph: Graph, x: str) -> str:
    y, s, c = _first(graph, "Asin", x)
    along, across = graph.op("Mul", x, c), graph.op("Mul", _root(graph, x), s)
    return _corrected(graph, y, graph.op("Sub", along, across), 1 / 6)


def _acos(graph: Graph, x: str) -> str:
    y, s, c = _first(graph, "Acos", x)
    along, across = graph.op("Mul", _root(graph, x), c), graph.op("Mul", x, s)
    return _corrected(graph, y, graph.op("Sub", along, across), 1 / 6)


_COMPOSED = {"tan": _tan, "cosh": _cosh, "sinh": _sinh, "atan": _atan, "asin": _asin, "acos": _acos}
"""Operations that onnxruntime supports only in float32."""


class CellReading:
    """Values of all nodes of a network at one state, written to a graph.

    ``neurons`` and ``inputs`` are rows (N, B), in the order of the cell; ``batch`` is the number of
    samples, as a shape (1,).
    """

    def __init__(
        self,
        network: Network,
        graph: Graph,
        *,
        neurons: Sequence[str],
        inputs: Sequence[str],
        batch: str,
    ) -> None:
        self.network, self.graph, self._batch = network, graph, batch
        cell = network.cell
        names = [*(neuron.name for neuron in cell.neurons), *cell.inputs]
        self._values = dict(zip(names, [*neurons, *inputs]))
        self._arriving: dict[str, list[Connection]] = {}
        for connection in cell.connections:
            self._arriving.setdefault(connection.target, []).append(connection)
        self._inputs, self._full = dict(zip(cell.inputs, inputs)), {*neurons, *inputs}
        for block in cell.blocks:
            graph.about(block.name)
            self._values[block.name] = self._block(block)

    def neuron(self, number: int) -> str:
        """Return the state (N, B) of a neuron."""
        return self._values[self.network.cell.neurons[number].name]

    def drives(self) -> list[str]:
        """Return the net inputs of all neurons, (N, B) each; shared neurons sum all cells."""
        rows = []
        for neuron in self.network.cell.neurons:
            self.graph.about(neuron.name)
            row = self._whole(self._total(neuron.name))
            if neuron.shared:
                added = self.graph.op("ReduceSum", row, self.graph.integers(0), keepdims=1)
                row = self._whole(added)
            rows.append(row)
        return rows

    def sides(self) -> dict[str, str]:
        """Return the sign of each reciprocal's argument (side of the pole), by block."""
        return {
            block.name: side_of_pole(self.graph, self._values[block.x])
            for block in self._guarded()
            if function_block(block.function).has_pole
        }

    def is_inside(self, sides: dict[str, str]) -> str | None:
        """Return booleans (B,): True if every function is inside its domain; None if all are.

        Argument ``sides`` is the result of `sides` at the start; without an entry, both sides of a
        pole are valid.
        """
        graph = self.graph
        graph.about("domain")
        margins = [
            self._whole(margin)
            for block in self._guarded()
            if (
                margin := inside(
                    graph,
                    function_block(block.function),
                    self._values[block.x],
                    sides.get(block.name),
                )
            )
        ]
        if not margins:
            return None
        least = margins[0] if len(margins) == 1 else graph.op("Min", *margins)
        least = graph.op("ReduceMin", least, graph.integers(0), keepdims=0)
        return graph.op("Greater", least, graph.number(0.0))

    def _guarded(self) -> list[Function]:
        functions = [b for b in self.network.cell.blocks if isinstance(b, Function)]
        return [block for block in functions if function_block(block.function).is_limited]

    def _block(self, block: Sum | Product | Function) -> str:
        if isinstance(block, Sum):
            return self._total(block.name)
        read = (block.a, block.b) if isinstance(block, Product) else (block.x,)
        rows = [self._values[name] for name in read]
        if isinstance(block, Product):
            found = self.graph.op("Mul", *rows)
        else:
            found = value(self.graph, block.function, *rows)
        return self._kept(found, *rows)

    def _total(self, target: str) -> str:
        """Return the weighted sum over the connections; weights 1 and -1 need no factor."""
        graph, total = self.graph, None
        for connection in self._arriving.get(target, ()):
            weight = np.asarray(connection.weight, float)
            is_bias, added = connection.source == ONE, "Add"
            row = graph.number(1.0) if is_bias else self._source(connection)
            if (weight == -1.0).all() and total is not None and not is_bias:
                added = "Sub"
            elif is_bias or not (weight == 1.0).all():
                factor = graph.table(f"weight.{connection.name}", weight.reshape(-1, 1))
                row = factor if is_bias else self._kept(graph.op("Mul", row, factor), row)
            both = (row,) if total is None else (total, row)
            total = row if total is None else self._kept(graph.op(added, *both), *both)
        return graph.number(0.0) if total is None else total

    def _source(self, connection: Connection) -> str:
        """Return the source of a connection, in the same cell or shifted from a neighbour."""
        graph, row, stages = self.graph, self._values[connection.source], self.network.stages
        if connection.template == Template.SELF:
            return row
        if abs(connection.template) > 1:
            return self._far(connection, self._whole(row))
        row, end = self._whole(row), graph.op("Expand", graph.number(0.0), self._shape(1))
        if connection.template == Template.NEXT:
            moved = graph.rows(row, 1, stages), end
        else:
            left = self.network.left_boundary.get(connection.source)
            end = end if left is None else graph.rows(self._inputs[left], 0, 1)
            moved = end, graph.rows(row, 0, stages - 1)
        return self._kept(graph.stacked(*moved) if stages > 1 else end, row)

    def _far(self, connection: Connection, row: str) -> str:
        """Shift the rows of a source beyond the neighbours with a matrix."""
        graph, offset, stages = self.graph, int(connection.template), self.network.stages
        shift = graph.table(f"cells.{connection.name}", np.eye(stages, k=offset))
        moved = graph.op("MatMul", shift, row)
        left = self.network.left_boundary.get(connection.source)
        if left is not None:
            first = (np.arange(stages) == -1 - offset).astype(float).reshape(-1, 1)
            fed = graph.rows(self._inputs[left], 0, 1)
            share = graph.table(f"left.{connection.name}", first)
            moved = graph.op("Add", moved, graph.op("Mul", share, fed))
        return self._kept(moved, row)

    def _kept(self, found: str, *of: str) -> str:
        """Return a tensor, registered as (N, B) if one of its operands is (N, B)."""
        if not self._full.isdisjoint(of):
            self._full.add(found)
        return found

    def _whole(self, row: str) -> str:
        """Expand a row to (N, B)."""
        if row not in self._full:
            row = self.graph.op("Expand", row, self._shape(self.network.stages))
            self._full.add(row)
        return row

    def _shape(self, rows: int) -> str:
        return self.graph.stacked(self.graph.integers(rows), self._batch)
