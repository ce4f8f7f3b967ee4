"""What stands in a drawing: short names of nodes, numbers, and a colour for every population."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.export.drawings.page import is_drawn
from ann_dc.network.cell import ONE, Cell, Connection, Product, Sum

LONGEST = 16
"""Letters of a node's name in a drawing; longer ones, and products, are numbered."""
PALETTE = {
    "q": "#0072B2",
    "u": "#D55E00",
    "t": "#009E73",
    "mu": "#AA4499",
    "beta": "#B8860B",
    "z": "#882255",
}
"""Okabe and Ito's and Tol's colours: distinct for every kind of colour vision."""
OTHERS = ("#56B4E9", "#332288", "#44AA99", "#999933", "#CC6677")
BLOCKS = "#555555"
MEANINGS = {
    "q": "states",
    "u": "controls",
    "t": "next states, which neighbours compare",
    "mu": "multipliers of the dynamics",
    "beta": "multipliers of the coupling",
    "z": "multipliers of inequalities",
    "z_J": "shares of the objectives",
    "J": "measured objectives",
    "E": "what no objective is above",
}


def short_names(cell: Cell) -> dict[str, str]:
    """What a drawing calls each node of a ``cell``: by its name, p3 a product, s1 a long sum."""
    taken = {neuron.name for neuron in cell.neurons} | {*cell.inputs}
    taken |= {block.name for block in cell.blocks}
    found, counts = {}, dict.fromkeys("psf", 0)
    for neuron in (*(n.name for n in cell.neurons), *cell.inputs):
        found[neuron] = shortened(neuron, 2 * LONGEST)
    for block in cell.blocks:
        letter = "p" if isinstance(block, Product) else "s" if isinstance(block, Sum) else "f"
        if letter != "p" and len(block.name) <= LONGEST:
            found[block.name] = shortened(block.name, LONGEST)
            continue
        number = counts[letter] + 1
        while f"{letter}{number}" in taken:
            number += 1
        counts[letter] = number
        found[block.name] = f"{letter}{number}"
    return found


def shortened(text: str, most: int) -> str:
    """A text of so many letters at most, with dots where it is cut; what no font here has is ?."""
    plain = "".join(letter if is_drawn(letter) else "?" for letter in text)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def number(value: float | np.ndarray) -> str:
    """A number in three digits, or the range of those of the stages."""
    values = np.atleast_1d(np.asarray(value, float))
    low, high = (_digits(end) for end in (values.min(), values.max()))
    return low if low == high else f"{low}…{high}"


def _digits(value: float) -> str:
    return f"{value + 0.0:.3g}".replace("e+0", "e").replace("e-0", "e-").replace("-", "−")


def term(connection: Connection, name: str, first: bool = False) -> str:
    """A term of a sum: a weight and what it multiplies, one left out."""
    weights = np.atleast_1d(np.asarray(connection.weight, float))
    negative = weights.max() < 0
    said = number(-weights if negative else weights)
    if weights.min() < 0 <= weights.max():
        said = f"({said})"
    words = f"{said} {name}" if connection.source != ONE else said
    if said == "1" and connection.source != ONE:
        words = name
    if first:
        return f"−{words}" if negative else words
    return f"− {words}" if negative else f"+ {words}"


def colours(cell: Cell) -> dict[str, str]:
    """A colour of every population of a ``cell``."""
    spare = iter(OTHERS * (1 + len(cell.populations) // len(OTHERS)))
    return {name: PALETTE.get(name) or next(spare) for name in cell.populations}


def tint(color: str, share: float = 0.16) -> str:
    """A colour thinned with white."""
    parts = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return "#" + "".join(f"{round(255 - share * (255 - part)):02x}" for part in parts)


def node_colours(cell: Cell) -> Mapping[str, str]:
    """The colour of what every node sends: blocks of a multiplier have that of its neuron."""
    populations = colours(cell)
    found = dict.fromkeys([*cell.inputs, ONE, *(b.name for b in cell.blocks)], BLOCKS)
    found |= {neuron.name: populations[neuron.population] for neuron in cell.neurons}
    for dual in cell.duals:
        found |= dict.fromkeys((dual.residual, dual.multiplier), found[dual.neuron])
    for row in (*cell.diodes, *cell.objectives):
        found |= dict.fromkeys(row.nodes, found[row.neuron])
    return found
