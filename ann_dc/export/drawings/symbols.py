"""Symbols of parts on a page: schemdraw draws the symbols, the page writes text."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from ann_dc.errors import ExportPackageMissing
from ann_dc.export.drawings.page import INK, Page

SCALE = 3.2
"""Length in mm of a schemdraw unit; the body of a resistor is one unit long."""
AMPLIFIER = (2.165 * SCALE, 1.25 * SCALE)
"""Length of an op amp and distance of its inputs, in mm."""

Point = tuple[float, float]


class Symbols:
    """Symbols drawn on a page, with positions in mm."""

    def __init__(self, page: Page) -> None:
        try:
            import schemdraw
            from schemdraw import elements
        except ImportError as error:
            raise ExportPackageMissing(
                "schematics are drawn by schemdraw; pip install 'ann-dc[export]', or '.[export]' "
                "in a checkout"
            ) from error
        self.page, self._elements = page, elements
        self._axes, self._height = page.upright(SCALE)
        self._drawing = schemdraw.Drawing(canvas=self._axes, show=False)
        self._drawing.config(lw=0.7, color=INK)

    def finish(self) -> None:
        """Draw the placed symbols."""
        limits = self._axes.get_xlim(), self._axes.get_ylim()
        self._drawing.draw(show=False)
        self._axes.set(xlim=limits[0], ylim=limits[1])

    def part(self, kind: str, start: Point, end: Point, words: str = "") -> None:
        """Place a part with two pins, named as in schemdraw, and its value; a diode conducts on."""
        self._drawing += getattr(self._elements, kind)().endpoints(
            self._place(start), self._place(end)
        )
        if start[1] == end[1]:
            self.page.text(((start[0] + end[0]) / 2, start[1] - 2.1), words, align="center")
        else:
            self.page.text((start[0] + 1.6, (start[1] + end[1]) / 2), words)

    def clamp(self, start: Point, end: Point, words: str) -> None:
        """Place two opposed Zener diodes, the symbol of a limiter."""
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        self.part("Zener", middle, start)
        self.part("Zener", middle, end)
        self.page.text((middle[0], middle[1] - 2.3), words, align="center")

    def amplifier(self, minus: Point) -> tuple[Point, Point]:
        """Place an op amp by its inverting input; return its other input and its output."""
        self._drawing += self._elements.Opamp().anchor("in1").at(self._place(minus)).right()
        length, inputs = AMPLIFIER
        return (minus[0], minus[1] + inputs), (minus[0] + length, minus[1] + inputs / 2)

    def ground(self, at: Point) -> None:
        """Place a ground symbol below a point."""
        self._drawing += self._elements.Ground().at(self._place(at))

    def dot(self, at: Point) -> None:
        """Place a wire junction."""
        self._drawing += self._elements.Dot(radius=0.12).at(self._place(at))

    def wire(self, points: Sequence[Point]) -> None:
        """Place straight wires between points."""
        for start, end in itertools.pairwise(points):
            self.part("Line", start, end)

    def _place(self, at: Point) -> Point:
        return at[0] / SCALE, self._height - at[1] / SCALE
