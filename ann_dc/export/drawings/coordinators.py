"""Picture of the preconditioner above the cell array: hats, resistors or a tree."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from ann_dc.export.drawings.labels import tint
from ann_dc.export.drawings.page import GREY, INK, Page, Pen
from ann_dc.network.network import Network
from ann_dc.network.preconditioners.cyclic_reduction import CyclicReduction
from ann_dc.network.preconditioners.multilevel import Multilevel
from ann_dc.network.preconditioners.resistive_grid import ResistiveGrid

COLOR = "#3A5E8C"
_PEN = Pen(color=COLOR, width=0.5)
FINEST = 1.4
"""Smallest distance in mm between nodes that are drawn individually; closer nodes become a band."""
LEVEL = 7.0
"""Height of a level in mm."""

Places = tuple[float, float]
"""Left and right ends of the cell array on a page in mm."""


def height_of(network: Network) -> float:
    """Return the height in mm that the preconditioner needs above the cell array."""
    return LEVEL * len(_levels(network))


def draw_preconditioner(page: Page, network: Network, row: Places, bottom: float) -> None:
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
