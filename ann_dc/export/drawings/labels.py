"""Labels of drawings: short node names, numbers, and a colour per population."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ann_dc.export.drawings.page import is_drawn
from ann_dc.network.cell import ONE, Cell, Connection, Product, Sum

LONGEST = 16
"""Maximum number of characters of a node name; longer names, and products, are numbered."""
PALETTE = {
    "q": "#0072B2",
    "u": "#D55E00",
    "t": "#009E73",
    "mu": "#AA4499",
    "beta": "#B8860B",
    "z": "#882255",
}
"""Colours of Okabe and Ito and of Tol, distinguishable for every kind of colour vision."""
OTHERS = ("#56B4E9", "#332288", "#44AA99", "#999933", "#CC6677")
BLOCKS = "#555555"
MEANINGS = {
    "q": "states",
    "u": "controls",
    "t": "next states, compared by the neighbours",
    "mu": "multipliers of the dynamics",
    "beta": "multipliers of the coupling",
    "z": "multipliers of inequalities",
    "z_J": "weights of the objectives",
    "J": "measured objectives",
    "E": "upper bound of the objectives",
}


def short_names(cell: Cell) -> dict[str, str]:
    """Return the drawn name of each node: its own, except for products (p3) and long sums (s1)."""
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
    """Truncate a text with dots; characters that the font lacks become a question mark (?)."""
    plain = "".join(letter if is_drawn(letter) else "?" for letter in text)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def number(value: float | np.ndarray) -> str:
    """Format a number with three digits, or the range of the stages' numbers."""
    values = np.atleast_1d(np.asarray(value, float))
    low, high = (_digits(end) for end in (values.min(), values.max()))
    return low if low == high else f"{low}…{high}"


def _digits(value: float) -> str:
    return f"{value + 0.0:.3g}".replace("e+0", "e").replace("e-0", "e-").replace("-", "−")


def term(connection: Connection, name: str, first: bool = False) -> str:
    """Format a term of a sum: a weight and its factor; a weight of one is omitted."""
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


def cell_at(offset: int) -> str:
    """Return the name of a neighbouring cell, such as k−1."""
    return f"k{offset:+d}".replace("-", "−")


def colours(cell: Cell) -> dict[str, str]:
    """Return a colour for every population of a cell."""
    spare = iter(OTHERS * (1 + len(cell.populations) // len(OTHERS)))
    return {name: PALETTE.get(name) or next(spare) for name in cell.populations}


def tint(color: str, share: float = 0.16) -> str:
    """Mix a colour with white."""
    parts = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return "#" + "".join(f"{round(255 - share * (255 - part)):02x}" for part in parts)


def node_colours(cell: Cell) -> Mapping[str, str]:
    """Return the colour of every node; blocks of a multiplier neuron have that of the neuron."""
    populations = colours(cell)
    found = dict.fromkeys([*cell.inputs, ONE, *(b.name for b in cell.blocks)], BLOCKS)
    found |= {neuron.name: populations[neuron.population] for neuron in cell.neurons}
    for dual in cell.duals:
        found |= dict.fromkeys((dual.residual, dual.multiplier), found[dual.neuron])
    for row in (*cell.inequality_duals, *cell.objectives):
        found |= dict.fromkeys(row.nodes, found[row.neuron])
    return found
