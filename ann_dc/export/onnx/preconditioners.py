"""Preconditioners as ONNX operations: maps from net inputs to state derivatives.

The operations are linear in the number of stages for every kind. They use tensors (P N, B): stages
by neuron, samples last. A resistive grid and a cyclic reduction are solved by the same elimination
(see `ann_dc.network.preconditioners`), level by level.

If neurons that a preconditioner couples are saturated, a loop exchanges derivatives and currents in
the table (M_RR, (M d)_R) of the R neurons with limits, one neuron per turn. Neurons are fixed and
released in the rounds of `ann_dc.evaluation`.
"""

from __future__ import annotations

import numpy as np

from ann_dc.evaluation.rules import BLOCKS, PIVOTS, ROUNDING
from ann_dc.export.onnx.graph import Graph
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.elimination import Level, eliminate
from ann_dc.network.preconditioners.multilevel import Multilevel, hat_positions
from ann_dc.network.preconditioners.stiffness import Stiffness


def derivatives(network: Network, graph: Graph, drives: str) -> str:
    """Return M d (P N, B) for net inputs (P N, B), zero if a neuron does not exist."""
    own = graph.op("Mul", drives, rates(network, graph))
    if isinstance(network.preconditioner, Multilevel):
        return graph.op("Add", own, _pyramid(network, network.preconditioner, graph, drives))
    if isinstance(network.preconditioner, Stiffness):
        return _stiffness(network, network.preconditioner, graph, drives)
    return own


def rates(network: Network, graph: Graph) -> str:
    """Return 1 / tau (P N, 1), zero if a neuron does not exist."""
    rows = []
    for number, neuron in enumerate(network.cell.neurons):
        tau = np.broadcast_to(np.asarray(neuron.tau, float), network.stages)
        tau = np.full(network.stages, tau[-1]) if neuron.shared else tau
        row = graph.op("Reciprocal", graph.table(f"tau.{neuron.name}", tau.reshape(-1, 1)))
        rows.append(where_there(network, graph, number, row))
    return graph.stacked(*rows)


def there(network: Network) -> np.ndarray:
    """Return the existence of neurons (P, N); a shared neuron of the last cell is at all stages."""
    live = network.live.copy()
    live[network.shared] = live[network.shared, -1:]
    return live


def where_there(network: Network, graph: Graph, number: int, row: str) -> str:
    """Return the row of a neuron, (N, B) or (N, 1), zero if it is fixed or omitted."""
    live = there(network)[number]
    if live.all():
        return row
    name = f"there.{network.cell.neurons[number].name}"
    return graph.op("Where", graph.table(name, live[:, None], np.bool_), row, graph.number(0.0))


# ---- rails of coupled neurons --------------------------------------------------------------------


def clamped(
    graph: Graph, count: int, table: str, given: str, at_limits: tuple[str, str], batch: str
) -> tuple[str, str]:
    """Return saturated neurons, booleans (R, B), and their diode currents (R, B).

    ``count`` is the number R of neurons with limits. The table (R, R + 1, B) has the preconditioner
    of these neurons, and their derivatives without limits. ``given`` are the net inputs (R, B),
    ``at_limits`` booleans (R, B) for neurons at the lower and at the upper limit, and ``batch`` is
    the number of samples, as a shape (1,).
    """
    none = graph.op("Less", graph.op("Abs", given), graph.number(0.0))
    rounds = graph.op("Expand", graph.table("clamp.round", 0, np.int64), batch)
    carried = {"table": table, "held": none, "pending": none, "rounds": rounds}
    carried = {f"clamp {name}": start for name, start in carried.items()}
    body = Graph(graph.dtype, graph, own=["clamp turn", "clamp still", *carried])
    body.about("clamp")
    ends = _exchanged(body, count, given, *at_limits)
    body.name_outputs(ends)
    most = graph.table("clamp.turns", BLOCKS * count + PIVOTS, np.int64)
    found = graph.loop(body, most, carried, [*ends][:-1], [*ends][-1], "clamp ")
    currents = graph.op("Where", found[1], _last(graph, found[0], count), graph.number(0.0))
    return found[1], currents


def _last(graph: Graph, table: str, count: int) -> str:
    """Return the last column (R, B): currents of saturated, derivatives of free neurons."""
    return graph.op("Gather", table, graph.table("clamp.last", count, np.int64), axis=1)


def _exchanged(body: Graph, count: int, given: str, at_low: str, at_high: str) -> dict[str, str]:
    """Return the carried values after one turn of the loop, then its condition."""
    op, zero, one = body.op, body.number(0.0), body.table("one more", 1, np.int64)
    held, pending, rounds = "clamp held", "clamp pending", "clamp rounds"
    last = _last(body, "clamp table", count)
    sizes = op("Where", held, op("Add", op("Abs", given), op("Abs", last)), zero)
    slack = op("Mul", body.largest(sizes, 0), body.number(ROUNDING))
    found = op("Where", op("And", held, op("LessOrEqual", op("Abs", last), slack)), zero, last)
    wrong_low = op("And", at_low, op("Less", found, zero))
    wrong = op("Or", wrong_low, op("And", at_high, op("Greater", found, zero)))
    order = body.table("clamp.order", np.arange(count)[:, None], np.int64)
    final = body.largest(op("Where", wrong, order, body.table("clamp.before", -1, np.int64)), 0)
    early = op("Less", rounds, body.table("clamp.blocks", BLOCKS, np.int64))
    wrong = op("And", wrong, op("Or", early, op("Equal", order, final)))
    waits = _any(body, pending, 0)
    todo = op("Or", pending, op("And", wrong, op("Less", waits, one)))
    places = op("Where", todo, order, body.table("clamp.beyond", count, np.int64))
    here = op("Equal", order, op("ReduceMin", places, body.integers(0), keepdims=0))
    unit = op("Where", here, body.number(1.0), zero)
    return {
        "clamp next table": _pivoted(body, count, unit),
        "clamp next held": op("Xor", held, here),
        "clamp next pending": op("Xor", todo, here),
        "clamp next rounds": op("Add", rounds, op("Sub", one, waits)),
        "clamp going": op("Equal", _any(body, todo, 0, 1), one),
    }


def _any(graph: Graph, marks: str, *axes: int) -> str:
    """Return one if there is a mark along the given axes, which are removed, or zero."""
    from onnx import TensorProto

    counted = graph.op("Cast", marks, to=TensorProto.INT64)
    return graph.op("ReduceMax", counted, graph.integers(*axes), keepdims=0)


def _pivoted(body: Graph, count: int, unit: str) -> str:
    """Return the table after the neuron in ``unit`` (R, B) exchanged derivative and current."""
    op, one, table = body.op, body.number(1.0), "clamp table"
    rows, columns = body.integers(0), body.integers(1)
    across = body.stacked(unit, _none(body, unit))
    other, beside = op("Sub", one, unit), op("Sub", one, across)
    square = op("Slice", table, rows, body.integers(count), columns)
    column = op("ReduceSum", op("Mul", square, op("Unsqueeze", unit, rows)), columns, keepdims=0)
    row = op("ReduceSum", op("Mul", table, op("Unsqueeze", unit, columns)), rows, keepdims=0)
    pivot = op("ReduceSum", op("Mul", column, unit), rows, keepdims=0)
    pivot = op("Where", op("Equal", pivot, body.number(0.0)), one, pivot)  # a sample that is done
    down = op("Add", op("Mul", column, other), unit)
    along = op("Div", op("Sub", op("Mul", row, beside), across), pivot)
    kept = op("Mul", op("Unsqueeze", other, columns), op("Unsqueeze", beside, rows))
    outer = op("Mul", op("Unsqueeze", down, columns), op("Unsqueeze", along, rows))
    return op("Sub", op("Mul", table, kept), outer)


# ---- pyramid -------------------------------------------------------------------------------------


def _pyramid(network: Network, pyramid: Multilevel, graph: Graph, drives: str) -> str:
    """Return the coarse-level contribution (P N, B): restriction, gains, prolongation."""
    stages, chains = network.stages, pyramid.chains
    place = _chain_places(network)
    chain = graph.gathered(drives, "chain.places", place)
    index, share = hat_positions(2 * stages, len(pyramid.gains[0]) - 1)
    grid = _down(graph, graph.shaped(chain, 2 * stages, -1), index, share)
    grid = graph.shaped(grid, len(pyramid.gains[0]), chains, -1)
    answers = []
    for level, gain in enumerate(pyramid.gains):
        answers.append(graph.op("MatMul", graph.table(f"coordinator.{level}", gain), grid))
        if level < len(pyramid.gains) - 1:
            grid = _coarsened(graph, grid, len(gain))
    answer = answers.pop()
    for finer, gain in zip(reversed(answers), reversed(pyramid.gains[1:])):
        answer = graph.op("Add", finer, _refined(graph, answer, len(gain)))
    up = _up(graph, graph.shaped(answer, len(pyramid.gains[0]), -1), index, share)
    back = np.full(network.live.size, len(place))
    back[place] = np.arange(len(place))
    back[~network.live.ravel()] = len(place)
    up = graph.shaped(up, len(place), -1)
    places = graph.table("chain.back", back, np.int64)
    return graph.op("Gather", graph.stacked(up, _none(graph, drives)), places, axis=0)


def _chain_places(network: Network) -> np.ndarray:
    """Return indices (2 N C,) of q_0, t_0, q_1, ..., with the C components of each."""
    position = np.arange(2 * network.stages)
    rows = network.chain_rows[:, position % 2].T * network.stages + (position // 2)[:, None]
    return rows.ravel()


def _down(graph: Graph, chain: str, index: np.ndarray, share: np.ndarray) -> str:
    """Return the restriction to the points of the finest level (points, C B)."""
    total = None
    for rank, (heard, part) in enumerate(zip(*_hats(index, share))):
        row = graph.gathered(chain, f"hat.{rank}.from", heard)
        row = graph.op("Mul", row, graph.table(f"hat.{rank}", part[:, None]))
        total = row if total is None else graph.op("Add", total, row)
    assert total is not None
    return total


def _hats(index: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions and weights that every point receives, (most, points) each."""
    points, weights = np.concatenate([index, index + 1]), np.concatenate([1 - share, share])
    order = np.argsort(points, kind="stable")
    order = order[weights[order] != 0]
    point = points[order]
    rank = np.arange(len(point)) - np.searchsorted(point, point)
    shape = rank.max() + 1, points.max() + 1
    heard, parts = np.zeros(shape, np.int64), np.zeros(shape)
    heard[rank, point], parts[rank, point] = order % len(index), weights[order]
    return heard, parts


def _up(graph: Graph, answer: str, index: np.ndarray, share: np.ndarray) -> str:
    """Return the transpose of `_down`: (2 N, C B)."""
    sides = []
    for side, at, part in (("left", index, 1 - share), ("right", index + 1, share)):
        row = graph.gathered(answer, f"hat.{side}.to", at)
        sides.append(graph.op("Mul", row, graph.table(f"hat.{side}", part[:, None])))
    return graph.op("Add", *sides)


def _coarsened(graph: Graph, grid: str, points: int) -> str:
    between = graph.op("Mul", graph.rows(grid, 1, points, 2), graph.number(0.5))
    none = _none(graph, grid)
    kept = graph.op("Add", graph.rows(grid, 0, points, 2), graph.stacked(between, none))
    return graph.op("Add", kept, graph.stacked(none, between))


def _refined(graph: Graph, coarse: str, points: int) -> str:
    own, following = graph.rows(coarse, 0, points - 1), graph.rows(coarse, 1, points)
    between = graph.op("Mul", graph.op("Add", own, following), graph.number(0.5))
    return _woven(graph, coarse, between, 2 * points - 1)


# ---- grid and tree -------------------------------------------------------------------------------


def _stiffness(network: Network, stiffness: Stiffness, graph: Graph, drives: str) -> str:
    """Return M d: elimination for the primal neurons, time constants for the others."""
    row = network.layout
    found = eliminate(stiffness, row)
    stage, neuron = np.divmod(np.flatnonzero(row.rates.T > 0), len(row.rates))
    component = found.component.ravel()
    places = (neuron * network.stages + stage)[component]
    roots = np.sqrt(row.rates.ravel()[places]) * (component >= 0)
    root = graph.table("stiffness.root", roots[:, None])
    pushed = graph.gathered(drives, "stiffness.places", places)
    blocks, size = found.component.shape
    pushed = graph.shaped(graph.op("Mul", pushed, root), blocks, size, -1)
    solved = graph.shaped(_solved(graph, found.levels, pushed, blocks), blocks * size, -1)
    solved = graph.op("Mul", solved, root)
    back = len(places) + np.arange(network.live.size)
    back[places[component >= 0]] = np.flatnonzero(component >= 0)
    others = graph.op("Mul", drives, rates(network, graph))
    both = graph.stacked(solved, others)
    return graph.gathered(both, "stiffness.back", back)


def _solved(graph: Graph, levels: tuple[Level, ...], rest: str, blocks: int) -> str:
    """Return the result of `Elimination.solve` for net inputs (blocks, b, B)."""
    done, counts = [], []
    for number, level in enumerate(levels):
        ready, counts = graph.rows(rest, 0, blocks, 2), [*counts, blocks]
        done.append(_product(graph, f"stiffness.{number}.inverse", level.inverse, ready))
        if blocks > 1:
            rest = _handed_down(graph, number, level, ready, graph.rows(rest, 1, blocks, 2))
        blocks //= 2
    solved = done.pop()
    for number in reversed(range(len(done))):
        own = _handed_up(graph, number, levels[number], solved, done[number])
        solved = _woven(graph, own, solved, counts[number])
    return solved


def _handed_down(graph: Graph, number: int, level: Level, ready: str, rest: str) -> str:
    """Return the net inputs of the remaining blocks, less terms of the eliminated ones."""
    gone, left = len(level.inverse), len(level.left)
    before = graph.rows(ready, 0, left)
    rest = graph.op("Sub", rest, _product(graph, f"stiffness.{number}.left", level.left, before))
    if not len(level.right):
        return rest
    behind = graph.rows(ready, 1, gone)
    behind = _product(graph, f"stiffness.{number}.right", level.right, behind)
    missing = [_none(graph, rest)] * (left - len(level.right))
    return graph.op("Sub", rest, graph.stacked(behind, *missing))


def _handed_up(graph: Graph, number: int, level: Level, solved: str, own: str) -> str:
    """Return the solution of the eliminated blocks, less terms of the remaining ones."""
    name = f"stiffness.{number}"
    before = _product(graph, f"{name}.left.transposed", level.left.transpose(0, 2, 1), solved)
    missing = [_none(graph, solved)] * (len(level.inverse) - len(level.left))
    own = graph.op("Sub", own, graph.stacked(before, *missing))
    if not len(level.right):
        return own
    behind = graph.rows(solved, 0, len(level.right))
    right = level.right.transpose(0, 2, 1)
    behind = _product(graph, f"{name}.right.transposed", right, behind)
    return graph.op("Sub", own, graph.stacked(_none(graph, solved), behind))


def _product(graph: Graph, name: str, matrices: np.ndarray, vectors: str) -> str:
    return graph.op("MatMul", graph.table(name, matrices), vectors)


def _none(graph: Graph, tensor: str) -> str:
    """Return one row of zeros."""
    return graph.op("Mul", graph.rows(tensor, 0, 1), graph.number(0.0))


def _woven(graph: Graph, first: str, second: str, count: int) -> str:
    """Interleave the rows of two tensors (R, b, B); the first may have one more row."""
    pairs = count // 2
    rows = graph.rows(first, 0, pairs), graph.rows(second, 0, pairs)
    shape = graph.op("Shape", first, start=1)
    beside = [graph.op("Unsqueeze", row, graph.integers(1)) for row in rows]
    woven = graph.op("Concat", *beside, axis=1)
    woven = graph.op("Reshape", woven, graph.stacked(graph.integers(-1), shape))
    last = [graph.rows(first, pairs, pairs + 1)] * (count % 2)
    return graph.stacked(woven, *last)
