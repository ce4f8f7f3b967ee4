"""TODO: the idea."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ann_dc.hardware.circuit.coupling import OWN
from ann_dc.hardware.circuit.elements import Adder, Integrator, Multiplier, PICell
from ann_dc.hardware.circuit.schematic import Schematic


def _polarities(made: Schematic) -> dict[str, int]:
    """Signs that need few inverters: every part's turned as long as that saves one."""
    polarity = {part.name: 1 for part in made.parts if not isinstance(part, Multiplier)}
    # a dual's output is inverted: primal and dual read each other with opposite signs
    polarity |= {part.name: -1 for part in made.parts if isinstance(part, PICell)}
    polarity |= {part.name: 1 for part in made.parts if isinstance(part, Multiplier)}
    if made.coupling is not None:
        polarity |= {name: 1 for chain in made.network.cell.chains for name in chain}
    if made.differential:
        return dict.fromkeys(polarity, 1)
    best = len(needs(replace(made, polarity=polarity)))
    improved = True
    while improved:
        improved = False
        for name in polarity:
            polarity[name] *= -1
            count = len(needs(replace(made, polarity=polarity)))
            if count < best:
                best, improved = count, True
            else:
                polarity[name] *= -1
    return polarity


def needs(made: Schematic) -> set[str]:
    """Parts whose output is needed with the other sign too: one inverter each and cell."""
    outputs = made.polarity
    needed: set[str] = set()
    if made.differential:
        return needed
    for part in made.parts:
        if not isinstance(part, (Integrator, PICell, Adder)):
            continue
        for wire in part.wires:
            source = outputs.get(wire.source)
            if source is None:  # an input: there with both signs
                continue
            signs = np.sign(wire.weight)
            if (signs * source * outputs[part.name] > 0).any():
                needed.add(wire.source)
    if made.coupling is not None:
        needed |= _coupled_needs(made)
    return needed


def _coupled_needs(made: Schematic) -> set[str]:
    stages, needed = made.network.stages, set()
    places = np.arange(2 * stages)
    for i, row in enumerate(made.network.cell.chains):
        for j, column in enumerate(made.network.cell.chains):
            block = made.coupling[  # pyright: ignore[reportOptionalSubscript]
                i * 2 * stages : (i + 1) * 2 * stages, j * 2 * stages : (j + 1) * 2 * stages
            ]
            for a in (0, 1):
                for b in (0, 1):
                    sign = np.sign(block[places % 2 == a][:, places % 2 == b])
                    target, source = row[a], OWN + column[b]
                    if (sign * made.polarity[source] * made.polarity[target] > 0).any():
                        needed.add(source)
    return needed
