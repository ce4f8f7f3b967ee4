"""Symbols of parts on a page: schemdraw draws them, the page writes what stands beside them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from ann_dc.errors import ExportPackageMissing
from ann_dc.export.drawings.page import INK, Page

SCALE = 3.2
"""Millimetres of a unit of schemdraw, in which a resistor's body is one long."""
AMPLIFIER = (2.165 * SCALE, 1.25 * SCALE)
"""Length of an op amp, and the distance of its inputs."""

Point = tuple[float, float]


class Symbols:
    """What is drawn on a page; all places in its millimetres.

    Parameters
    ----------
    page : Page

    Raises
    ------
    ExportPackageMissing
        If there is no schemdraw.
    """

    def __init__(self, page: Page) -> None:
        try:
            import schemdraw
            from schemdraw import elements
        except ImportError as error:
            raise ExportPackageMissing(
                "schematics are drawn by schemdraw; pip install 'ann-dc[export]'"
            ) from error
        self.page, self._elements = page, elements
        self._axes, self._height = page.upright(SCALE)
        self._drawing = schemdraw.Drawing(canvas=self._axes, show=False)
        self._drawing.config(lw=0.7, color=INK)

    def finish(self) -> None:
        """Draw what was placed."""
        limits = self._axes.get_xlim(), self._axes.get_ylim()
        self._drawing.draw(show=False)
        self._axes.set(xlim=limits[0], ylim=limits[1])

    def resistor(self, start: Point, end: Point, words: str = "") -> None:
        """A resistor and its value."""
        self._two(self._elements.Resistor, start, end, words)

    def capacitor(self, start: Point, end: Point, words: str = "") -> None:
        """A capacitor and its value."""
        self._two(self._elements.Capacitor, start, end, words)

    def diode(self, anode: Point, cathode: Point, words: str = "") -> None:
        """A diode."""
        self._two(self._elements.Diode, anode, cathode, words)

    def clamp(self, start: Point, end: Point, words: str = "") -> None:
        """Two Zener diodes against each other, as the sign of a limiter."""
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        self._two(self._elements.Zener, middle, start, "")
        self._two(self._elements.Zener, middle, end, "")
        self.page.text((middle[0], middle[1] - 2.3), words, align="center")

    def amplifier(self, minus: Point) -> tuple[Point, Point]:
        """An op amp with its inverting input there: where its other input and its output are."""
        self._add(self._elements.Opamp(), minus)
        length, inputs = AMPLIFIER
        return (minus[0], minus[1] + inputs), (minus[0] + length, minus[1] + inputs / 2)

    def ground(self, at: Point) -> None:
        """Ground below a place."""
        self._drawing += self._elements.Ground().at(self._place(at))

    def dot(self, at: Point) -> None:
        """A place where wires meet."""
        self._drawing += self._elements.Dot(radius=0.12).at(self._place(at))

    def wire(self, points: Sequence[Point]) -> None:
        """Straight wires from place to place."""
        for start, end in itertools.pairwise(points):
            self._two(self._elements.Line, start, end, "")

    def _two(self, kind: Any, start: Point, end: Point, words: str) -> None:
        self._drawing += kind().endpoints(self._place(start), self._place(end))
        if start[1] == end[1]:
            self.page.text(((start[0] + end[0]) / 2, start[1] - 2.1), words, align="center")
        else:
            self.page.text((start[0] + 1.6, (start[1] + end[1]) / 2), words)

    def _add(self, element: Any, minus: Point) -> None:
        self._drawing += element.anchor("in1").at(self._place(minus)).right()

    def _place(self, at: Point) -> Point:
        return at[0] / SCALE, self._height - at[1] / SCALE
