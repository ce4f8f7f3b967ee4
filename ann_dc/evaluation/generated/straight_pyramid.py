"""A pyramid over a short row, written out: every node is a value, and nothing lies in tables.

The sums are those of the loops in `metric_code`, in the same order; here no address is looked up,
zeros are left out, and a chain that no gain couples to others stays in registers. Gains are data.
"""

from __future__ import annotations

from typing import TypeAlias

from ann_dc.evaluation.generated.plan import Plan
from ann_dc.evaluation.vector_code.writer import Function

Value: TypeAlias = str | None
"""A vector; None where it is zero."""


class StraightPyramid:
    """Writes what a pyramid adds to the moves, for a lane that is a sample.

    Parameters
    ----------
    f : Function
    plan : Plan
        With a `straight` pyramid.
    base : dict of str to str
        Addresses of ``drives``, ``gains`` and ``out``.
    """

    def __init__(self, f: Function, plan: Plan, base: dict[str, str]) -> None:
        self.f, self.plan, self.base = f, plan, base
        self.starts, self.hats, self.shares, self.places = plan.straight
        self.wide = plan.gain_columns

    def write(self) -> None:
        """All of it: chains that are coupled at once, else one after the other."""
        every = list(range(self.plan.chains))
        for chains in [every] if self.plan.is_coupled else [[chain] for chain in every]:
            G = [dict[int, Value]() for _ in chains]
            for chain, nodes in zip(chains, G):
                self._down(chain, nodes)
            for level in range(len(self.starts) - 2, -1, -1):
                for point, above in self._inner(level):
                    self._gain(chains, G, point, above)
            for chain, nodes in zip(chains, G):
                self._up(chain, nodes)

    # ---- zeros are no instructions -------------------------------------------------------------

    def _sum(self, a: Value, b: Value) -> Value:
        return self.f.op("fadd", a, b) if a and b else a or b

    def _scaled(self, factor: float, value: Value, to: Value) -> Value:
        """A known number times a value, added to another."""
        if value is None or factor == 0.0:
            return to
        scale = self.f.constant(factor)
        return self.f.fma(scale, value, to) if to else self.f.op("fmul", scale, value)

    def _mean(self, a: Value, b: Value) -> Value:
        """Half of both."""
        return a if a == b else self._scaled(0.5, self._sum(a, b), None)

    # ---- levels ----------------------------------------------------------------------------------

    def _at(self, name: str, chain: int, point: int) -> str | None:
        """Address of a neuron of the row; None where there is none."""
        neuron, stage = self.places[point][chain]
        row = stage * self.plan.neurons + neuron
        return self.f.address(self.base[name], row * self.f.width) if neuron >= 0 else None

    def _inner(self, level: int) -> list[tuple[int, tuple[int, int]]]:
        """Points of a level, each with the two of the next that it lies between."""
        first, following = self.starts[level : level + 2]
        return [
            (first + 1 + a, (following + 1 + a // 2, following + 1 + a // 2 + a % 2))
            for a in range(following - first - 2)
        ]

    def _down(self, chain: int, nodes: dict[int, Value]) -> None:
        """Drives below every hat; the finest level is summed up first, each next from the last."""
        for p, (left, share) in enumerate(zip(self.hats, self.shares)):
            at = self._at("drives", chain, p)
            drive = self.f.load(at) if at else None
            nodes[left] = self._scaled(1.0 - share, drive, nodes.get(left))
            nodes[left + 1] = self._scaled(share, drive, nodes.get(left + 1))
        for level in range(1, len(self.starts) - 1):
            fine = self.starts[level - 1]
            for a, (point, _) in enumerate(self._inner(level)):
                below = fine + 2 * a + 1
                sides = self._mean(nodes.get(below - 1), nodes.get(below + 1))
                nodes[point] = self._sum(nodes.get(below), sides)

    def _gain(
        self, chains: list[int], G: list[dict[int, Value]], point: int, above: tuple[int, int]
    ) -> None:
        """Gains times drives, plus the rates of the coarser level."""
        drives = [nodes.get(point) for nodes in G]
        for chain, nodes in zip(chains, G):
            rate = self._mean(*(nodes.get(node) for node in above))
            for i, drive in enumerate(drives):
                if drive is not None:
                    gain = self._number(chains[i] if len(chains) > 1 else None, chain, point)
                    rate = self.f.fma(gain, drive, rate or self.f.constant(0.0))
            nodes[point] = rate

    def _number(self, column: int | None, chain: int, point: int) -> str:
        row = point if column is None else point * self.plan.chains + column
        at = self.f.address(self.base["gains"], row * self.wide + chain)
        return self.f.spread(self.f.load(at, 1))

    def _up(self, chain: int, nodes: dict[int, Value]) -> None:
        """Every neuron's part of the rates on either side."""
        for p, (left, share) in enumerate(zip(self.hats, self.shares)):
            at = self._at("out", chain, p)
            rate = self._scaled(1.0 - share, nodes.get(left), None)
            rate = self._scaled(share, nodes.get(left + 1), rate)
            if at and rate:
                self.f.store(self.f.op("fadd", self.f.load(at), rate), at)
