r"""Bandwidth margins at which clamps hold saturated neurons at their limits.

The clamp of a saturated neuron carries the current that would move the neuron. This current flows
through a resistor of 50 / (2 pi GBW C), the output resistance r of the clamp's op amp and a diode.
The op amp has to supply the voltage drop

.. math:: \Big(\frac{50}{2 \pi\, GBW} + r C\Big) \Big|\frac{dv}{dt}\Big| + 0.6\,V ,

where dv/dt is the suppressed slope. With a margin k all slopes are 1 / k as steep and capacitors k
times as large. A neuron that is pushed harder against its limit therefore needs a slower circuit.
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
from ann_dc.validation import State, checked

GIVEN = 0.7
"""Largest used fraction of the output swing of a clamp's op amp; its gain drops beyond."""


@checked
def holding_margin(circuit: Circuit, level: Level, x: State) -> float:
    """Return the smallest margin with which clamps hold at the ideal settled state.

    The state ``x`` (n,) is the settled point of the ideal network. The circuit may have any margin;
    its resistors are not changed. The result is zero if no neuron is saturated, and infinite if no
    margin is sufficient.
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
    """Raise `NetworkError` if the clamps would not hold at the settled state ``x``.

    The state (n,) is that of the ideal network. The message names a sufficient margin.
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
    """Return the network without limits, for the net inputs of saturated neurons."""
    neurons = tuple(replace(n, limiter=Limiter()) for n in network.cell.neurons)
    return replace(network, cell=replace(network.cell, neurons=neurons))
