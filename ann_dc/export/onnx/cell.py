"""Cell as ONNX operations: outputs of its blocks and net inputs of its neurons.

A node of the cell is a tensor (N, B): stages, samples. The shape is (N, 1) or (1, 1) if the values
are equal for all samples or stages. The value of a neighbour is the same tensor, shifted by a
stage.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ann_dc.export.onnx.functions import inside, side_of_pole, value
from ann_dc.export.onnx.graph import Graph
from ann_dc.network.cell import ONE, Connection, Function, Product, Sum, Template
from ann_dc.network.functions import function_block
from ann_dc.network.network import Network


class CellReading:
    """Values of all nodes of a network at one state.

    Parameters
    ----------
    graph : Graph
        Graph to which the operations are written.
    neurons, inputs : sequence of str
        Rows (N, B), in the order of the cell.
    batch : str
        Number of samples, as a shape (1,).
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
        """Return booleans (B,): True if every function is inside its domain.

        Returns None if all functions always are. Argument ``sides`` is the result of `sides` at the
        start; without an entry, both sides of a pole are valid.
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
        row, end = self._whole(row), self._row_of_zeros()
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
        moved, left = (
            graph.op("MatMul", shift, row),
            self.network.left_boundary.get(connection.source),
        )
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

    def _row_of_zeros(self) -> str:
        return self.graph.op("Expand", self.graph.number(0.0), self._shape(1))

    def _shape(self, rows: int) -> str:
        return self.graph.stacked(self.graph.integers(rows), self._batch)
