"""Two-input multipliers of a cell: monomials split into pairs, most shared first.

A monomial of three factors needs two multipliers, and the choice of pairs is free. Repeated
selection of the pair that occurs in most monomials builds a common product of two signals only
once.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from ann_dc.synthesis.signals import Monomial, Signal, bare


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
