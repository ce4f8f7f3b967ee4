"""Conversion of a finished wiring to blocks in topological order and connections.

Only nodes that a neuron reads, directly or through blocks, are built. Multipliers are selected here
over all signals of the cell, the pair of factors that occurs in most monomials first, so that a
common product of two signals is built once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping

from ann_dc.network.cell import ONE, Block, Connection, Function, Product, Sum
from ann_dc.synthesis.signals import Monomial, Signal, atoms, bare
from ann_dc.synthesis.wiring import Wiring


class SharedProducts:
    """Two-input multipliers for all monomials of a cell, the most shared pair first.

    ``names`` are those of the atoms, to which those of the products are appended; ``signals`` are
    all sums of the cell. ``pairs`` contains the two factors of every product.
    """

    def __init__(self, names: list[str], signals: Iterable[Signal]) -> None:
        self.names = names
        self.pairs: dict[int, tuple[int, int]] = {}
        self._nodes: dict[Monomial, int] = {}
        monomials = sorted({m for signal in signals for m in signal if len(m) > 1})
        current = {m: m for m in monomials}
        while any(len(m) > 1 for m in current.values()):
            pair = self._most_shared(current.values())
            node = self._multiplier(pair)
            current = {key: _replaced(m, pair, node) for key, m in current.items()}
        self._nodes = {key: m[0] for key, m in current.items()}

    @staticmethod
    def _most_shared(monomials: Iterable[Monomial]) -> tuple[int, int]:
        users: Counter[tuple[int, int]] = Counter()  # monomials that have the pair
        whole: Counter[tuple[int, int]] = Counter()  # ... and are nothing but the pair
        times: Counter[tuple[int, int]] = Counter()  # how often it occurs, powers counted
        for m in monomials:
            pairs = [(a, b) for i, a in enumerate(m) for b in m[i + 1 :]]
            users.update(set(pairs))
            times.update(pairs)
            if len(m) == 2:
                whole[m] += 1
        return max(users, key=lambda p: (users[p], whole[p], times[p], -p[0], -p[1]))

    def _multiplier(self, pair: tuple[int, int]) -> int:
        name = f"{bare(self.names[pair[0]])}*{bare(self.names[pair[1]])}"
        if len(name) > 40 or name.lower() in map(str.lower, self.names):
            name = f"product.{len(self.pairs)}"
        self.names.append(name)
        self.pairs[len(self.names) - 1] = pair
        return len(self.names) - 1

    def node(self, monomial: Monomial) -> int:
        """Return the node of a monomial: a source, or the product of its factors."""
        return monomial[0] if len(monomial) == 1 else self._nodes[monomial]


def _replaced(monomial: Monomial, pair: tuple[int, int], node: int) -> Monomial:
    rest = list(monomial)
    while all(rest.count(a) >= pair.count(a) for a in pair):
        for a in pair:
            rest.remove(a)
        rest.append(node)
    return tuple(sorted(rest))


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
