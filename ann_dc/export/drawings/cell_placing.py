"""Vertical placement of boxes and wires: each is placed close to its connections.

A wire that passes a column has a lane between the boxes of the column. The algorithm sweeps over
the columns in both directions. In each column, boxes and lanes are sorted by the positions of their
connections, then moved by the smallest distance that separates them.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ann_dc.export.drawings.cell_boxes import Box
from ann_dc.export.drawings.cell_columns import APART, MARGIN, Panel

PILL, LANE = 2.9, 0.9
"""Heights in mm."""
SWEEPS = 24
WIDEST = 40.0
"""Largest gap in mm between two columns."""


@dataclass(kw_only=True, eq=False)
class Item:
    """Box, or pill or lane of a node, in a column; all lengths are in mm.

    Wires of the nodes in ``ins`` end, and of those in ``outs`` begin, at distances from the top.
    """

    height: float
    gap: float
    ins: dict[str, list[float]] = field(default_factory=dict)
    outs: dict[str, list[float]] = field(default_factory=dict)
    box: Box | None = None
    node: str = ""
    top: float = 0.0


class Placed:
    """Placed items of a panel with a width in mm, by column; the first column has the pills."""

    def __init__(self, panel: Panel, width: float) -> None:
        self.panel, self.width = panel, width
        self.columns = [[_pill(node) for node in panel.pills]]
        self.columns += [[_boxed(box) for box in column] for column in panel.columns]
        self._add_lanes()
        self.height = max(_total(column) for column in self.columns)
        room = min(panel.room(width), WIDEST)
        starts = np.cumsum([MARGIN, *(width + room for width in panel.widths[:-1])])
        self.left = starts.tolist()
        for column in self.columns:
            self._settle(column, [0.0] * len(column))
        for sweep in range(SWEEPS):
            places = range(len(self.columns))
            for place in places if sweep % 2 else reversed(places):
                self._improve(place, sweep)

    def _add_lanes(self) -> None:
        first, last = {}, {}
        for place, column in enumerate(self.columns):
            for item in column:
                first |= {n: place for n in item.outs if n not in first}
                last |= dict.fromkeys(item.ins, place)
        for node, end in last.items():
            for place in range(first[node] + 1, end):
                middle = {node: [LANE / 2]}
                self.columns[place].append(
                    Item(height=LANE, gap=0.35, ins=middle, outs=dict(middle), node=node)
                )

    def wires(self) -> list[tuple[str, int, float, float]]:
        """Return wires as (node, source column, height at source, height at target)."""
        found = []
        for place in range(1, len(self.columns)):
            ends = _ports(self.columns[place - 1], "outs")
            for item in self.columns[place]:
                for node, offsets in item.ins.items():
                    start = ends[node][0]
                    found += [(node, place - 1, start, item.top + y) for y in offsets]
        return found

    def _improve(self, place: int, sweep: int) -> None:
        column = self.columns[place]
        before = _ports(self.columns[place - 1], "outs") if place else {}
        after = _ports(self.columns[place + 1], "ins") if place + 1 < len(self.columns) else {}
        if sweep < SWEEPS - 4:  # forth, of what comes; back, of what is read
            before, after = (before, {}) if sweep % 2 and place else ({}, after)
        wanted = [_pull(item, before, after) for item in column]
        groups: dict[str, list[float]] = defaultdict(list)
        for item, top in zip(column, wanted):
            groups[_group(item)].append(top + item.height / 2)
        means = {name: float(np.mean(tops)) for name, tops in groups.items()}
        if place:
            order = sorted(
                range(len(column)),
                key=lambda i: (
                    round(means[_group(column[i])], 6), _group(column[i]),
                    round(wanted[i] + column[i].height / 2, 6),
                ),
            )  # fmt: skip
            column[:] = [column[i] for i in order]
            wanted = [wanted[i] for i in order]
        self._settle(column, wanted)

    def _settle(self, column: list[Item], wanted: list[float]) -> None:
        """Set tops as close to the wanted tops as the order allows."""
        sizes = np.array([item.height + item.gap for item in column])
        before = np.cumsum(sizes) - sizes
        free = self.height - sizes.sum()
        moved = np.clip(_rising(np.array(wanted) - before), 0.0, max(free, 0.0))
        for item, top in zip(column, moved + before):
            item.top = float(top)


def _pill(node: str) -> Item:
    return Item(height=PILL, gap=0.6, outs={node: [PILL / 2]}, node=node)


def _boxed(box: Box) -> Item:
    item, top = Item(height=box.height, gap=APART, box=box), 0.0
    for row in box.rows:
        middle = top + row.height / 2
        if row.reads:
            item.ins.setdefault(row.reads, []).append(middle)
        if row.sends and not row.neighbour and box.kind != "neuron":
            item.outs.setdefault(row.sends, []).append(middle)
        top += row.height
    return item


def _group(item: Item) -> str:
    """Return the key of items that remain together: neurons of a population."""
    if item.box is None:
        return f"past {item.node}"
    return item.box.name if item.box.kind == "block" else item.box.name.partition(".")[0]


def _total(column: list[Item]) -> float:
    return sum(item.height + item.gap for item in column)


def _ports(column: list[Item], side: str) -> dict[str, list[float]]:
    found: dict[str, list[float]] = defaultdict(list)
    for item in column:
        for node, offsets in getattr(item, side).items():
            found[node] += [item.top + y for y in offsets]
    return found


def _pull(item: Item, before: Mapping, after: Mapping) -> float:
    """Return the top at which an item's wires would be horizontal on average."""
    pulls = [
        y - own
        for mine, theirs in ((item.ins, before), (item.outs, after))
        for node, offsets in mine.items()
        for own in offsets
        for y in theirs.get(node, ())
    ]
    return float(np.mean(pulls)) if pulls else item.top


def _rising(values: np.ndarray) -> np.ndarray:
    """Return the nearest nondecreasing values: decreasing neighbours get their mean."""
    runs: list[list[float]] = []
    for value in values:
        runs.append([float(value), 1])
        while len(runs) > 1 and runs[-2][0] > runs[-1][0]:
            mean, count = runs.pop()
            runs[-1] = [
                (runs[-1][0] * runs[-1][1] + mean * count) / (runs[-1][1] + count),
                runs[-1][1] + count,
            ]
    return np.repeat([mean for mean, _ in runs], [int(count) for _, count in runs])
