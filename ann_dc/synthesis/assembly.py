"""Conversion of a finished wiring to blocks in topological order and connections.

Only nodes that a neuron reads, directly or through blocks, are built. Multipliers are selected here
over all signals of the cell, so that a product of two signals is built once.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ann_dc.network.cell import ONE, Block, Connection, Function, Product, Sum
from ann_dc.synthesis.products import SharedProducts
from ann_dc.synthesis.signals import Signal, atoms
from ann_dc.synthesis.wiring import Wiring


def assemble(
    wiring: Wiring, drives: Mapping[str, Signal], wires: Iterable[Connection] = ()
) -> tuple[tuple[Block, ...], tuple[Connection, ...]]:
    """Return blocks in topological order and all connections.

    ``drives`` are the net inputs of the neurons from their cell. ``wires`` are connections made by
    the caller, to neighbours or with weights that differ by stage.
    """
    return _Assembly(wiring, drives, tuple(wires)).records()


class _Assembly:
    def __init__(
        self, wiring: Wiring, drives: Mapping[str, Signal], wires: tuple[Connection, ...]
    ) -> None:
        self.wiring, self.drives, self.wires = wiring, drives, wires
        self.wired = tuple(wire for wire in wires if wire.source != ONE)
        self.read = [*drives.values(), *(wiring.signal(wire.source) for wire in self.wired)]
        fed = [wiring.sums[atom] for atom in self._needed() if atom in wiring.sums]
        self.products = SharedProducts(wiring.names, [*drives.values(), *fed])

    def records(self) -> tuple[tuple[Block, ...], tuple[Connection, ...]]:
        wiring, names = self.wiring, self.wiring.names
        blocks, connections = [], []
        for atom in self._ordered():
            if atom in self.products.pairs:
                a, b = self.products.pairs[atom]
                blocks.append(Product(name=names[atom], a=names[a], b=names[b]))
            elif atom in wiring.functions:
                function, x = wiring.functions[atom]
                blocks.append(Function(name=names[atom], function=function, x=names[x]))
            elif atom in wiring.sums:
                blocks.append(Sum(name=names[atom]))
                connections += self._connections(names[atom], wiring.sums[atom])
        for target, signal in self.drives.items():
            connections += self._connections(target, signal)
        return tuple(blocks), (*connections, *self.wires)

    def _needed(self) -> list[int]:
        """Return every atom that is read, except products."""
        found: set[int] = set()
        stack = [a for signal in self.read for a in atoms(signal)]
        while stack:
            atom = stack.pop()
            if atom in found:
                continue
            found.add(atom)
            if atom in self.wiring.functions:
                stack.append(self.wiring.functions[atom][1])
            stack.extend(atoms(self.wiring.sums.get(atom, {})))
        return sorted(found)

    def _ordered(self) -> list[int]:
        """Return every atom that the signals need, operands first."""
        before: dict[str, list[int]] = {}
        for wire in self.wired:
            before.setdefault(wire.target, []).append(self.wiring.sources[wire.source])
        placed: dict[int, None] = {}

        def place(atom: int) -> None:
            if atom not in placed:
                is_sum = atom in self.wiring.sums
                wired = before.get(self.wiring.names[atom], []) if is_sum else []
                for operand in [*self._operands(atom), *wired]:
                    place(operand)
                placed[atom] = None

        for signal in self.read:
            for monomial in filter(None, signal):
                place(self.products.node(monomial))
        return list(placed)

    def _operands(self, atom: int) -> list[int]:
        if atom in self.products.pairs:
            return list(self.products.pairs[atom])
        if atom in self.wiring.functions:
            return [self.wiring.functions[atom][1]]
        return [self.products.node(m) for m in self.wiring.sums.get(atom, {}) if m]

    def _connections(self, target: str, signal: Signal) -> list[Connection]:
        names = self.wiring.names
        return [
            Connection(
                source=names[self.products.node(monomial)] if monomial else ONE,
                target=target,
                weight=weight,
            )
            for monomial, weight in signal.items()
        ]
