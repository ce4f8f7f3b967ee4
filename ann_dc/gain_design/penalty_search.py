"""Search for the penalty factor of the smallest stiffness ratio, by octaves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

LARGEST_FACTOR = 1024.0
"""Largest factor from the first run's penalty, in either direction, before the last octave."""
HALF_OCTAVE = 2**0.5


def downhill(
    ratio: Callable[[float], float], penalty_factor: float, *, around: float | None = None
) -> float:
    """Return the penalty factor of the smallest stiffness ratio found by octave steps.

    The search begins at ``penalty_factor`` times the first power of two with a stable point;
    finally half an octave is tried on either side. `LARGEST_FACTOR` limits it either way of
    ``around``, by default of the initial factor, which is returned if no factor gives a stable
    point.
    """
    known: dict[float, float] = {}

    def at(factor: float) -> float:
        if factor not in known:
            known[factor] = ratio(factor * penalty_factor)
        return known[factor]

    factor = 1.0
    while not np.isfinite(at(factor)):
        factor *= 2
        if factor > 2 * LARGEST_FACTOR:
            return penalty_factor
    direction = min(0.5, 2.0, key=lambda step: at(factor * step))
    away = penalty_factor / (around or penalty_factor)
    while at(factor * direction) < at(factor) and (
        1 / LARGEST_FACTOR < factor * away < LARGEST_FACTOR
    ):
        factor *= direction
    return min((factor, factor * HALF_OCTAVE, factor / HALF_OCTAVE), key=at) * penalty_factor
