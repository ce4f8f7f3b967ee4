r"""Margins at which clamps hold what presses neurons against their rails.

A clamp that holds a neuron carries the current that would move it. Its op amp has to give what that
drops across a resistor of 50 / (2 pi GBW C) and its own output resistance, and the drop of a diode:

.. math:: \Big(\frac{50}{2 \pi\, GBW} + r C\Big) \Big|\frac{dv}{dt}\Big| + 0.6\,V ,

dv/dt being the slope that is cut off. With a margin k all slopes are 1 / k as steep, and capacitors
k times as large: the more a neuron is pressed, the slower its circuit has to be.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ann_dc.errors import NetworkError
from ann_dc.evaluation.reference import evaluator
from ann_dc.hardware.circuit.circuit import CLAMP_DROP, CLAMP_LAG, Circuit
from ann_dc.hardware.parts.board_models import op_amp_rails
from ann_dc.hardware.parts.levels import Level
from ann_dc.hardware.schematic.elements import Integrator
from ann_dc.hardware.sizing.resistors import two_digits
from ann_dc.network.cell import Limiter
from ann_dc.network.network import Network
from ann_dc.validation.checked import checked
from ann_dc.validation.values import State

GIVEN = 0.7
"""Of the rails of its op amp that a clamp gives at most; beyond, its gain ends."""


@checked
def holding_margin(circuit: Circuit, level: Level, x: State) -> float:
    """The smallest margin with which the clamps of a circuit hold where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
        Of any margin; its resistors are kept.
    level : Level
        What its parts are like.
    x : (n,) array
        State vector of the ideal network where it settles.

    Returns
    -------
    float
        Zero where nothing presses, infinite if no margin is enough.
    """
    sheet, scaling = level.datasheet, circuit.scaling
    railed = [p for p in circuit.schematic.parts if isinstance(p, Integrator) and p.railed]
    if not (railed and level.emulated):
        return 0.0
    network, rails = circuit.schematic.network, op_amp_rails(sheet, level.full_scale)
    drives, least = evaluator(_unlimited(network)).drives(x), 0.0
    values = network.unpack(x)
    for part in railed:
        row, built = network.neuron_index[part.name], circuit.limiter(part)
        held = (values[row] <= built.low) | (values[row] >= built.high)
        slope = scaling.volts(part.name, np.abs(drives[row] / part.tau)) / scaling.time
        slope = float(slope[held & part.present].max(initial=0.0))
        farads = float(circuit.capacitors[part.name][part.present].max(initial=0.0))
        left = GIVEN * rails - CLAMP_DROP - sheet.rout * farads * slope
        across = CLAMP_LAG / (2 * math.pi * sheet.gbw) * slope
        if slope:
            least = max(least, scaling.margin * across / left if left > 0 else math.inf)
    return least


@checked
def check_clamps(circuit: Circuit, level: Level, x: State) -> None:
    """Refuse a circuit whose clamps would not hold where the ideal network stands.

    Parameters
    ----------
    circuit : Circuit
    level : Level
    x : (n,) array
        State vector of the ideal network where it settles.

    Raises
    ------
    NetworkError
        With the margin that would do.
    """
    least, margin = holding_margin(circuit, level, x), circuit.scaling.margin
    if least > margin * (1 + 1e-6):
        cure = (
            f"take a margin of {-two_digits(-least):.3g} or more (ann-dc circuit --margin)"
            if math.isfinite(least)
            else "take parts with more"
        )
        rails = op_amp_rails(level.datasheet, level.full_scale)
        raise NetworkError(
            f"margin: {margin:.3g} is too small: neurons are pressed against their bounds harder "
            f"than the op amps of clamps, with rails of {rails:.3g} V, can hold; {cure}"
        )


def _unlimited(network: Network) -> Network:
    """Without rails: what arrives at neurons that stand at theirs."""
    neurons = tuple(replace(n, limiter=Limiter()) for n in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))
