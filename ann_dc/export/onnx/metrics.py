"""Metrics as ONNX operations: how drives become moves. Linear in the stages, whatever the kind.

All work on tensors (P N, B): neuron by neuron the stages, samples last. A grid and a tree are
solved by the same elimination (see `ann_dc.network.metrics`), level by level.
"""

from __future__ import annotations

import numpy as np

from ann_dc.export.onnx.graph import Graph
from ann_dc.network.metrics.elimination import Level, eliminate
from ann_dc.network.metrics.pyramid import Pyramid, hat_positions
from ann_dc.network.metrics.stiffness import Stiffness
from ann_dc.network.network import Network


def moves(network: Network, graph: Graph, drives: str) -> str:
    """M d (P N, B), zero where there is no neuron.

    Parameters
    ----------
    network : Network
    graph : Graph
    drives : str
        (P N, B), zero where there is no neuron.
    """
    own = graph.op("Mul", drives, rates(network, graph))
    if isinstance(network.metric, Pyramid):
        return graph.op("Add", own, _pyramid(network, network.metric, graph, drives))
    if isinstance(network.metric, Stiffness):
        return _stiffness(network, network.metric, graph, drives)
    return own


def rates(network: Network, graph: Graph) -> str:
    """(P N, 1): 1 / tau, zero where there is no neuron."""
    rows = []
    for number, neuron in enumerate(network.cell.neurons):
        tau = np.broadcast_to(np.asarray(neuron.tau, float), network.stages)
        tau = np.full(network.stages, tau[-1]) if neuron.shared else tau
        row = graph.op("Reciprocal", graph.table(f"tau.{neuron.name}", tau.reshape(-1, 1)))
        rows.append(where_there(network, graph, number, row))
    return graph.stacked(*rows)


def there(network: Network) -> np.ndarray:
    """(P, N) booleans: where neurons are; a shared one is everywhere if it is in the last cell."""
    live = network.live.copy()
    live[network.shared] = live[network.shared, -1:]
    return live


def where_there(network: Network, graph: Graph, number: int, row: str) -> str:
    """The row of a neuron, zero where it is pinned or absent.

    Parameters
    ----------
    network : Network
    graph : Graph
    number : int
        Of the neuron.
    row : str
        (N, B) or (N, 1).
    """
    live = there(network)[number]
    if live.all():
        return row
    name = f"there.{network.cell.neurons[number].name}"
    return graph.op("Where", graph.table(name, live[:, None], np.bool_), row, graph.number(0.0))


# ---- pyramid -------------------------------------------------------------------------------------


def _pyramid(network: Network, pyramid: Pyramid, graph: Graph, drives: str) -> str:
    """What the coordinators add (P N, B): down the hats, through the gains, and up again."""
    stages, chains = network.stages, pyramid.chains
    place = _chain_places(network)
    chain = graph.op("Gather", drives, graph.table("chain.places", place, np.int64), axis=0)
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
    """(2 N C,): places of q_0, t_0, q_1, ..., the C components of each together."""
    position = np.arange(2 * network.stages)
    rows = network.chain_rows[:, position % 2].T * network.stages + (position // 2)[:, None]
    return rows.ravel()


def _down(graph: Graph, chain: str, index: np.ndarray, share: np.ndarray) -> str:
    """What the points of the finest level hear (points, C B)."""
    total = None
    for rank, (heard, part) in enumerate(zip(*_hats(index, share))):
        row = graph.op("Gather", chain, graph.table(f"hat.{rank}.from", heard, np.int64), axis=0)
        row = graph.op("Mul", row, graph.table(f"hat.{rank}", part[:, None]))
        total = row if total is None else graph.op("Add", total, row)
    assert total is not None
    return total


def _hats(index: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(most, points) twice: which positions every point hears, and how much of each."""
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
    """The transpose of `_down`: (2 N, C B)."""
    sides = []
    for side, at, part in (("left", index, 1 - share), ("right", index + 1, share)):
        row = graph.op("Gather", answer, graph.table(f"hat.{side}.to", at, np.int64), axis=0)
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
    """M d: elimination for the primal neurons, time constants for the others."""
    row = network.row
    found = eliminate(stiffness, row)
    stage, neuron = np.divmod(np.flatnonzero(row.rates.T > 0), len(row.rates))
    component = found.component.ravel()
    places = (neuron * network.stages + stage)[component]
    roots = np.sqrt(row.rates.ravel()[places]) * (component >= 0)
    root = graph.table("stiffness.root", roots[:, None])
    pushed = graph.op("Gather", drives, graph.table("stiffness.places", places, np.int64), axis=0)
    blocks, size = found.component.shape
    pushed = graph.shaped(graph.op("Mul", pushed, root), blocks, size, -1)
    solved = graph.shaped(_solved(graph, found.levels, pushed, blocks), blocks * size, -1)
    solved = graph.op("Mul", solved, root)
    back = len(places) + np.arange(network.live.size)
    back[places[component >= 0]] = np.flatnonzero(component >= 0)
    others = graph.op("Mul", drives, rates(network, graph))
    both = graph.stacked(solved, others)
    return graph.op("Gather", both, graph.table("stiffness.back", back, np.int64), axis=0)


def _solved(graph: Graph, levels: tuple[Level, ...], rest: str, blocks: int) -> str:
    """`Elimination.solve`, of drives (blocks, b, B)."""
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
    """Drives of the blocks that remain: less what the eliminated ones beside them hand on."""
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
    """What is solved of the eliminated blocks: less what the remaining ones beside them say."""
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
    """One row of zeros."""
    return graph.op("Mul", graph.rows(tensor, 0, 1), graph.number(0.0))


def _woven(graph: Graph, first: str, second: str, count: int) -> str:
    """Rows of two tensors (R, b, B) in turn; the first may have one more at the end."""
    pairs = count // 2
    rows = graph.rows(first, 0, pairs), graph.rows(second, 0, pairs)
    shape = graph.op("Shape", first, start=1)
    beside = [graph.op("Unsqueeze", row, graph.integers(1)) for row in rows]
    woven = graph.op("Concat", *beside, axis=1)
    woven = graph.op("Reshape", woven, graph.stacked(graph.integers(-1), shape))
    last = [graph.rows(first, pairs, pairs + 1)] * (count % 2)
    return graph.stacked(woven, *last)
