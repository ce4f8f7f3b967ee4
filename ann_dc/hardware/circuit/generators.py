"""Function generators of a circuit: over which range they are built, and in which units."""

from __future__ import annotations

from ann_dc.hardware.circuit.scaling import Scaling
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.hardware.schematic.schematic import Schematic
from ann_dc.network.functions import function_block


def slopes_of(schematic: Schematic, scaling: Scaling, part: Generator) -> tuple[float, float]:
    """Values that a volt at a generator's input and at its output stand for, with their signs.

    Parameters
    ----------
    schematic : Schematic
    scaling : Scaling
    part : Generator
    """
    return (
        schematic.sign(part.x) * scaling.unit[part.x] / scaling.full_scale,
        schematic.sign(part.name) * scaling.unit[part.name] / scaling.full_scale,
    )


def built_range(part: Generator, scaling: Scaling) -> tuple[float, float]:
    """Where a function generator is built: the range that was seen and a quarter, in the domain.

    Towards an end of the domain it goes half of the way that is left at most.

    Parameters
    ----------
    part : Generator
    scaling : Scaling
    """
    peak = scaling.peaks[part.x]
    spare = 0.25 * max(peak.high - peak.low, 0.1 * peak.value, 1e-9)
    low, high = function_block(part.function).domain
    return (
        max(peak.low - spare, 0.5 * (peak.low + low)),
        min(peak.high + spare, 0.5 * (peak.high + high)),
    )
