"""Evaluation of the tape in torch: one pass over the nodes.

Every node is a tensor (N, B). A neighbour's value is a shifted slice, and everything else is
elementwise. Nothing is written in place, so that a step can be differentiated.
"""

from __future__ import annotations

from collections import defaultdict
from typing import NamedTuple

import torch

from ann_dc.backends.layers.fixed_order import LIBRARY
from ann_dc.evaluation.reference import evaluator
from ann_dc.evaluation.tape import BY_VALUE, BY_WEIGHT, FUNCTION, PRODUCT, SUM
from ann_dc.network.cell import ONE
from ann_dc.network.functions import FUNCTIONS
from ann_dc.network.network import Network


class TorchTape(NamedTuple):
    """Tape as plain integers.

    Nodes are counted as on the tape: P neurons, the inputs, the constant one, then the blocks.
    """

    neurons: int  # number of neurons, P
    blocks: list[list[int]]
    """Kind, node, then (first, last) connection, (a, b) or (function code, x) of every block."""
    drives: list[list[int]]  # first and last connection of every neuron
    sources: list[list[int]]  # source node and template offset of every connection
    slots: list[list[int]]
    """Target slot, source slot, offset, kind and index of the factor of every operation."""
    left: dict[int, int]  # input row that stage 0 reads in place of its left neighbour, by node
    guarded: list[tuple[int, int, int]]
    """Tuples (block, code, node of the argument) of every function block with a limited domain."""

    @classmethod
    def of(cls, network: Network) -> TorchTape:
        """Return the tape of a network."""
        tape, nodes = evaluator(network).tape, network.node_index
        inputs = {name: row for row, name in enumerate(network.cell.inputs)}
        return cls(
            neurons=len(network.cell.neurons),
            blocks=tape.blocks.tolist(),
            drives=tape.drives.tolist(),
            sources=[[s, 0 if s == nodes[ONE] else offset] for s, offset in tape.sources.tolist()],
            slots=tape.slots.tolist(),
            left={nodes[node]: inputs[source] for node, source in network.left_boundary.items()},
            guarded=[
                (block, code, x)
                for block, (kind, _, code, x) in enumerate(tape.blocks.tolist())
                if kind == FUNCTION and FUNCTIONS[code].is_limited
            ],
        )

    def read(
        self, weights: torch.Tensor, inputs: torch.Tensor, state: torch.Tensor
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Return arguments of the guarded blocks and net inputs (P, N, B) of every neuron."""
        rows, drives = self.evaluate(weights, inputs, state)
        return [rows[x] for _, _, x in self.guarded], drives

    def evaluate(
        self, weights: torch.Tensor, inputs: torch.Tensor, state: torch.Tensor
    ) -> tuple[list[torch.Tensor], torch.Tensor]:
        """Return values of all nodes, (N, B) or (N, 1) each, and net inputs (P, N, B).

        The weights (E, N, 1) are in the order of the tape and the inputs (I, N, B) or (I, N, 1) in
        that of the cell. In the state (P, N, B), fixed neurons are at their inputs and omitted
        neurons at zero.
        """
        given = inputs.unbind(0) if len(inputs) else ()  # torch.export loads no unbind of nothing
        rows = [*state.unbind(0), *given, torch.ones_like(state[0, :, :1])]
        arriving = _Arriving(self, weights, inputs, rows)
        for kind, _, a, b in self.blocks:
            if kind == SUM:
                rows.append(arriving(a, b))
            elif kind == PRODUCT:
                rows.append(rows[a] * rows[b])
            else:
                rows.append(FUNCTIONS[a].value(rows[b], LIBRARY))
        drives = [arriving(first, last).expand_as(state[0]) for first, last in self.drives]
        return rows, torch.stack(drives)

    def derivatives(
        self, weights: torch.Tensor, inputs: torch.Tensor, state: torch.Tensor
    ) -> list[torch.Tensor]:
        """Return every slot of the tape: d node / d neuron, each (N, B) or (N, 1)."""
        rows, _ = self.evaluate(weights, inputs, state)
        one, none = torch.ones_like(state[0, :, :1]), torch.zeros_like(state[0, :, :1])
        slots: list[torch.Tensor] = [one] * self.neurons
        for target, source, offset, kind, index in self.slots:
            if kind == BY_WEIGHT:
                factor = weights[index]
            elif kind == BY_VALUE:
                factor = rows[index]
            else:
                _, node, code, x = self.blocks[index]
                factor = FUNCTIONS[code].slope(rows[x], rows[node], LIBRARY)
            added = factor * shifted(slots[source], offset)
            if target == len(slots):
                slots.append(none + added)
            else:
                slots[target] = slots[target] + added
        return slots

    @property
    def reach(self) -> int:
        """Largest cell distance on which a drive depends."""
        nodes: dict[int, int] = defaultdict(int)

        def of(first: int, last: int) -> int:
            reaches = [nodes[node] + abs(offset) for node, offset in self.sources[first:last]]
            return max(reaches, default=0)

        for kind, node, a, b in self.blocks:
            if kind == SUM:
                nodes[node] = of(a, b)
            else:
                nodes[node] = max(nodes[a], nodes[b]) if kind == PRODUCT else nodes[b]
        return max((of(first, last) for first, last in self.drives), default=0)


class _Arriving:
    """Sums of connection values; a neighbour's row is shifted once for all readers."""

    def __init__(self, tape: TorchTape, weights, inputs, rows: list[torch.Tensor]) -> None:
        self.tape, self.weights, self.inputs, self.rows = tape, weights, inputs, rows
        self.moved: dict[tuple[int, int], torch.Tensor] = {}

    def __call__(self, first: int, last: int) -> torch.Tensor:
        if first == last:
            return torch.zeros_like(self.rows[0])
        total = self.weights[first] * self._source(first)
        for edge in range(first + 1, last):
            total = torch.addcmul(total, self.weights[edge], self._source(edge))
        return total

    def _source(self, edge: int) -> torch.Tensor:
        node, offset = self.tape.sources[edge]
        if offset == 0:
            return self.rows[node]
        if (node, offset) not in self.moved:
            row = self.rows[node]
            left = self.tape.left.get(node)
            end = None if left is None else self.inputs[left][:1].expand_as(row[:1])
            self.moved[node, offset] = shifted(row, offset, end)
        return self.moved[node, offset]


def shifted(row: torch.Tensor, offset: int, left: torch.Tensor | None = None) -> torch.Tensor:
    """Return the row (N, B) of the cells at an offset: -1 is the previous, 1 the next.

    Values beyond the ends are zero; ``left`` (1, B) replaces the cell before the first.
    """
    if offset == 0:
        return row
    away = min(abs(offset), len(row))
    none = torch.zeros_like(row[:1]).expand(away, -1)
    if offset < 0:
        ends = none if left is None or away < -offset else torch.cat([none[1:], left])
        return torch.cat([ends, row[: len(row) - away]])
    return torch.cat([row[away:], none])
