"""Code of the preconditioner: loops over its nodes, the same code for any N.

A node of a pyramid is a grid point with one number per chain. If a lane is a stage, the numbers are
one short vector, and a gain is a sum over its columns. If a lane is a sample, they are several
vectors, and a gain is one number each. A table gives their places among the net inputs. Pinned and
absent neurons read zero and write to an unused place.

A node of a stiffness is a neuron in two cells at once, equally far from the left and the right end
of the row. If a lane is a stage, the two are one vector, else two vectors. A number of the factor
is stored once and read twice, in the forward and the backward sweep. In a long row, memory access
to the tables dominates the time.

The sums are those of the loops in `preconditioner_arrays`, in the same order. The code looks up no
addresses and omits zeros, and an uncoupled chain stays in registers. Gains are data.

A stiffness preconditioner is M = T^{1/2} S^{-1} T^{1/2}. For a sample with T' = R T R and the same
S it is R M R: net inputs and derivatives are both scaled by the roots R.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import TypeAlias

from ann_dc.evaluation.codegen.plan import Axis, Plan, node_width
from ann_dc.evaluation.codegen.writer import Function, Module


def _add_scaling(
    f: Function, base: dict[str, str], rows: Sequence[int], neurons: int, source: str, target: str
) -> None:
    """Write ``target = roots source`` for some neurons of every cell (lane: sample).

    ``base`` contains the addresses of ``roots``, ``source`` and ``target`` (tables without ghosts)
    and of ``chunks``. ``rows`` are the scaled neurons of the P ``neurons`` of a cell.
    """
    with f.loop(base["chunks"]) as chunk:
        first = f.integer("mul", chunk, neurons * f.width)
        for row in rows:
            at = {n: f.address(base[n], first, row * f.width) for n in ("roots", source, target)}
            f.store(f.op("fmul", f.load(at["roots"]), f.load(at[source])), at[target])


Value: TypeAlias = str | None
"""Name of a vector; None for zero."""


class _StraightPyramid:
    """Writer of the contribution of a `straight` pyramid; a lane is a sample.

    ``base`` contains the addresses of ``drives``, ``gains`` and ``out``.
    """

    def __init__(self, f: Function, plan: Plan, base: dict[str, str]) -> None:
        self.f, self.plan, self.base = f, plan, base
        self.starts, self.hats, self.shares, self.places = plan.straight
        self.wide = plan.gain_columns

    def write(self) -> None:
        """Write coupled chains together, uncoupled chains one after the other."""
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
        """Write a known number times a value, plus another value."""
        if value is None or factor == 0.0:
            return to
        scale = self.f.constant(factor)
        return self.f.fma(scale, value, to) if to else self.f.op("fmul", scale, value)

    def _mean(self, a: Value, b: Value) -> Value:
        return a if a == b else self._scaled(0.5, self._sum(a, b), None)

    # ---- levels ----------------------------------------------------------------------------------

    def _at(self, name: str, chain: int, point: int) -> str | None:
        """Return the address of a neuron of the row; None if there is none."""
        neuron, stage = self.places[point][chain]
        row = stage * self.plan.neurons + neuron
        return self.f.address(self.base[name], row * self.f.width) if neuron >= 0 else None

    def _inner(self, level: int) -> list[tuple[int, tuple[int, int]]]:
        """Return the points of a level, each with its two neighbours on the next level."""
        first, following = self.starts[level : level + 2]
        return [
            (first + 1 + a, (following + 1 + a // 2, following + 1 + a // 2 + a % 2))
            for a in range(following - first - 2)
        ]

    def _down(self, chain: int, nodes: dict[int, Value]) -> None:
        """Write the restriction of the net inputs, the finest level first.

        Each coarser level is computed from the next finer level.
        """
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
        """Write the gains times net inputs, plus the rates of the coarser level."""
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
        """Write the interpolated rates of every neuron."""
        for p, (left, share) in enumerate(zip(self.hats, self.shares)):
            at = self._at("out", chain, p)
            rate = self._scaled(1.0 - share, nodes.get(left), None)
            rate = self._scaled(share, nodes.get(left + 1), rate)
            if at and rate:
                self.f.store(self.f.op("fadd", self.f.load(at), rate), at)


# ---- contribution of a preconditioner, as loops over its nodes: any N with the same code ---------

Node: TypeAlias = list[str]
"""Numbers of a node, one vector or several."""
Entries: TypeAlias = list[tuple[int, int, int]]
"""Entries of a matrix: row, column and index in the table."""


def add_preconditioner(
    module: Module, plan: Plan, fields: Callable[[Function], dict[str, str]]
) -> None:
    """Write ``preconditioner(table, out)``, which adds the coupling to derivatives ``out``.

    ``out`` contains the derivatives that every net input causes alone. ``fields`` loads `FIELDS`
    and ``drives`` from the table of addresses.
    """
    f = Function(module, "preconditioner", ("table", "out"), width=plan.axis.lanes)
    base = fields(f) | {"out": "%out"}
    if plan.straight:
        _StraightPyramid(f, plan, base).write()
    elif plan.chains:
        _Pyramid(f, plan, base).write()
    if plan.has_roots:
        scaling = f, base, plan.stiffness[0], plan.neurons
        _add_scaling(*scaling, "drives", "pushed")
        _Stiffness(f, plan, base | {"drives": base["pushed"]}).write()
        _add_scaling(*scaling, "out", "out")
    elif plan.has_stiffness:
        _Stiffness(f, plan, base).write()
    f.done()


class _Nodes:
    """Representation of the numbers of a grid point."""

    def __init__(self, f: Function, axis: Axis, count: int) -> None:
        self.f, self.axis, self.count = f, axis, count
        self.column = node_width(count)  # as wide as a matrix is stored
        self.width = self.column if axis is Axis.STAGES else f.width
        self.parts = 1 if axis is Axis.STAGES else count

    def zero(self) -> Node:
        return [self.f.constant(0.0, self.width)] * self.parts

    def _parts(self, base: str, node: str) -> list[str]:
        at = self.f.address(base, self.f.integer("mul", node, self.parts * self.width))
        return [self.f.address(at, part * self.width) for part in range(self.parts)]

    def load(self, base: str, node: str) -> Node:
        return [self.f.load(at, self.width) for at in self._parts(base, node)]

    def store(self, values: Node, base: str, node: str) -> None:
        for at, value in zip(self._parts(base, node), values):
            self.f.store(value, at, self.width)

    def _addresses(self, base: str, places: str, row: str) -> list[str]:
        f = self.f
        at = f.address(places, f.integer("mul", row, self.count))
        return [f.address(base, f.load_integer(f.address(at, i))) for i in range(self.count)]

    def gather(self, base: str, places: str, row: str) -> Node:
        """Load numbers from the addresses in a row of the table ``places``."""
        f, addresses = self.f, self._addresses(base, places, row)
        if self.axis is not Axis.STAGES:
            return [f.load(at) for at in addresses]
        (vector,) = self.zero()
        for lane, at in enumerate(addresses):
            vector = f.with_lane(vector, f.load(at, 1), lane, self.width)
        return [vector]

    def scatter(self, values: Node, base: str, places: str, row: str) -> None:
        """Add numbers to the values at the addresses in a row of the table ``places``."""
        f, width = self.f, None if self.axis is not Axis.STAGES else 1
        for i, at in enumerate(self._addresses(base, places, row)):
            value = f.lane(values[0], i, self.width) if width else values[i]
            f.store(f.op("fadd", f.load(at, width), value, width=width), at, width)

    def scaled(self, factor: str, node: Node, to: Node) -> Node:
        """Write a number times a node, plus another node."""
        spread = self.f.spread(factor, self.width)
        return [self.f.fma(spread, v, t, self.width) for v, t in zip(node, to)]

    def mean(self, a: Node, b: Node) -> Node:
        f, half = self.f, self.f.constant(0.5, self.width)
        added = [f.op("fadd", x, y, width=self.width) for x, y in zip(a, b)]
        return [f.op("fmul", half, x, width=self.width) for x in added]

    def stretched(self, base: str, row: str, node: Node, to: Node) -> Node:
        """Write ``to`` plus a diagonal of a table times a node."""
        f = self.f
        at = f.address(base, f.integer("mul", row, self.column))
        if self.axis is Axis.STAGES:
            return [f.fma(f.load(at, self.width), node[0], to[0], self.width)]
        gains = [f.spread(f.load(f.address(at, j), 1)) for j in range(self.count)]
        return [f.fma(*terms) for terms in zip(gains, node, to)]

    def multiplied(self, base: str, row: str, node: Node, to: Node) -> Node:
        """Write ``to`` plus a matrix of a table, stored by columns, times a node.

        Alternate columns go to two separate sums, which halves the latency of a sum.
        """
        f, wide = self.f, self.column
        at = f.address(base, f.integer("mul", row, self.count * wide))
        if self.axis is not Axis.STAGES:
            total = list(to)
            for i in range(self.count):
                for j in range(self.count):
                    weight = f.spread(f.load(f.address(at, i * wide + j), 1))
                    total[j] = f.fma(weight, node[i], total[j])
            return total
        sums = [to[0], f.constant(0.0, wide)]
        for i in range(self.count):
            spread = f.shuffle(node[0], "poison", [i] * wide, wide)
            column = f.load(f.address(at, i * wide), wide)
            sums[i % 2] = f.fma(column, spread, sums[i % 2], wide)
        return [f.op("fadd", *sums, width=wide)]


class _Pyramid:
    """Restriction of net inputs, rates of coarse neurons, and interpolation."""

    def __init__(self, f: Function, plan: Plan, base: dict[str, str]) -> None:
        self.f, self.base, self.coupled = f, base, plan.is_coupled
        self.nodes = _Nodes(f, plan.axis, plan.chains)
        self.G = base["nodes"]

    def write(self) -> None:
        """Write all levels, the finest first; each coarser level uses the next finer one."""
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
            nodes.scatter(rate, self.base["out"], self.base["places"], p)

    def _hat(self, p: str) -> tuple[str, str, str]:
        f = self.f
        left = f.load_integer(f.address(self.base["hats"], p))
        share = f.load(f.address(self.base["shares"], p), 1)
        return left, f.integer("add", left, 1), share

    def _level(self, level: str) -> tuple[str, str]:
        """Load the first points of a level and of the next level.

        An empty point precedes each level.
        """
        at = self.f.address(self.base["starts"], level)
        return self.f.load_integer(at), self.f.load_integer(self.f.address(at, 1))

    def _inner(self, first: str, following: str) -> str:
        """Compute the number of points of a level."""
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
        """Write gains times net inputs plus the coarser rates, from the coarsest level on."""
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
    """Solution of K K' z = d over the cells, from both ends to the middle and back.

    Two cells, one on either side, are processed at once, so that neither end waits for the other:
    y_t = K_t^{-1} (d_t - A_t y_{t-1}), then z_t = K_t'^{-1} (y_t - A_{t+1}' z_{t+1}). The y are
    stored among the derivatives until the backward sweep. The middle cell receives from both ends
    and belongs to both. In a product, numbers known last come last. See `TwoEnds`.
    """

    def __init__(self, f: Function, plan: Plan, base: dict[str, str]) -> None:
        self.f, self.base = f, base
        self.neurons, ahead = plan.stiffness
        size = range(len(self.neurons))
        entries = [*ahead, *((i, j) for i in size for j in range(i + 1))]
        self.row = 2 * len(entries)
        numbered = [(i, j, entry) for entry, (i, j) in enumerate(entries)]
        self.ahead, self.within = numbered[: len(ahead)], numbered[len(ahead) :][::-1]
        self.is_pair = plan.axis is Axis.STAGES  # both sides in a vector, else a vector each
        self.width = 2 if self.is_pair else f.width
        self.zero = [[f.constant(0.0, self.width)] * (1 if self.is_pair else 2) for _ in size]

    def write(self) -> None:
        f, middle = self.f, self.base["middle"]
        carried = [[f.slot(width=self.width) for _ in parts] for parts in self.zero]
        with f.loop(middle) as t:
            y = self._product(self.ahead, t, self._taken(carried), self._gather("drives", t))
            self._give(self._product(self.within, t, y, self.zero), t, carried)
        brought = self._product(self.ahead, middle, self._taken(carried), self.zero)
        y = self._sum(self._gather("drives", middle), brought, self._mirrored(brought))
        y = self._product(self.within, middle, y, self.zero)
        self._give(self._product(_transposed(self.within), middle, y, self.zero), middle, carried)
        with f.loop(middle) as number:
            nearer = f.integer("sub", middle, number)
            t = f.integer("sub", nearer, 1)
            z = self._gather("out", t)
            z = self._product(_transposed(self.ahead), nearer, self._taken(carried), z)
            self._give(self._product(_transposed(self.within), t, z, self.zero), t, carried)
        self._clear_gaps()

    def _clear_gaps(self) -> None:
        """Set derivatives at omitted neurons to zero, even if a net input is not a number."""
        f, width = self.f, 1 if self.is_pair else self.f.width
        with f.loop(self.base["gaps"]) as gap:
            place = f.load_integer(f.address(self.base["gap_places"], gap))
            f.store(f.constant(0.0, width), f.address(self.base["out"], place), width)

    # ---- numbers of a cell on either side ------------------------------------------------------

    def _product(self, matrix: Entries, t: str, v: list[Node], to: list[Node]) -> list[Node]:
        """Write a matrix of the table times ``v``, plus another vector."""
        f, total = self.f, list(to)
        row = f.address(self.base["factor"], f.integer("mul", t, self.row))
        for i, j, entry in matrix:
            at = f.address(row, 2 * entry)
            if self.is_pair:
                factors = [f.load(at, 2)]
            else:
                factors = [f.spread(f.load(f.address(at, side), 1)) for side in (0, 1)]
            terms = zip(factors, v[j], total[i])
            total[i] = [f.fma(*term, width=self.width) for term in terms]
        return total

    def _sum(self, *terms: list[Node]) -> list[Node]:
        def add(a: str, b: str) -> str:
            return self.f.op("fadd", a, b, width=self.width)

        return [[reduce(add, parts) for parts in zip(*nodes)] for nodes in zip(*terms)]

    def _mirrored(self, values: list[Node]) -> list[Node]:
        """Exchange the values of the two sides, in the order of the other side."""
        if self.is_pair:
            return [[self.f.shuffle(v, "poison", [1, 0], 2)] for (v,) in reversed(values)]
        return [node[::-1] for node in reversed(values)]

    def _taken(self, slots: list[Node]) -> list[Node]:
        return [[self.f.load(slot, self.width) for slot in node] for node in slots]

    # ---- where the cells lie -------------------------------------------------------------------

    def _places(self, name: str, t: str) -> list[tuple[str, str]]:
        """Return the addresses of every neuron on either side, in the order of that side."""
        f, at = self.f, self.f.address(self.base["places"], self.f.integer("mul", t, 2))
        cells = [f.load_integer(f.address(at, side)) for side in (0, 1)]
        left, right = (f.address(self.base[name], cell) for cell in cells)
        pairs = zip(self.neurons, reversed(self.neurons))
        return [(f.address(left, i * f.width), f.address(right, j * f.width)) for i, j in pairs]

    def _gather(self, name: str, t: str) -> list[Node]:
        f, places = self.f, self._places(name, t)
        if not self.is_pair:
            return [[f.load(left), f.load(right)] for left, right in places]
        lefts = [f.with_lane("poison", f.load(left, 1), 0, 2) for left, _ in places]
        return [[f.with_lane(v, f.load(right, 1), 1, 2)] for v, (_, right) in zip(lefts, places)]

    def _give(self, values: list[Node], t: str, carried: list[Node]) -> None:
        """Store the values among the derivatives and for the next cell."""
        f = self.f
        for node, slots, places in zip(values, carried, self._places("out", t)):
            for value, slot in zip(node, slots):
                f.store(value, slot, self.width)
            for side, at in enumerate(places):
                value = f.lane(node[0], side, 2) if self.is_pair else node[side]
                f.store(value, at, 1 if self.is_pair else None)


def _transposed(matrix: Entries) -> Entries:
    """Transpose a matrix; the columns known first come last."""
    return [(j, i, entry) for i, j, entry in reversed(matrix)]
