"""Columns and panels of a cell diagram: readers are right of the boxes they read.

The upper panel shows the residuals measured by the multiplier neurons, and the lower panel shows
the dynamics of all other neurons. A panel that would be too wide is split. Values that a panel
reads from neurons and from panels above are listed on its left.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ann_dc.export.drawings.cell_boxes import Box
from ann_dc.export.drawings.page import WIDTH, text_width

SPACE = 7.0
"""Smallest gap between columns in mm."""
COMFORT = 16.0
"""Gap in mm between columns of panels that are placed on one line."""
MARGIN = 6.0
"""Margin of a panel in mm, for wires of neighbouring cells."""
FILL = 1.4
"""Largest column height relative to the mean column height."""
TALL, FEW = 80.0, 3
"""Height in mm above which columns are split, if there are fewer columns than the second number."""
APART = 1.5
"""Gap in mm between boxes of a column."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Panel of a cell diagram: nodes that it reads with their labels, and boxes by column."""

    title: str
    pills: Mapping[str, str]
    columns: tuple[tuple[Box, ...], ...]

    @cached_property
    def widths(self) -> list[float]:
        """Widths of all columns in mm, beginning with the pills."""
        pills = max((text_width(label) for label in self.pills.values()), default=0.0) + 3.0
        return [pills, *(max(box.width for box in column) for column in self.columns)]

    def room(self, width: float = WIDTH) -> float:
        """Return the gap in mm between two columns of a panel with the given width."""
        return (width - 2 * MARGIN - sum(self.widths)) / (len(self.widths) - 1)

    @property
    def comfort(self) -> float:
        """Panel width in mm that leaves space for wires."""
        return 2 * MARGIN + sum(self.widths) + COMFORT * (len(self.widths) - 1)


def panels_of(boxes: Sequence[Box], labels: Mapping[str, str]) -> list[Panel]:
    """Arrange boxes in panels; the nodes that a panel reads are in the order of the labels."""
    maker = {node: box for box in boxes if box.kind != "neuron" for node in box.sends}
    reads = {box: [maker[n] for n in box.reads if n in maker and maker[n] is not box]
             for box in boxes}  # fmt: skip
    above = _ancestors([box for box in boxes if box.kind == "dual"], reads)
    parts = (
        ("constraint residuals of the multipliers", [box for box in boxes if box in above]),
        (
            "net inputs of the other neurons" if above else "net inputs of the neurons",
            [box for box in boxes if box not in above],
        ),
    )
    panels: list[Panel] = []
    for title, inside in parts:
        if inside:
            panels += _cut(title, _columns(inside, reads), labels)
    return panels


def lines_of(panels: Sequence[Panel]) -> list[list[tuple[Panel, float]]]:
    """Return the panels of each line with widths that fill the page."""
    lines: list[list[Panel]] = [[]]
    for panel in panels:
        if lines[-1] and sum(p.comfort for p in [*lines[-1], panel]) > WIDTH:
            lines.append([])
        lines[-1].append(panel)
    spare = [(WIDTH - sum(panel.comfort for panel in line)) / len(line) for line in lines]
    return [[(panel, panel.comfort + more) for panel in line] for line, more in zip(lines, spare)]


def _ancestors(boxes: Sequence[Box], reads: dict[Box, list[Box]]) -> set[Box]:
    """Return the boxes and all boxes that they read directly or indirectly."""
    found, waiting = set(), list(boxes)
    while waiting:
        box = waiting.pop()
        if box not in found:
            found.add(box)
            waiting += reads[box]
    return found


def _columns(boxes: list[Box], reads: dict[Box, list[Box]]) -> list[list[Box]]:
    """Place each box right of those that it reads, and unread boxes in columns with free height."""
    inside, depth = set(boxes), {}

    def depth_of(box: Box) -> int:
        if box not in depth:
            depth[box] = 1 + max((depth_of(b) for b in reads[box] if b in inside), default=-1)
        return depth[box]

    columns: list[list[Box]] = [[] for _ in range(1 + max(map(depth_of, boxes)))]
    read = {b for box in boxes for b in reads[box]}
    for box in boxes:
        if box in read:
            columns[depth[box]].append(box)
    last = [box for box in boxes if box not in read]
    while len(columns) < FEW and _height([*boxes]) / len(columns) > TALL:
        columns.append([])
    heights = [_height(column) for column in columns]
    aim = max(*heights, FILL * (sum(heights) + _height(last)) / len(columns), 0.0)
    last.sort(key=lambda b: -depth[b])  # stable: populations stay in their order
    for (start, _), group in itertools.groupby(last, lambda b: (depth[b], _population(b))):
        together = [*group]
        high = min(heights[start:]) + _height(together) > aim
        for run in [[box] for box in together] if high else [together]:
            fits = [c for c in range(start, len(columns)) if heights[c] + _height(run) <= aim]
            lowest = min(range(start, len(columns)), key=lambda c: heights[c])
            place = fits[-1] if fits else lowest
            columns[place] += run
            heights[place] += _height(run)
    return [column for column in columns if column]


def _population(box: Box) -> str:
    return box.name.partition(".")[0]


def _height(boxes: Sequence[Box]) -> float:
    return sum(box.height + APART for box in boxes)


def _cut(title: str, columns: list[list[Box]], labels: Mapping[str, str]) -> list[Panel]:
    """Split columns into the smallest number of panels that fit on a page."""
    panels: list[Panel] = []
    for count in range(1, len(columns) + 1):
        size = math.ceil(len(columns) / count)
        runs = [columns[i : i + size] for i in range(0, len(columns), size)]
        panels = [_panel(title, run, labels) for run in runs]
        if all(panel.room() >= SPACE for panel in panels):
            break
    return panels[:1] + [replace(panel, title=f"{title}, continued") for panel in panels[1:]]


def _panel(title: str, columns: list[list[Box]], labels: Mapping[str, str]) -> Panel:
    made = {n for column in columns for box in column if box.kind != "neuron" for n in box.sends}
    read = {n for column in columns for box in column for n in box.reads} - made
    pills = {node: label for node, label in labels.items() if node in read}
    return Panel(title=title, pills=pills, columns=tuple(map(tuple, columns)))
