"""Cell-array diagram: cells, neighbour connections, boundaries and preconditioner."""

from __future__ import annotations

import itertools
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable

import numpy as np

from ann_dc.export.drawings.labels import colours, node_colours, shortened, tint
from ann_dc.export.drawings.page import (
    GREY,
    INK,
    LARGE,
    PLAIN,
    SMALL,
    WIDTH,
    Page,
    Pen,
    text_width,
)
from ann_dc.network.cell import ONE, Function, Product, Sum
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid
from ann_dc.si_prefixes import counted

SIDE, TOP = 6.0, 14.0
ROW = (38.0, 172.0)
"""Left and right ends of the cell array in mm."""
STRIP, ZOOM = 3.0, 9.0
"""Heights in mm of the cell array and of the zoom lines to the enlarged cells."""
BETWEEN, DOTS = 15.0, 8.0
"""Widths in mm of the gap between two cells and of the dots for omitted cells."""
LINE, HEAD = 3.5, 5.0
LONGEST = 300
"""Maximum number of measured characters; a longer text does not fit a page."""
MOST_WIRES = 16
"""Maximum number of neighbour wires that are drawn individually."""
COLOR = "#3A5E8C"
_PEN = Pen(color=COLOR, width=0.5)
FINEST = 1.4
"""Smallest distance in mm between nodes that are drawn individually; closer nodes become a band."""
LEVEL = 7.0
"""Height of a level in mm."""

Places = tuple[float, float]
"""Left and right ends of the cell array on a page in mm."""


def chain_page(network: Network) -> Page:
    """Draw the cell array of a network."""
    cells, wires = _cells(network), _wires(network)
    inside = max(len(cell) for _, cell in cells)
    tall = HEAD + LINE * max(inside + 1, len(wires)) + 2
    above, bus = _height_of(network), [n.name for n in network.cell.neurons if n.shared]
    height = TOP + above + STRIP + ZOOM + tall + (9 if bus else 0) + 5 + 3 * LINE
    page = Page(WIDTH, height)
    _headline(page, network)
    y = TOP + above + (3 if above else 0)
    _draw_preconditioner(page, network, ROW, y)
    _draw_strip(page, network, y)
    y += STRIP + ZOOM
    _draw_cells(page, network, cells, wires, (y, tall))
    y += tall
    if bus:
        _draw_bus(page, network, bus, y)
        y += 9
    _draw_legend(page, network, y + 4)
    return page


def _headline(page: Page, network: Network) -> None:
    row = network.layout
    wires = network.preconditioner.wires(row)
    title = f"{shortened(network.title, 60)}: array of {counted(network.stages, 'cells')}"
    page.text((SIDE, 4.5), title, size=LARGE, bold=True)
    said = f"{network.size} live neurons; preconditioner: {network.preconditioner.kind.value}"
    if wires.count:
        each = " each way" if wires.both_ways else ""
        said += f", {wires.nodes} nodes and {wires.count} wires{each}"
    page.text((SIDE, 9.5), said + ".", size=PLAIN)


Entry = tuple[str, str, bool]
"""Population, its text, and True if it is live."""


def _cells(network: Network) -> list[tuple[int, list[Entry]]]:
    """Return the enlarged stages and the entries of each."""
    last = network.stages - 1
    stages = range(last + 1) if last < 3 else (0, 1, last)
    return [(stage, _inside(network, stage)) for stage in stages]


def _inside(network: Network, stage: int) -> list[Entry]:
    pins = {(pin.neuron, pin.stage): pin.input for pin in network.fixed}
    absent = {(gone.neuron, gone.stage) for gone in network.omitted}
    groups: dict[tuple[str, str], list[str]] = defaultdict(list)
    for neuron in network.cell.neurons:
        place, part = (neuron.name, stage), neuron.component or neuron.name
        if neuron.shared:
            continue
        if place in pins:
            groups[neuron.population, "fixed at"].append(pins[place])
        elif place in absent:
            groups[neuron.population, "absent"].append(part)
        else:
            groups[neuron.population, ""].append(part)
    found = []
    for (population, state), parts in groups.items():
        found.append((population, _said(population, state, parts), not state))
    if stage == 0:
        found += [
            ("", f"left boundary: {n} = {i}", False) for n, i in network.left_boundary.items()
        ]
    return found


def _said(population: str, state: str, parts: list[str]) -> str:
    heads = {part.partition(".")[0] for part in parts}
    if state == "fixed at" and len(heads) == 1 and all("." in part for part in parts):
        ends = ", ".join(part.partition(".")[2] for part in parts)
        return f"{population} fixed at {heads.pop()}: {ends}"
    return f"{population} {state}".strip() + (" " if state else ": ") + ", ".join(parts)


def _wires(network: Network) -> list[tuple[str, str, int]]:
    """Return node, colour and direction of each wire: 1 to the next cell, else -1."""
    colors, sent = node_colours(network.cell), {}
    for connection in network.cell.connections:
        if connection.template and connection.source != ONE:
            sent[connection.source, -int(connection.template)] = colors[connection.source]
    wires = [(name, color, way) for (name, way), color in sent.items()]
    wires.sort(key=lambda wire: (-wire[2], network.node_index[wire[0]]))
    if len(wires) > MOST_WIRES:
        rest = len(wires) - MOST_WIRES + 1
        wires = [*wires[: MOST_WIRES - 1], (f"and {rest} more", INK, 0)]
    return wires


def _draw_strip(page: Page, network: Network, top: float) -> None:
    count, (start, end) = network.stages, ROW
    step = (end - start) / count
    page.text((start - 3, top + STRIP / 2), f"cells 0…{count - 1}", align="right")
    page.box((start, top), (end - start, STRIP), face="#EFEFEF", edge=Pen(width=0.5), round_by=0.3)
    if step > 0.8:
        for number in range(1, count):
            x = start + step * number
            page.line([(x, top), (x, top + STRIP)], Pen(width=0.4))


def _slots(network: Network, count: int) -> tuple[list[float], float]:
    """Return the left edges of the enlarged cells and their width."""
    dots = DOTS + BETWEEN if count < network.stages else 0.0
    wide = min((WIDTH - 2 * SIDE - BETWEEN * (count - 1) - dots) / count, 60.0)
    edges = [SIDE + (wide + BETWEEN) * place for place in range(count)]
    return [*edges[:-1], edges[-1] + dots], wide


def _draw_cells(
    page: Page, network: Network, cells: list, wires: list, at: tuple[float, float]
) -> None:
    top, tall = at
    edges, wide = _slots(network, len(cells))
    step = (ROW[1] - ROW[0]) / network.stages
    for (stage, entries), x in zip(cells, edges):
        dash = Pen(color=GREY, width=0.4, style=(0, (2, 2)))
        for corner, end in ((x, stage), (x + wide, stage + 1)):
            page.line([(corner, top), (ROW[0] + step * end, top - ZOOM)], dash)
        page.box((x, top), (wide, tall), edge=Pen(width=0.8), round_by=1.2)
        page.text((x + wide / 2, top + HEAD / 2), f"cell {stage}", bold=True, align="center")
        _draw_entries(page, network, entries, (x, top + HEAD), wide)
    gaps = list(zip([x + wide for x in edges[:-1]], edges[1:]))
    if len(cells) < network.stages:  # dots between the last two
        left, right = gaps.pop()
        gaps += [(left, left + BETWEEN), (right - BETWEEN, right)]
        page.text(((left + right) / 2, top + tall / 2), "· · ·", size=LARGE, align="center")
    for left, right in gaps:
        _draw_wires(page, wires, (left, right), top + HEAD)


def _draw_entries(
    page: Page, network: Network, entries: list[Entry], corner: tuple[float, float], wide: float
) -> None:
    palette, (x, y) = colours(network.cell), corner
    for population, words, alive in entries:
        color = palette.get(population, GREY)
        style, face = ("-", tint(color, 0.22)) if alive else ((0, (2, 1.2)), "white")
        edge = Pen(color=color, style=style)
        page.box((x + 1.2, y + 0.25), (wide - 2.4, LINE - 0.5), face=face, edge=edge)
        page.text((x + 2.2, y + LINE / 2), fitted(words, wide - 4.4))
        y += LINE
    cell = network.cell
    counts = ((cell.count(Sum), "sums"), (cell.count(Product), "products"),
              (cell.count(Function), "functions"))  # fmt: skip
    said = ", ".join(f"{count} {noun}" for count, noun in counts if count)
    page.text((x + wide / 2, y + LINE / 2), fitted(said, wide - 2), align="center")


def fitted(words: str, width: float) -> str:
    """Truncate a text to a width in mm."""
    plain = shortened(words, LONGEST)
    if text_width(plain) <= width:
        return plain
    wide = lambda length: text_width(shortened(plain, length))  # noqa: E731
    return shortened(plain, 1 + bisect_right(range(2, len(plain)), width, key=wide))


def _draw_wires(page: Page, wires: list, gap: tuple[float, float], top: float) -> None:
    left, right = gap
    for place, (name, color, way) in enumerate(wires):
        y = top + LINE * (place + 0.5)
        words = fitted(name, right - left - 3)
        page.text(((left + right) / 2, y - 0.55), words, align="center")
        if way:
            page.line([(left, y + 1.0), (right, y + 1.0)], Pen(color=color, width=0.7))
            page.arrow((right if way > 0 else left, y + 1.0), color=color, left=way < 0)


def _draw_bus(page: Page, network: Network, names: list[str], top: float) -> None:
    """Draw the shared neurons in the last cell, and the bus to all cells."""
    words = fitted(f"shared by all cells, in the last one: {', '.join(names)}", WIDTH - 4 * SIDE)
    y = top + 4.5
    page.line([(SIDE, y), (WIDTH - SIDE, y)], Pen(width=1.2))
    edges, wide = _slots(network, min(network.stages, 3))
    for x in edges:
        page.line([(x + wide / 2, top), (x + wide / 2, y)], Pen(width=0.7))
    page.text((SIDE + 2, y + 2.4), words)


def _draw_legend(page: Page, network: Network, top: float) -> None:
    signs = (
        ("-", tint(GREY, 0.22), "live neurons of a population"),
        ((0, (2, 1.2)), "white", "fixed at an input, or not there"),
    )
    x = SIDE
    for style, face, words in signs:
        page.box((x, top - 1.1), (5, 2.2), face=face, edge=Pen(color=GREY, style=style))
        page.text((x + 6.2, top), words)
        x += 10.7 + text_width(words)
    page.line([(x, top), (x + 5, top)], Pen(width=0.7))
    page.arrow((x + 5, top), color=INK)
    page.text((x + 6.2, top), "wire to a neighbour, with the transmitted quantity")
    if _height_of(network):
        words = (
            "Top: coarse-level neurons sum the net inputs of the neurons below and drive these "
            "neurons."
        )
        page.text((SIDE, top + LINE), words, size=SMALL)


# ---- preconditioner ------------------------------------------------------------------------


def _height_of(network: Network) -> float:
    """Return the height in mm that the preconditioner needs above the cell array."""
    return LEVEL * len(_levels(network))


def _draw_preconditioner(page: Page, network: Network, row: Places, bottom: float) -> None:
    """Draw the preconditioner level by level, with the level next to the cells lowest."""
    for place, (words, draw) in enumerate(_levels(network)):
        base = bottom - LEVEL * place
        page.text((row[0] - 3, base - LEVEL / 2), words, align="right")
        draw(page, row, base)


Level = tuple[str, Callable[[Page, Places, float], None]]


def _levels(network: Network) -> list[Level]:
    preconditioner = network.preconditioner
    if isinstance(preconditioner, Multilevel):
        return [_hats(gain) for gain in preconditioner.gains]
    if isinstance(preconditioner, ResistiveGrid):
        return [("resistors to neighbours", _resistors(network.stages))]
    if isinstance(preconditioner, CyclicReduction):
        blocks = len(preconditioner.elimination(network.layout).component)
        return _branches(blocks)
    return []


def _hats(gain: np.ndarray) -> Level:
    active = np.flatnonzero(np.abs(gain).sum(axis=(1, 2)) > 0)
    intervals = len(gain) - 1

    def draw(page: Page, row: Places, base: float) -> None:
        start, step = row[0], (row[1] - row[0]) / intervals
        foot, top = base - 1.2, base - LEVEL + 1.8
        if step < FINEST:
            return _band(page, row, foot, top)
        for point in active:
            x = start + step * point
            ends = max(x - step, row[0]), min(x + step, row[1])
            page.line([(ends[0], foot), (x, top), (ends[1], foot)], _PEN)
        page.above()
        for point in active:
            page.dot((start + step * point, top), 0.65, face=tint(COLOR, 0.4), edge=_PEN)
        return None

    count = int((np.abs(gain).sum(axis=-1) > 0).sum())
    return f"{count} nodes, {intervals} intervals", draw


def _resistors(stages: int) -> Callable[[Page, Places, float], None]:
    def draw(page: Page, row: Places, base: float) -> None:
        step, y = (row[1] - row[0]) / stages, base - LEVEL / 2
        if step < 2 * FINEST:
            return _band(page, row, y + 1, y - 1)
        centres = row[0] + step * (np.arange(stages) + 0.5)
        for left, right in itertools.pairwise(centres):
            along = np.linspace(left + 0.25 * step, right - 0.25 * step, 8)
            teeth = [(float(x), y + 0.8 * (i % 2 * 2 - 1)) for i, x in enumerate(along[1:-1])]
            page.line([(left, y), (float(along[0]), y), *teeth, (float(along[-1]), y), (right, y)],
                      _PEN)  # fmt: skip
        page.above()
        for x in centres:
            page.line([(x, y), (x, base)], _PEN)
            page.dot((float(x), y), 0.5, face=tint(COLOR, 0.4), edge=_PEN)
        return None

    return draw


def _branches(blocks: int) -> list[Level]:
    """Return one tree level per halving of the cell array."""
    levels, places = [], np.arange(blocks)
    while len(places) > 1:
        levels.append(_halving(places, blocks))
        places = places[1::2]
    return levels


def _halving(places: np.ndarray, blocks: int) -> Level:
    def draw(page: Page, row: Places, base: float) -> None:
        step = (row[1] - row[0]) / blocks
        foot, top = base - 0.6, base - LEVEL + 0.6
        if step * (places[1] - places[0]) < FINEST:
            return _band(page, row, foot - 0.6, top + 1.2)
        at = [row[0] + step * (float(place) + 0.5) for place in places]
        for kept in range(1, len(at), 2):
            for gone in (kept - 1, kept + 1):
                if gone < len(at):
                    page.line([(at[gone], foot), (at[kept], top)], _PEN)
            page.line([(at[kept], foot), (at[kept], top)], Pen(color=GREY, width=0.4))
        page.above()
        for place, x in enumerate(at):
            face = tint(COLOR, 0.4) if place % 2 else "white"
            page.dot((x, foot), 0.55, face=face, edge=_PEN)
        return None

    kept = len(places) // 2
    return f"{len(places)} blocks, {kept} {'remain' if kept > 1 else 'remains'}", draw


def _band(page: Page, row: Places, foot: float, top: float) -> None:
    """Draw a band for nodes that are too many to draw individually."""
    page.box((row[0], top), (row[1] - row[0], foot - top), face=tint(COLOR, 0.3), edge=_PEN)
    page.text(((row[0] + row[1]) / 2, (foot + top) / 2), "· · ·", color=INK, align="center")
