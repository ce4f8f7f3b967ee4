r"""With which sign every part carries its node, so that few inverters are needed.

Integrators and summing amplifiers invert: a source of weight w reaches a part at polarity p with
the right sign if its own polarity is :math:`\sigma` with :math:`p\,\sigma\,w < 0`. Where some
reader needs the other sign, the source gets an inverter. Multipliers have differential inputs,
which makes products free of sign, and a differential circuit has both signs of everything. A diode
neuron carries its multiplier with the sign of its diodes, and is not turned.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ann_dc.hardware.schematic.elements import (
    Adder,
    GridNode,
    Integrator,
    Multiplier,
    Part,
    PICell,
)
from ann_dc.hardware.schematic.metric_wiring import OWN


def polarities(parts: Sequence[Part]) -> dict[str, int]:
    """Signs that need few inverters: every part's turned as long as that saves one.

    Parameters
    ----------
    parts : sequence of Part

    Returns
    -------
    dict of node name to +1 or -1
    """
    ordered = sorted(parts, key=lambda part: isinstance(part, Multiplier))  # free of sign: last
    # a dual's output is inverted: primal and dual read each other with opposite signs
    polarity = {part.name: -1 if isinstance(part, PICell) else 1 for part in ordered}
    readings = _Readings(parts, list(polarity))
    signs = np.array(list(polarity.values()))
    best = readings.inverted(signs).sum()
    turned = [i for i, p in enumerate(ordered) if not (isinstance(p, PICell) and p.rectified)]
    improved = True
    while improved:
        improved = False
        for part in turned:
            signs[part] *= -1
            count = readings.inverted(signs).sum()
            if count < best:
                best, improved = count, True
            else:
                signs[part] *= -1
    return dict(zip(polarity, signs.tolist()))


def inverted(parts: Sequence[Part], polarity: Mapping[str, int]) -> set[str]:
    """Parts whose output is needed with the other sign too: one inverter each and cell.

    Parameters
    ----------
    parts : sequence of Part
    polarity : mapping of node name to +1 or -1

    Returns
    -------
    set of str
    """
    names = list(polarity)
    found = _Readings(parts, names).inverted(np.array(list(polarity.values())))
    return {names[part] for part in np.flatnonzero(found)}


class _Readings:
    """Who reads whom with which sign: every sign of every wire once."""

    def __init__(self, parts: Sequence[Part], names: list[str]) -> None:
        self.count = len(names)
        place = {name: i for i, name in enumerate(names)}
        found = {
            (place[wire.source], place[part.name], sign)
            for part in parts
            if isinstance(part, (Integrator, PICell, Adder))
            for wire in part.wires
            if wire.source in place  # an input comes with both signs
            for sign in np.unique(np.sign(wire.weight)).astype(int).tolist()
            if sign
        }
        found |= {  # a pair of nodes takes its integrator with both signs
            (place[wire.source], place[part.name], sign)
            for part in parts
            if isinstance(part, GridNode)
            for wire in part.wires
            if wire.source.startswith(OWN)
            for sign in (1, -1)
        }
        self.table = np.array(sorted(found), int).reshape(-1, 3)

    def inverted(self, signs: np.ndarray) -> np.ndarray:
        """(parts,) booleans: which are needed with the other sign, for signs (parts,)."""
        sources, targets, sign = self.table.T
        wrong = sign * signs[sources] * signs[targets] > 0
        return np.bincount(sources[wrong], minlength=self.count) > 0
