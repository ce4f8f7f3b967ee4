"""Order of the trims and predicted remaining errors, by sensitivities.

The part with the largest contribution to the error is trimmed first. The drawn deviations are
identical, seed by seed, to those of the emulated circuits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.fidelity.boards.measurements import Reading, reading_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.fidelity.error_budget import Sensitivity
from ann_dc.hardware.circuit.circuit import Parameter, Quantity
from ann_dc.hardware.circuit.deviations import draw
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.schematic.elements import Generator
from ann_dc.validation import PositiveFinite, Share, checked

TRIMMED = (Kind.OFFSET, Kind.GAIN, Kind.PRODUCT_OFFSET)
"""Kinds of quantities that are trimmed; resistors are bought with the required tolerance."""

DRAWN = 400
"""Number of circuits whose errors are predicted by sensitivities after every step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """Trim of one quantity of one part in one cell.

    Attributes
    ----------
    parameter : Parameter
        Part and quantity that is trimmed.
    stage : int
        Index of the cell.
    reading : Reading
        Measurement with its target and expected deviation.
    remaining : float
        Error of the controls relative to the largest control that the requested fraction of
        circuits does not exceed after this step, by sensitivities.
    """

    parameter: Parameter
    stage: int
    reading: Reading
    remaining: float


@checked
def trim_steps(
    nominal: CircuitInstance, slopes: Sensitivity, share: Share, resolution: PositiveFinite
) -> tuple[list[Step], np.ndarray]:
    """Return all trims in order and the untrimmed errors of drawn circuits.

    Errors are predicted by sensitivities. `slopes` are the sensitivities of the nominal circuit at
    its equilibrium. `share` is the fraction of circuits to which the remaining error of each step
    refers. `resolution` is the accuracy of a reading in volts. The untrimmed errors (DRAWN,) are
    the largest control errors of each circuit relative to the largest control, indexed by seed.
    """
    known = tuple(p for p in slopes.parameters if p.name in slopes.slopes)
    drawn, steps = _Drawn(slopes, nominal), []
    untrimmed = drawn.worst
    for parameter, stage in _order(known, slopes, nominal):
        reading = reading_of(nominal, parameter, stage)
        drawn.trim(parameter, stage, resolution / abs(reading.slope))
        left = drawn.remaining(share)
        steps.append(Step(parameter=parameter, stage=stage, reading=reading, remaining=left))
    return steps, untrimmed


class _Drawn:
    """Controls of many drawn circuits, by sensitivities, during trimming.

    Attributes
    ----------
    errors : (S, controls) array
        Signed errors of all controls, relative to the largest control.
    """

    def __init__(self, slopes: Sensitivity, nominal: CircuitInstance) -> None:
        right = nominal.probe.control_values[-1]
        lost = (nominal.emulation.controls(nominal.settled) - right) / nominal.probe.control_size
        listed, sizes = nominal.circuit.parameters, nominal.level.tolerances
        each = [draw(listed, sizes, seed) for seed in range(DRAWN)]
        self.slopes = slopes.slopes
        moving = [name for name in each[0] if name in slopes.slopes]
        self.off = {name: np.array([drawn[name] for drawn in each]) for name in moving}
        self.errors = lost + sum(
            (off @ self.slopes[name].T for name, off in self.off.items()),
            np.zeros((DRAWN, len(right))),
        )

    def trim(self, parameter: Parameter, stage: int, grain: float) -> None:
        """Trim one part of every circuit to the resolution `grain` of the quantity."""
        change = -grain * np.round(self.off[parameter.name][:, stage] / grain)
        self.errors += np.outer(change, self.slopes[parameter.name][:, stage])

    @property
    def worst(self) -> np.ndarray:
        """Largest control error of every circuit, shape (S,)."""
        return np.abs(self.errors).max(axis=1)

    def remaining(self, share: float) -> float:
        """Return the largest control error that a fraction of the circuits stays below."""
        return float(np.quantile(self.worst, share))


def _order(
    known: Sequence[Parameter], slopes: Sensitivity, nominal: CircuitInstance
) -> list[tuple[Parameter, int]]:
    """Return all trims by contribution to the worst control's remaining variance.

    The gain of a function generator precedes its offset, which is read with a trimmed gain.
    """
    sizes = nominal.level.tolerances
    parts = {p.name: (sizes.deviation(p.kind) * slopes.slopes[p.name]) ** 2 for p in known}
    left = sum(parts[p.name][:, p.present].sum(axis=1) for p in known)
    places = [
        (parameter, stage)
        for parameter in known
        if parameter.kind in TRIMMED and sizes.deviation(parameter.kind) > 0
        for stage in map(int, np.flatnonzero(parameter.present))
    ]
    if not places:
        return []
    share = np.array([parts[parameter.name][:, stage] for parameter, stage in places])
    order, open_, gains = [], np.ones(len(places), bool), _gains(nominal, places)
    while open_.any():
        best = int(np.where(open_, share[:, int(np.argmax(left))], -1.0).argmax())
        gain = gains.get((places[best][0].part, places[best][1]), best)
        best = gain if open_[gain] else best
        order.append(places[best])
        open_[best] = False
        left = left - share[best]
    return order


def _gains(nominal: CircuitInstance, places: Sequence[tuple[Parameter, int]]) -> dict[tuple, int]:
    """Return the position of each function generator's gain trim, by part and cell."""
    parts = nominal.circuit.schematic.by_name
    return {
        (parameter.part, stage): n
        for n, (parameter, stage) in enumerate(places)
        if parameter.quantity is Quantity.GAIN and isinstance(parts[parameter.part], Generator)
    }
