"""Drawing page in mm from the upper left corner, written as SVG and PDF with the letters it uses.

Text is stored as text. Equal pages give equal bytes.
"""

from __future__ import annotations

import base64
import io
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any
from xml.sax.saxutils import escape

import matplotlib
from fontTools import subset
from fontTools.ttLib import TTFont
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont
from matplotlib.patches import FancyBboxPatch, PathPatch
from matplotlib.path import Path
from matplotlib.textpath import TextToPath

from ann_dc.network.network import Network
from ann_dc.weights.hashes import content_hash, wiring_hash

FAMILY = "STIXGeneral"
"""Font, included with matplotlib on every platform."""
SMALL, PLAIN, LARGE = 6.0, 6.5, 9.0
"""Font sizes in points; none is below 6."""
WIDTH = 180.0
"""Page width in mm: two columns of a journal."""
POINT = 25.4 / 72
"""Length of a point in mm."""
INK, GREY, PALE = "#222222", "#8A8A8A", "#F4F4F4"
SCHEMA = 1
"""Version of the metadata of a picture."""

_STYLE: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "ann_dc", "pdf.fonttype": 42}


@cache
def _properties(bold: bool) -> FontProperties:
    return FontProperties(family=FAMILY, weight="bold" if bold else "normal")


@lru_cache(maxsize=20_000)
def _width_of_one(text: str, bold: bool) -> float:
    wide, _, _ = TextToPath().get_text_width_height_descent(text, _properties(bold), False)
    return wide / _properties(bold).get_size_in_points()


def text_width(text: str, size: float = SMALL, bold: bool = False) -> float:
    """Return the width of a text in mm, at a ``size`` in points."""
    return _width_of_one(text, bold) * size * POINT


@cache
def _known(bold: bool) -> frozenset[int]:
    return frozenset(TTFont(findfont(_properties(bold))).getBestCmap() or ())


def is_drawn(letter: str) -> bool:
    """Return True if a letter can be drawn in both regular and bold type."""
    return all(ord(letter) in _known(bold) for bold in (False, True))


@dataclass(frozen=True, kw_only=True)
class Pen:
    """Appearance of lines and edges: colour, width in points, and line style of matplotlib."""

    color: str = INK
    width: float = 0.6
    style: Any = "-"


class Page:
    """Empty page with width and height in mm."""

    def __init__(self, width: float, height: float) -> None:
        self._figure = Figure(figsize=(width / 25.4, height / 25.4), facecolor="white")
        self.axes = self._figure.add_axes((0, 0, 1, 1))
        self.axes.set(xlim=(0, width), ylim=(height, 0))
        self.axes.set_axis_off()
        self._letters: dict[bool, set[str]] = {False: set(), True: set()}
        self._depth = 10.0

    def text(
        self,
        at: tuple[float, float],
        words: str,
        *,
        size: float = SMALL,
        bold: bool = False,
        color: str = INK,
        align: str = "left",
    ) -> None:
        """Draw text whose small letters are centred at the given height."""
        if not words:
            return
        x, y = at
        self._letters[bold] |= set(words)
        self.axes.text(
            x, y + 0.31 * size * POINT, words, color=color, ha=align, va="baseline",
            fontsize=size, family=FAMILY, weight="bold" if bold else "normal",
            zorder=self._depth + 1, parse_math=False,
        )  # fmt: skip

    def box(
        self,
        corner: tuple[float, float],
        size: tuple[float, float],
        *,
        face: str = "white",
        edge: Pen | None = None,
        round_by: float = 0.7,
    ) -> None:
        """Draw a box with round corners, positioned by its upper left corner."""
        edge = edge or Pen(width=0)
        # matplotlib rounds the corners of a box that it has shrunk
        self.axes.add_patch(
            FancyBboxPatch(
                corner, *size, boxstyle=f"round,pad=0,rounding_size={round_by}",
                fc=face, ec=edge.color if edge.width else "none", lw=edge.width,
                ls=edge.style, zorder=self._depth,
            )
        )  # fmt: skip

    def line(self, points: Sequence[tuple[float, float]], edge: Pen) -> None:
        """Draw straight lines between points."""
        self._path(points, [Path.MOVETO] + [Path.LINETO] * (len(points) - 1), edge)

    def wave(self, start: tuple[float, float], end: tuple[float, float], edge: Pen) -> None:
        """Draw a curve that is horizontal at both ends."""
        middle = (start[0] + end[0]) / 2
        vertices = [start, (middle, start[1]), (middle, end[1]), end]
        self._path(vertices, [Path.MOVETO] + [Path.CURVE4] * 3, edge)

    def arrow(self, tip: tuple[float, float], *, color: str, left: bool = False) -> None:
        """Draw an arrowhead to the right, or to the left."""
        x, y = tip
        back = x + 1.0 if left else x - 1.0
        vertices = [(x, y), (back, y - 0.45), (back, y + 0.45), (x, y)]
        codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
        self._path(vertices, codes, Pen(width=0), color)

    def dot(self, at: tuple[float, float], radius: float, *, face: str, edge: Pen) -> None:
        """Draw a circle."""
        x, y = at
        size = 2 * radius, 2 * radius
        self.box((x - radius, y - radius), size, face=face, edge=edge, round_by=radius)

    def upright(self, scale: float) -> tuple[Any, float]:
        """Return page-wide axes with units of ``scale`` mm and upward y, and their height."""
        width, height = (inches * 25.4 / scale for inches in self._figure.get_size_inches())
        axes = self._figure.add_axes((0, 0, 1, 1), facecolor="none")
        axes.set(xlim=(0, width), ylim=(0, height))
        axes.set_axis_off()
        return axes, height

    def above(self) -> None:
        """Draw all following items above the previous items."""
        self._depth += 2

    def _path(
        self, vertices: Sequence[tuple[float, float]], codes: list, edge: Pen, face: str = "none"
    ) -> None:
        self.axes.add_patch(
            PathPatch(
                Path(vertices, codes), fc=face, ec=edge.color if edge.width else "none",
                lw=edge.width, ls=edge.style, zorder=self._depth,
                capstyle="butt", joinstyle="round",
            )
        )  # fmt: skip

    def files(self, name: str, reported: Mapping[str, object]) -> dict[str, bytes]:
        """Return the page as ``name.svg`` and ``name.pdf``, with metadata."""
        return {f"{name}.svg": self.svg(reported), f"{name}.pdf": self.pdf(reported)}

    def svg(self, reported: Mapping[str, object]) -> bytes:
        """Return the page as SVG with the given metadata."""
        svg = self._written("svg", {"Date": None, "Creator": None})
        return _own_svg(svg, _json(reported), self._letters).encode()

    def pdf(self, reported: Mapping[str, object]) -> bytes:
        """Return the page as PDF with the given metadata."""
        about = {"Title": str(reported["title"]), "Subject": _json(reported)}
        return self._written("pdf", about | dict.fromkeys(("CreationDate", "Creator", "Producer")))

    def _written(self, kind: str, about: Mapping) -> bytes:
        stream = io.BytesIO()
        with matplotlib.rc_context(_STYLE):
            self._figure.savefig(stream, format=kind, metadata=dict(about))
        return stream.getvalue()


def told_of(network: Network, form: str, what: str) -> dict[str, object]:
    """Return the metadata of a picture of a network."""
    return {
        "format": f"ann_dc {form}",
        "schema": SCHEMA,
        "title": network.title,
        "of": what,
        "wiring": wiring_hash(network),
        "content": content_hash(network),
    }


def _json(reported: Mapping[str, object]) -> str:
    return json.dumps(reported, sort_keys=True, ensure_ascii=True)


def _own_svg(svg: bytes, words: str, letters: Mapping[bool, Iterable[str]]) -> str:
    """Return SVG without a document type, with metadata and the embedded letters."""
    text = re.sub(r"<!DOCTYPE[^>]*>\n?", "", svg.decode())
    text = re.sub(
        r" <metadata>.*?</metadata>", lambda _: f" <metadata>{escape(words)}</metadata>", text,
        count=1, flags=re.DOTALL,
    )  # fmt: skip
    faces = "".join(_font_face(bold, used) for bold, used in letters.items() if used)
    return text.replace("<defs>", f'<defs>\n  <style type="text/css">{faces}</style>', 1)


def _font_face(bold: bool, letters: Iterable[str]) -> str:
    font = TTFont(findfont(_properties(bold)), recalcTimestamp=False)
    options = subset.Options(hinting=False, layout_features=[], notdef_outline=True)
    options.drop_tables += ["FFTM"]
    cut = subset.Subsetter(options)
    cut.populate(text="".join(sorted(letters)))
    cut.subset(font)
    stream = io.BytesIO()
    font.save(stream, reorderTables=True)
    packed = base64.b64encode(stream.getvalue()).decode()
    weight = "bold" if bold else "normal"
    return (
        f"@font-face {{font-family: {FAMILY}; font-weight: {weight}; "
        f"src: url(data:font/ttf;base64,{packed});}}"
    )
