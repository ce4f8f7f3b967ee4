"""Cell diagram: every neuron and block with the terms of its sum, and the wires.

Signals run from left to right, from values of neurons to the integrators that produce them.
"""

from __future__ import annotations

import itertools

from ann_dc.export.drawings.cell_boxes import Box, CellBoxes
from ann_dc.export.drawings.cell_columns import MARGIN, lines_of, panels_of
from ann_dc.export.drawings.cell_placing import PILL, Item, Placed
from ann_dc.export.drawings.labels import MEANINGS, colours, shortened, tint
from ann_dc.export.drawings.page import (
    GREY,
    INK,
    LARGE,
    PALE,
    PLAIN,
    WIDTH,
    Page,
    Pen,
    text_width,
)
from ann_dc.network.cell import ONE, Function, Product, Sum
from ann_dc.network.network import Network

TOP, TITLE, BELOW, LINE = 13.0, 6.0, 5.0, 3.6
"""Distances in mm: above the panels, above each panel, below each panel; height of a legend line.
"""
MOST_TITLE = 60
"""Maximum number of characters of the network's title."""
STUB = 3.2
"""Length in mm of a wire from a neighbouring cell."""


def cell_page(network: Network) -> Page:
    """Draw the cell of a network."""
    drawn = CellBoxes(network)
    labels = {**drawn.short, ONE: "1"}
    for neuron in network.cell.neurons:
        labels[neuron.name] += " (shared)" * neuron.shared
    panels = panels_of(drawn.boxes, labels)
    lines = [[Placed(*given) for given in line] for line in lines_of(panels)]
    heights = [max(found.height for found in line) + TITLE + BELOW for line in lines]
    legend = _legend(drawn)
    page = Page(WIDTH, TOP + sum(heights) + LINE * len(legend) + 4)
    _headline(page, network)
    y, numbers = TOP, itertools.count(1)
    for line, height in zip(lines, heights):
        x = 0.0
        for found in line:
            title = f"({next(numbers)}) {found.panel.title}"
            _draw_panel(page, drawn, found, (x, y, height), title)
            x += found.width
        y += height
    _draw_legend(page, legend, y)
    return page


def _headline(page: Page, network: Network) -> None:
    cell = network.cell
    title = f"{shortened(network.title, MOST_TITLE)}: the cell of stage k"
    page.text((MARGIN, 4.5), title, size=LARGE, bold=True)
    counts = (
        (len(cell.neurons), "neuron"),
        (cell.count(Sum), "sum"),
        (cell.count(Product), "product"),
        (cell.count(Function), "function"),
        (len(cell.connections), "connection"),
    )
    said = ", ".join(f"{count} {noun}{'s' * (count != 1)}" for count, noun in counts if count)
    page.text((MARGIN, 9.5), f"One of {network.stages} equal cells; {said}.", size=PLAIN)


def _draw_panel(
    page: Page, drawn: CellBoxes, found: Placed, place_on: tuple[float, float, float], title: str
) -> None:
    """Draw a panel at (left, top, height)."""
    x, above, height = place_on
    top, frame = above + TITLE, Pen(color="#C8C8C8", width=0.5)
    page.box((x + 1, above + 0.5), (found.width - 2, height - 2), edge=frame, round_by=1.5)
    page.text((x + MARGIN, top - TITLE / 2), title, size=PLAIN, bold=True)
    left = [x + start for start in found.left]
    _draw_wires(page, drawn, found, left, top)
    page.above()
    for start, width, column in zip(left, found.panel.widths, found.columns):
        for item in column:
            corner = (start, top + item.top)
            if item.box is not None:
                _draw_box(page, item.box, corner, width, drawn)
            elif not item.ins:
                _draw_pill(page, item, corner, width, found.panel.pills[item.node], drawn)
    page.above()


def _draw_wires(page: Page, drawn: CellBoxes, found: Placed, left: list[float], top: float) -> None:
    """Draw wires between columns and past the boxes of a column."""
    widths = found.panel.widths
    for node, place, start, end in found.wires():
        ends = (left[place] + widths[place], top + start), (left[place + 1], top + end)
        page.wave(*ends, Pen(color=drawn.color[node], width=0.55))
    for start, width, column in zip(left, widths, found.columns):
        for item in column:
            if item.box is None and item.ins:
                height = top + item.top + item.height / 2
                across = [(start, height), (start + width, height)]
                page.line(across, Pen(color=drawn.color[item.node], width=0.55))


def _draw_pill(
    page: Page, item: Item, corner: tuple[float, float], width: float, words: str, drawn: CellBoxes
) -> None:
    color = drawn.color[item.node]
    page.box(corner, (width, PILL), face=tint(color, 0.25), edge=Pen(color=color), round_by=1.4)
    page.text((corner[0] + width / 2, corner[1] + PILL / 2), words, align="center")


def _draw_box(
    page: Page, box: Box, corner: tuple[float, float], width: float, drawn: CellBoxes
) -> None:
    x, y = corner
    page.box(corner, (width, box.height), edge=Pen(color=box.color, width=0.7))
    if box.shared:
        inner = (width + 0.9, box.height + 0.9)
        page.box((x - 0.45, y - 0.45), inner, face="none", edge=Pen(color=box.color, width=0.5))
    for row in box.rows:
        middle = y + row.height / 2
        if row.head:
            face = tint(box.color, 0.3 if box.kind == "neuron" else 0.16)
            page.box((x, y), (width, row.height), face=face, edge=Pen(color=box.color, width=0.7))
        page.text((x + 1.1, middle), row.text, bold=row.head)
        page.text((x + width - 1.1, middle), row.right, align="right")
        if row.reads:
            page.arrow((x, middle), color=drawn.color[row.reads])
        elif row.neighbour:
            _stub(page, (x, middle), width, row.neighbour, out=bool(row.sends))
        if row.sends and not row.neighbour:
            page.dot((x + width, middle), 0.4, face=drawn.color[row.sends], edge=Pen(width=0))
        y += row.height


def _stub(page: Page, at: tuple[float, float], width: float, way: int, *, out: bool) -> None:
    """Draw a wire from or to a neighbour: the previous cell left, the next cell right."""
    x, y = at
    edge = x if way < 0 else x + width
    end = edge + way * STUB
    page.line([(edge, y), (end, y)], Pen(color=INK, width=0.8))
    if out:
        page.arrow((end, y), color=INK, left=way < 0)
    else:
        page.arrow((edge, y), color=INK, left=way > 0)


Entry = tuple[str, str, str]
"""Kind of a symbol, its colour, and its meaning."""


def _legend(drawn: CellBoxes) -> list[list[Entry]]:
    """Return the meanings of the symbols, in lines that fit the page."""
    cell = drawn.network.cell
    roles = {neuron.population: neuron.role.value for neuron in cell.neurons}
    entries: list[Entry] = [
        ("neuron", color, f"{shortened(name, 20)}: {MEANINGS.get(name, roles[name] + ' neurons')}")
        for name, color in colours(cell).items()
    ]
    shared = any(neuron.shared for neuron in cell.neurons)
    signs: list[tuple[object, Entry]] = [
        (True, ("pill", GREY, "value of a neuron, or of a block above")),
        (True, ("words", "∫", "neuron: τ dx/ds = sum of its rows")),
        (cell.count(Sum), ("words", "Σ", "sum of its rows")),
        (cell.count(Product), ("words", "×", "product of its rows")),
        (True, ("stub", INK, "from or to cell k−1 (left), k+1 (right)")),
        (cell.duals, ("words", "PI", "multiplier m = μ + ρ c with τ dμ/ds = c, one amplifier")),
        (cell.inequality_duals, ("words", "diode", "multiplier that is never negative")),
        (cell.objectives, ("words", "share", "of an objective in the cost")),
        (
            shared,
            ("words", "shared", "shared by the whole array, in the last cell, read over a bus"),
        ),
    ]
    entries += [entry for there, entry in signs if there]
    lines: list[list[Entry]] = [[]]
    for entry in entries:
        if sum(map(_entry_width, [*lines[-1], entry])) > WIDTH - 2 * MARGIN:
            lines.append([])
        lines[-1].append(entry)
    return lines


def _symbol_width(entry: Entry) -> float:
    kind, sign, _ = entry
    return text_width(sign, bold=True) + 1.2 if kind == "words" else 6.2


def _entry_width(entry: Entry) -> float:
    return _symbol_width(entry) + text_width(entry[2]) + 4.5


def _draw_legend(page: Page, lines: list[list[Entry]], top: float) -> None:
    for number, line in enumerate(lines):
        x, y = MARGIN, top + LINE * (number + 0.5)
        for entry in line:
            _draw_entry(page, entry, x, y)
            x += _entry_width(entry)


def _draw_entry(page: Page, entry: Entry, x: float, y: float) -> None:
    kind, sign, words = entry
    if kind == "words":
        page.text((x, y), sign, bold=True)
    elif kind == "stub":
        page.line([(x, y), (x + 4.6, y)], Pen(color=INK, width=0.8))
        page.arrow((x + 5.0, y), color=INK)
    elif kind == "pill":
        page.box((x, y - 1.1), (5.0, 2.2), face=PALE, edge=Pen(color=sign), round_by=1.1)
    else:
        page.box((x, y - 1.1), (5.0, 2.2), face=tint(sign, 0.3), edge=Pen(color=sign, width=0.7))
    page.text((x + _symbol_width(entry), y), words)
