"""Networks to draw, and the words of an SVG file as boxes, measured with its own fonts."""

import base64
import io
import re
from dataclasses import dataclass, replace
from functools import cache
from xml.etree import ElementTree

from fontTools.ttLib import TTFont

import ann_dc
from ann_dc.export.drawings.cell_picture import cell_page
from ann_dc.network.network import Network

SVG = "{http://www.w3.org/2000/svg}"


@dataclass(frozen=True)
class Words:
    """A text of a picture and where it stands, in points."""

    text: str
    left: float
    right: float
    top: float
    bottom: float
    size: float

    def overlaps(self, other) -> bool:
        across = min(self.right, other.right) - max(self.left, other.left)
        down = min(self.bottom, other.bottom) - max(self.top, other.top)
        return across > 0.2 and down > 0.2


class Picture:
    """An SVG file, measured with the fonts that it carries."""

    def __init__(self, content: bytes):
        self.root = ElementTree.fromstring(content)
        self.fonts = {
            weight: TTFont(io.BytesIO(base64.b64decode(packed)))
            for weight, packed in re.findall(
                r"font-weight: (\w+); src: url\(data:font/ttf;base64,([^)]*)\)", content.decode()
            )
        }
        self.width, self.height = map(float, self.root.get("viewBox").split()[2:])
        self.words = [self._measured(text) for text in self.root.iter(f"{SVG}text")]

    def _measured(self, element) -> Words:
        style = element.get("style")
        size = float(re.search(r"font-size: ([\d.]+)px", style)[1])
        font = self.fonts["bold" if "font-weight" in style else "normal"]
        letters, advances = font.getBestCmap(), font["hmtx"].metrics
        wide = sum(advances[letters[ord(letter)]][0] for letter in element.text)
        wide *= size / font["head"].unitsPerEm
        x, y = float(element.get("x")), float(element.get("y"))
        anchor = re.search(r"text-anchor: (\w+)", style)[1]
        left = x - {"start": 0, "middle": wide / 2, "end": wide}[anchor]
        # of letters without tails: rows stand closer than tails are long
        return Words(element.text, left, left + wide, y - 0.66 * size, y, size)

    def collisions(self) -> list[tuple[str, str]]:
        return [
            (one.text, other.text)
            for place, one in enumerate(self.words)
            for other in self.words[:place]
            if one.overlaps(other)
        ]

    def outside(self) -> list[str]:
        return [
            words.text
            for words in self.words
            if words.left < 0 or words.right > self.width or not 0 < words.bottom < self.height
        ]


def rows() -> ann_dc.OptimalControlProblem:
    """Rows that press, one of them soft, and rails."""
    problem = ann_dc.plants.double_integrator(N=20)
    (x, v), (a,) = problem.states, problem.controls
    return replace(
        problem,
        constraints={"pace": v <= 0.9 + x, "gentle": a <= 1.9},
        soft={"gentle": ann_dc.Soft(weight=30)},
        bounds={a: (-2.5, 2.5)},
    )


def minimax() -> ann_dc.OptimalControlProblem:
    """Two objectives, of which the larger is minimised: neurons that all cells share."""
    problem = ann_dc.plants.double_integrator(N=6)
    x, v = problem.states
    return replace(problem, objectives={"near": (x - 1) ** 2, "slow": v**2})


MADE = {"rows": rows, "minimax": minimax}


@cache
def network_of(name: str) -> Network:
    return ann_dc.synthesize(MADE[name]() if name in MADE else getattr(ann_dc.plants, name)())


@cache
def cell_of(name: str) -> Picture:
    """The cell of a network as a picture, drawn once."""
    return Picture(cell_page(network_of(name)).svg({"title": name}))
