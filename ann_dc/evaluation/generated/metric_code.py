"""What a metric adds to the moves, as loops over its nodes: any N with the same code.

A node of a metric holds a few numbers: one a chain at a grid point of a pyramid, one a neuron in a
block of a stiffness. Where a lane is a stage they are one short vector, and a gain is a sum over
its columns; where a lane is a sample they are as many vectors, and a gain is a number each. A table
says where in the drives they lie; what is pinned or absent reads a zero and writes where nobody
looks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from ann_dc.evaluation.generated.metric_tables import node_width
from ann_dc.evaluation.generated.plan import Axis, Plan
from ann_dc.evaluation.generated.straight_pyramid import StraightPyramid
from ann_dc.evaluation.vector_code.writer import Function, Module

FIELDS = (
    "nodes",
    "places",
    "points",
    "hats",
    "shares",
    "levels",
    "starts",
    "gains",
    "middle",
    "factor",
)
"""What a metric reads and fills, in the order of the table of addresses: see `metric_tables`."""
INTEGERS = ("points", "levels", "middle")
"""Those that are numbers themselves."""

Node: TypeAlias = list[str]
"""The numbers of a node: one vector, or one for each of them."""


def add_metric(module: Module, plan: Plan, fields: Callable[[Function], dict[str, str]]) -> None:
    """Write ``metric(table, out)``: what it adds to the moves that every drive makes by itself.

    Parameters
    ----------
    module : Module
    plan : Plan
    fields : callable
        Loads `FIELDS` and ``drives`` from the table of addresses.
    """
    f = Function(module, "metric", ("table", "out"), width=plan.axis.lanes)
    base = fields(f) | {"out": "%out"}
    if plan.straight:
        StraightPyramid(f, plan, base).write()
    elif plan.chains:
        _Pyramid(f, plan, base).write()
    if plan.has_stiffness:
        _Stiffness(f, plan, base).write()
    f.done()


class _Nodes:
    """How the numbers of a node are held: ``halves`` times ``count`` of them."""

    def __init__(self, f: Function, axis: Axis, count: int, halves: int = 1) -> None:
        self.f, self.axis, self.count, self.halves = f, axis, count, halves
        self.column = node_width(count)  # as wide as a matrix is stored
        self.width = self.column if axis is Axis.STAGES else f.width
        self.parts = halves if axis is Axis.STAGES else halves * count

    def zero(self) -> Node:
        """Nothing."""
        return [self.f.constant(0.0, self.width)] * self.parts

    def _parts(self, base: str, node: str) -> list[str]:
        at = self.f.address(base, self.f.integer("mul", node, self.parts * self.width))
        return [self.f.address(at, part * self.width) for part in range(self.parts)]

    def load(self, base: str, node: str) -> Node:
        """From a table of nodes."""
        return [self.f.load(at, self.width) for at in self._parts(base, node)]

    def store(self, values: Node, base: str, node: str) -> None:
        """Into a table of nodes."""
        for at, value in zip(self._parts(base, node), values):
            self.f.store(value, at, self.width)

    def _addresses(self, base: str, places: str, row: str) -> list[str]:
        """Of every number, half by half."""
        f, every = self.f, self.halves * self.count
        at = f.address(places, f.integer("mul", row, every))
        return [f.address(base, f.load_integer(f.address(at, i))) for i in range(every)]

    def gather(self, base: str, places: str, row: str) -> Node:
        """From where a row of the table ``places`` says."""
        f, addresses = self.f, self._addresses(base, places, row)
        if self.axis is Axis.SAMPLES:
            return [f.load(at) for at in addresses]
        vectors = self.zero()
        for i, at in enumerate(addresses):
            part, lane = divmod(i, self.count)
            vectors[part] = f.with_lane(vectors[part], f.load(at, 1), lane, self.width)
        return vectors

    def scatter(self, values: Node, base: str, places: str, row: str, *, adds: bool) -> None:
        """To where a row of the table ``places`` says: added to what is there, or in its place."""
        f, width = self.f, None if self.axis is Axis.SAMPLES else 1
        for i, at in enumerate(self._addresses(base, places, row)):
            part, lane = divmod(i, self.count)
            value = f.lane(values[part], lane, self.width) if width else values[i]
            if adds:
                value = f.op("fadd", f.load(at, width), value, width=width)
            f.store(value, at, width)

    def scaled(self, factor: str, node: Node, to: Node) -> Node:
        """A number times a node, added to another."""
        spread = self.f.spread(factor, self.width)
        return [self.f.fma(spread, v, t, self.width) for v, t in zip(node, to)]

    def mean(self, a: Node, b: Node) -> Node:
        """Half of both."""
        f, half = self.f, self.f.constant(0.5, self.width)
        added = [f.op("fadd", x, y, width=self.width) for x, y in zip(a, b)]
        return [f.op("fmul", half, x, width=self.width) for x in added]

    def stretched(self, base: str, row: str, node: Node, to: Node) -> Node:
        """``to`` plus a diagonal of a table times a node."""
        f = self.f
        at = f.address(base, f.integer("mul", row, self.column))
        if self.axis is Axis.STAGES:
            return [f.fma(f.load(at, self.width), node[0], to[0], self.width)]
        gains = [f.spread(f.load(f.address(at, j), 1)) for j in range(self.count)]
        return [f.fma(*terms) for terms in zip(gains, node, to)]

    def multiplied(self, base: str, row: str, node: Node, to: Node) -> Node:
        """``to`` plus a matrix of a table times a node, each half with its own.

        A matrix is stored by its columns, both halves side by side. Every other column goes to a
        sum of its own, so that a sum waits half as long for its last term.
        """
        f, halves, wide = self.f, self.halves, self.column
        at = f.address(base, f.integer("mul", row, self.count * halves * wide))
        total = list(to)
        if self.axis is Axis.SAMPLES:
            for i in range(self.count):
                for part in range(self.parts):
                    half, j = divmod(part, self.count)
                    weight = f.spread(f.load(f.address(at, (i * halves + half) * wide + j), 1))
                    total[part] = f.fma(weight, node[half * self.count + i], total[part])
            return total
        for half in range(halves):
            sums = [to[half], f.constant(0.0, wide)]
            for i in range(self.count):
                spread = f.shuffle(node[half], "poison", [i] * wide, wide)
                column = f.load(f.address(at, (i * halves + half) * wide), wide)
                sums[i % 2] = f.fma(column, spread, sums[i % 2], wide)
            total[half] = f.op("fadd", *sums, width=wide)
        return total


class _Pyramid:
    """Drives below every hat, the rates of the coarse neurons, and the way back."""

    def __init__(self, f: Function, plan: Plan, base: dict[str, str]) -> None:
        self.f, self.base, self.coupled = f, base, plan.is_coupled
        self.nodes = _Nodes(f, plan.axis, plan.chains)
        self.G = base["nodes"]

    def write(self) -> None:
        """All of it; the finest level is summed up first, each next from the last."""
        f, nodes, G = self.f, self.nodes, self.G
        points, levels, starts = (self.base[name] for name in ("points", "levels", "starts"))
        with f.loop(f.load_integer(f.address(starts, 1))) as point:
            nodes.store(nodes.zero(), G, point)
        with f.loop(points) as p:
            drive = nodes.gather(self.base["drives"], self.base["places"], p)
            left, right, share = self._hat(p)
            rest = f.op("fsub", f.constant(1.0, 1), share, width=1)
            nodes.store(nodes.scaled(rest, drive, nodes.load(G, left)), G, left)
            nodes.store(nodes.scaled(share, drive, nodes.load(G, right)), G, right)
        with f.loop(levels, 1) as level:
            self._coarser(level)
        with f.loop(levels) as number:
            self._rates(number)
        with f.loop(points) as p:
            left, right, share = self._hat(p)
            rest = f.op("fsub", f.constant(1.0, 1), share, width=1)
            rate = nodes.scaled(rest, nodes.load(G, left), nodes.zero())
            rate = nodes.scaled(share, nodes.load(G, right), rate)
            nodes.scatter(rate, self.base["out"], self.base["places"], p, adds=True)

    def _hat(self, p: str) -> tuple[str, str, str]:
        f = self.f
        left = f.load_integer(f.address(self.base["hats"], p))
        share = f.load(f.address(self.base["shares"], p), 1)
        return left, f.integer("add", left, 1), share

    def _level(self, level: str) -> tuple[str, str]:
        """First point of a level and of the next; a point without a neuron stands before each."""
        at = self.f.address(self.base["starts"], level)
        return self.f.load_integer(at), self.f.load_integer(self.f.address(at, 1))

    def _inner(self, first: str, following: str) -> str:
        """Number of points of a level."""
        return self.f.integer("sub", self.f.integer("sub", following, first), 2)

    def _coarser(self, level: str) -> None:
        f, nodes, G = self.f, self.nodes, self.G
        fine, first = self._level(f.integer("sub", level, 1))
        _, following = self._level(level)
        nodes.store(nodes.zero(), G, first)
        nodes.store(nodes.zero(), G, f.integer("sub", following, 1))
        with f.loop(self._inner(first, following)) as a:
            below = f.integer("add", fine, f.integer("add", f.integer("mul", a, 2), 1))
            sides = nodes.mean(
                nodes.load(G, f.integer("sub", below, 1)), nodes.load(G, f.integer("add", below, 1))
            )
            total = nodes.scaled(f.constant(1.0, 1), nodes.load(G, below), sides)
            nodes.store(total, G, f.integer("add", f.integer("add", first, a), 1))

    def _rates(self, number: str) -> None:
        """Gains times drives, plus the rates of the coarser level; from the coarsest on."""
        f, nodes, G = self.f, self.nodes, self.G
        levels = self.base["levels"]
        level = f.integer("sub", f.integer("sub", levels, 1), number)
        first, following = self._level(level)
        with f.loop(self._inner(first, following)) as a:
            point = f.integer("add", f.integer("add", first, a), 1)
            above = f.integer("add", f.integer("add", following, f.integer("ashr", a, 1)), 1)
            other = f.integer("add", above, f.integer("and", a, 1))
            # beyond the coarsest level the table has zeros
            coarse = nodes.mean(nodes.load(G, above), nodes.load(G, other))
            nodes.store(self._gained(point, coarse), G, point)

    def _gained(self, point: str, to: Node) -> Node:
        apply = self.nodes.multiplied if self.coupled else self.nodes.stretched
        return apply(self.base["gains"], point, self.nodes.load(self.G, point), to)


class _Stiffness:
    """L D L' z = d over the cells, from both ends of the row to its middle and back.

    Two cells are dealt with at once, one on either side, so that neither end waits for the other.
    What a cell says to the next one stays in registers; what is found on the way to the middle
    lies among the moves until the way back.
    """

    def __init__(self, f: Function, plan: Plan, base: dict[str, str]) -> None:
        self.f, self.plan, self.base = f, plan, base
        self.neurons, self.below, self.ahead = plan.stiffness
        self.is_pair = plan.axis is Axis.STAGES  # both sides in a vector, else a vector each
        self.width, self.parts = (2, 1) if self.is_pair else (f.width, 2)
        known = [*(("ahead", *at) for at in self.ahead), *(("below", *at) for at in self.below)]
        self.entry = {name: i for i, name in enumerate(known)}

    def write(self) -> None:
        """All of it."""
        f, middle = self.f, self.base["middle"]
        carried = [self._slots() for _ in self.neurons]
        with f.loop(middle) as t:
            y = self._eliminated(t, self._brought(t, carried, self._gather("drives", t)))
            self._keep(y, carried)
            self._scatter(y, t)
        drives = self._gather("drives", middle)
        brought = self._both_ends(self._brought(middle, carried, [self._zero() for _ in drives]))
        y = [self._op("fadd", *both) for both in zip(drives, brought)]
        z = self._substituted(middle, self._scaled(middle, self._eliminated(middle, y)))
        self._keep(z, carried)
        self._scatter(z, middle)
        with f.loop(middle) as number:
            following = f.integer("sub", middle, number)
            t = f.integer("sub", following, 1)
            z = self._scaled(t, self._gather("out", t))
            z = self._substituted(t, self._returned(following, carried, z))
            self._keep(z, carried)
            self._scatter(z, t)

    # ---- numbers, on both sides ----------------------------------------------------------------

    def _zero(self) -> Node:
        return [self.f.constant(0.0, self.width)] * self.parts

    def _op(self, name: str, *values: Node) -> Node:
        return [self.f.op(name, *parts, width=self.width) for parts in zip(*values)]

    def _fma(self, *values: Node) -> Node:
        return [self.f.fma(*parts, width=self.width) for parts in zip(*values)]

    def _slots(self) -> Node:
        return [self.f.slot(width=self.width) for _ in range(self.parts)]

    def _keep(self, values: list[Node], slots: list[Node]) -> None:
        for node, places in zip(values, slots):
            for value, slot in zip(node, places):
                self.f.store(value, slot, self.width)

    def _taken(self, slots: Node) -> Node:
        return [self.f.load(slot, self.width) for slot in slots]

    def _number(self, t: str, entry: int) -> Node:
        """Of the table of factors."""
        f, row = self.f, 2 * (len(self.entry) + len(self.neurons))
        at = f.address(self.base["factor"], f.integer("mul", t, row), 2 * entry)
        if self.is_pair:
            return [f.load(at, 2)]
        return [f.spread(f.load(f.address(at, side), 1)) for side in (0, 1)]

    # ---- cells ---------------------------------------------------------------------------------

    def _cells(self, base: str, t: str) -> tuple[str, str]:
        """Addresses of the cells on either side in a table without ghosts."""
        f, twice = self.f, self.f.integer("mul", self.base["middle"], 2)
        left, right = (self._cell(base, stage) for stage in (t, f.integer("sub", twice, t)))
        return left, right

    def _cell(self, base: str, stage: str) -> str:
        f, chunk = self.f, self.plan.neurons * self.f.width
        if not self.is_pair:
            return f.address(base, f.integer("mul", stage, chunk))
        lane = f.integer("and", stage, f.width - 1)
        first = f.integer("mul", f.integer("sdiv", stage, f.width), chunk)
        return f.address(base, first, lane)

    def _rows(self, name: str, t: str) -> list[tuple[str, str]]:
        """Addresses of every neuron on either side, in the order there."""
        f, (left, right) = self.f, self._cells(self.base[name], t)
        pairs = zip(self.neurons, reversed(self.neurons))
        return [(f.address(left, i * f.width), f.address(right, j * f.width)) for i, j in pairs]

    def _gather(self, name: str, t: str) -> list[Node]:
        return [self._loaded(*at) for at in self._rows(name, t)]

    def _loaded(self, left: str, right: str) -> Node:
        f = self.f
        if not self.is_pair:
            return [f.load(left), f.load(right)]
        first = f.with_lane("poison", f.load(left, 1), 0, 2)
        return [f.with_lane(first, f.load(right, 1), 1, 2)]

    def _scatter(self, values: list[Node], t: str) -> None:
        f = self.f
        for node, places in zip(values, self._rows("out", t)):
            for side, at in enumerate(places):
                if self.is_pair:
                    f.store(f.lane(node[0], side, 2), at, 1)
                else:
                    f.store(node[side], at)

    # ---- the way there and back ----------------------------------------------------------------

    def _brought(self, t: str, carried: list[Node], to: list[Node]) -> list[Node]:
        """``to`` plus what the cell before says."""
        total = list(to)
        for i, j in self.ahead:
            number = self._number(t, self.entry["ahead", i, j])
            total[i] = self._fma(number, self._taken(carried[j]), total[i])
        return total

    def _eliminated(self, t: str, y: list[Node]) -> list[Node]:
        """Every neuron of a cell after those that come first."""
        y = list(y)
        for i, j in self.below:
            y[i] = self._fma(self._number(t, self.entry["below", i, j]), y[j], y[i])
        return y

    def _scaled(self, t: str, y: list[Node]) -> list[Node]:
        first = len(self.entry)
        return [self._op("fmul", self._number(t, first + i), v) for i, v in enumerate(y)]

    def _returned(self, following: str, carried: list[Node], to: list[Node]) -> list[Node]:
        """``to`` plus what the cell nearer to the middle says."""
        total = list(to)
        for i, j in reversed(self.ahead):
            number = self._number(following, self.entry["ahead", i, j])
            total[j] = self._fma(number, self._taken(carried[i]), total[j])
        return total

    def _substituted(self, t: str, z: list[Node]) -> list[Node]:
        """Every neuron of a cell after those that come later."""
        z = list(z)
        for i, j in reversed(self.below):
            z[j] = self._fma(self._number(t, self.entry["below", i, j]), z[i], z[j])
        return z

    def _both_ends(self, brought: list[Node]) -> list[Node]:
        """What came to the middle from either side, put together, in the order of either."""
        mirrored = [
            [self.f.shuffle(node[0], "poison", [1, 0], 2)] if self.is_pair else node[::-1]
            for node in reversed(brought)
        ]
        return [self._op("fadd", *both) for both in zip(brought, mirrored)]
