"""Boxes of a cell diagram: one per neuron and block, and one for all nodes of a multiplier neuron.

A row of a box is a term of its sum, at which a wire ends, or describes a node, at which the wire of
that node begins.
"""

from __future__ import annotations

import graphlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ann_dc.export.drawings.labels import cell_at, node_colours, number, short_names, term
from ann_dc.export.drawings.page import text_width
from ann_dc.network.cell import ONE, Connection, Function, Neuron, Product, Sum
from ann_dc.network.network import Network

INSIDE = 1.1
"""Distance in mm between the edge of a box and its text."""
ROW, HEAD = 2.55, 3.0
"""Row heights in mm."""
BETWEEN = 2.0
"""Gap in mm between the left and right texts of a row."""
INTEGRAL = "∫\u00a0"
"""Integral sign with a space for its slant."""
LONGEST_LINE = 34.0
"""Largest width in mm of an equation in one row."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Row of a box, with texts on the left and on the right.

    The wire of node ``reads`` ends at the row, and that of ``sends`` begins there; ``neighbour`` is
    -1 or 1 if the previous or next cell is at the other end.
    """

    text: str
    right: str = ""
    head: bool = False
    reads: str = ""
    sends: str = ""
    neighbour: int = 0

    @property
    def height(self) -> float:
        """Height in mm."""
        return HEAD if self.head else ROW

    @property
    def width(self) -> float:
        """Width in mm."""
        right = text_width(self.right) + BETWEEN if self.right else 0.0
        return text_width(self.text, bold=self.head) + right + 2 * INSIDE


@dataclass(frozen=True, kw_only=True, eq=False)
class Box:
    """Box of a neuron or block."""

    name: str
    kind: Literal["neuron", "dual", "block"]
    color: str
    rows: tuple[Row, ...]
    shared: bool = False

    @property
    def width(self) -> float:
        """Width in mm."""
        return max(row.width for row in self.rows)

    @property
    def height(self) -> float:
        """Height in mm."""
        return sum(row.height for row in self.rows)

    @property
    def reads(self) -> list[str]:
        """Nodes whose wires end at the box."""
        return [row.reads for row in self.rows if row.reads]

    @property
    def sends(self) -> list[str]:
        """Nodes whose wires begin at the box."""
        return [row.sends for row in self.rows if row.sends]


class CellBoxes:
    """Boxes of a network's cell."""

    def __init__(self, network: Network) -> None:
        self.network = network
        self._cell = cell = network.cell
        self.short, self.color = short_names(cell), node_colours(cell)
        self._neurons = {neuron.name: neuron for neuron in cell.neurons}
        self._blocks = {block.name: block for block in cell.blocks}
        self._incoming: dict[str, list[Connection]] = defaultdict(list)
        for connection in cell.connections:
            self._incoming[connection.target].append(connection)
        self._readers = _readers(self._sources_of, [*self._blocks, *self._neurons])
        self._sent = {
            (c.source, -int(c.template)) for c in cell.connections if c.template and c.source != ONE
        }
        groups = self._groups()
        if not _is_ordered(groups, self._sources_of, self._neurons):
            groups = {name: name for name in groups}
        self._group = groups

    @cached_property
    def boxes(self) -> tuple[Box, ...]:
        """Boxes of multiplier neurons, then of other blocks, then of other neurons."""
        members: dict[str, list[str]] = defaultdict(list)
        for name, group in self._group.items():
            members[group].append(name)
        return tuple(self._box(name, nodes) for name, nodes in members.items())

    def _sources_of(self, name: str) -> list[str]:
        """Return the nodes of the same cell that a node reads."""
        block = self._blocks.get(name)
        if isinstance(block, Product):
            return [block.a, block.b]
        if isinstance(block, Function):
            return [block.x]
        return [c.source for c in self._incoming[name] if not c.template and c.source != ONE]

    def _groups(self) -> dict[str, str]:
        """Return the neuron of each node: its multiplier neuron, or the node itself."""
        cell = self._cell
        groups = {name: name for name in (*self._blocks, *self._neurons)}
        for dual in cell.duals:
            groups |= dict.fromkeys((dual.residual, dual.multiplier), dual.neuron)
        for row in (*cell.inequality_duals, *cell.objectives):
            groups |= dict.fromkeys(row.nodes, row.neuron)
        for name in self._blocks:  # what stands between two nodes of a multiplier is drawn there
            around = {groups.get(n, n) for n in (*self._sources_of(name), *self._readers[name])}
            if groups[name] == name and len(around) == 1 and around <= {*self._neurons}:
                (owner,) = around
                inside = [n for n, group in groups.items() if group == owner]
                if len(inside) > 1 and self._readers[name]:
                    groups[name] = owner
        return groups

    def _box(self, name: str, nodes: list[str]) -> Box:
        kind = "dual" if len(nodes) > 1 else "neuron" if name in self._neurons else "block"
        inside = set(nodes)
        rows: list[Row] = []
        if kind == "dual":
            neuron = self._neurons[name]
            rows.append(Row(text=self.short[name], right=self._about(neuron), head=True))
            for node in sorted(nodes, key=lambda n: n in self._neurons):
                rows += self._inner_rows(node, inside)
        else:
            rows += self._outer_rows(name)
        for node in nodes:
            rows += self._handed_on(node)
        return Box(
            name=name, kind=kind, color=self.color[name], rows=tuple(rows),
            shared=name in self._neurons and self._neurons[name].shared,
        )  # fmt: skip

    def _about(self, neuron: Neuron) -> str:
        """Return the kind of a multiplier neuron and its time constant as text."""
        diode = neuron.name in {row.neuron for row in self._cell.inequality_duals}
        kind = "diode" if diode else "PI"
        kind = "share" if neuron.name in {o.neuron for o in self._cell.objectives} else kind
        return f"{kind}, τ {number(neuron.tau)}"

    def _outer_rows(self, name: str) -> list[Row]:
        """Return the rows of a node with a separate box."""
        block, own = self._blocks.get(name), self.short[name]
        if isinstance(block, Product):
            head = Row(text=f"× {own}", head=True, sends=name)
            return [head, self._factor(block.a), self._factor(block.b)]
        if isinstance(block, Function):
            title = own if own.startswith(block.function) else f"{block.function}: {own}"
            return [Row(text=title, head=True, sends=name), self._factor(block.x)]
        if isinstance(block, Sum):
            return [Row(text=f"Σ {own}", head=True, sends=name), *self._terms(name)]
        neuron = self._neurons[name]
        rows = [Row(text=f"{INTEGRAL} {own}", right=f"τ {number(neuron.tau)}", head=True)]
        return [*rows, *self._terms(name), *_limits(neuron)]

    def _inner_rows(self, name: str, inside: set[str]) -> list[Row]:
        """Return the rows of a multiplier's node: one row if it has no outside source."""
        block, own = self._blocks.get(name), self.short[name]
        sends = name if not self._readers[name] <= inside else ""
        symbol = "Σ" if isinstance(block, Sum) else INTEGRAL if block is None else ""
        lead = f"{symbol} {own}".strip()
        if isinstance(block, (Product, Function)):
            read = " · ".join(self.short[n] for n in self._sources_of(name))
            formula = f"{block.function}({read})" if isinstance(block, Function) else read
            return [Row(text=f"{lead} ← {formula}", sends=sends)]
        wires = self._incoming[name]
        line = " ".join(term(c, self._said(c), not i) for i, c in enumerate(wires))
        near = all(not c.template and c.source in {*inside, ONE} for c in wires)
        if near and text_width(f"{lead} ← {line}") < LONGEST_LINE:
            return [Row(text=f"{lead} ← {line}", sends=sends), *_limits(self._neurons.get(name))]
        head = Row(text=f"{lead} ←", sends=sends)
        return [head, *self._terms(name, inside), *_limits(self._neurons.get(name))]

    def _said(self, connection: Connection) -> str:
        return self.short.get(connection.source, connection.source)

    def _factor(self, name: str) -> Row:
        return Row(text="1" if name == ONE else self.short[name], reads="" if name == ONE else name)

    def _terms(self, name: str, inside: Iterable[str] = ()) -> list[Row]:
        """Return one row for each term of a neuron or a sum."""
        rows = []
        for place, wire in enumerate(self._incoming[name]):
            said = term(wire, self._said(wire), not place)
            whose = f" of {cell_at(int(wire.template))}" if wire.template else ""
            alone = wire.template or wire.source in {*inside, ONE}
            rows.append(
                Row(
                    text=said + whose,
                    reads="" if alone else wire.source,
                    neighbour=int(np.sign(wire.template)),
                )
            )
        return rows

    def _handed_on(self, name: str) -> list[Row]:
        """Return the rows at which neighbouring cells read a node."""
        far = sorted(way for source, way in self._sent if source == name)
        return [
            Row(
                text=f"{self.short[name]} to {cell_at(way)}",
                sends=name,
                neighbour=int(np.sign(way)),
            )
            for way in far
        ]


def _limits(neuron: Neuron | None) -> list[Row]:
    low, high = (neuron.limiter.low, neuron.limiter.high) if neuron else (-np.inf, np.inf)
    words = {
        (True, True): f"rails {number(low)}, {number(high)}",
        (True, False): f"not below {number(low)}",
        (False, True): f"not above {number(high)}",
    }
    there = bool(np.isfinite(low)), bool(np.isfinite(high))
    return [Row(text=words[there])] if any(there) else []


def _readers(sources_of, names: Iterable[str]) -> Mapping[str, set[str]]:
    found: dict[str, set[str]] = defaultdict(set)
    for name in names:
        for source in sources_of(name):
            found[source].add(name)
    return found


def _is_ordered(groups: Mapping[str, str], sources_of, neurons: Mapping) -> bool:
    """Return True if no group depends on itself; neurons drawn alone are there from the start."""
    alone = {name for name in neurons if list(groups.values()).count(name) == 1}
    graph: dict[str, set[str]] = {group: set() for group in groups.values()}
    for name, group in groups.items():
        if group not in alone:
            read = {groups.get(source, source) for source in sources_of(name)}
            graph[group] |= read - alone - {group}
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError:
        return False
    return True
