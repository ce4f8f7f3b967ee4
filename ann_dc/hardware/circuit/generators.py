"""Ranges and units of the function generators of a circuit."""

from __future__ import annotations

from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.network.functions import function_block


def slopes_of(schematic: Schematic, scaling: Scaling, part: Generator) -> tuple[float, float]:
    """Return the signed values of one volt at the input and output of a generator."""
    return (
        schematic.sign(part.x) * scaling.unit[part.x] / scaling.full_scale,
        schematic.sign(part.name) * scaling.unit[part.name] / scaling.full_scale,
    )


def built_range(part: Generator, scaling: Scaling) -> tuple[float, float]:
    """Return the range of a function generator: probed range plus a quarter per side.

    The range stays in the domain and covers at most half of the remaining distance to an end of the
    domain.
    """
    peak = scaling.peaks[part.x]
    spare = 0.25 * max(peak.high - peak.low, 0.1 * peak.value, 1e-9)
    low, high = function_block(part.function).domain
    return (
        max(peak.low - spare, 0.5 * (peak.low + low)),
        min(peak.high + spare, 0.5 * (peak.high + high)),
    )
