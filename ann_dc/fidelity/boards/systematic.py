"""Systematic errors: control shift by each parasitic common to all circuits.

Tolerances differ from part to part and add up as squares. A nonlinearity, a leakage or a bias
current is equal in all parts of one type.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ann_dc.evaluation.rules import size_of
from ann_dc.fidelity.circuit_instance import CircuitInstance
from ann_dc.hardware.parts.parasitics import NONE, Parasitics
from ann_dc.validation import checked

STILL = ("bias_doubling", "multiplier_noise", "amplifier_noise")
"""Parasitics that do not shift the controls by themselves, or only briefly."""


@checked
def systematic(instance: CircuitInstance) -> dict[str, float]:
    """Return the shift of the settled controls by each parasitic, taken alone.

    The result maps attributes of `Parasitics` to the largest shift relative to the largest control,
    in decreasing order, against parts without parasitics. Parasitics without effect, such as a
    capacitance, give about zero. Raises `NetworkError` if a circuit has no emulation, or no
    equilibrium near the ideal one.
    """
    parasitics = instance.level.datasheet.parasitics
    plain = _controls(instance, NONE)
    size = size_of(plain, instance.probe.control_reach)
    moves = {}
    for field in fields(Parasitics):
        value = getattr(parasitics, field.name)
        if field.name not in STILL and value != getattr(NONE, field.name):
            alone = _controls(instance, replace(NONE, **{field.name: value}))
            moves[field.name] = float(np.abs(alone - plain).max() / size)
    return dict(sorted(moves.items(), key=lambda move: -move[1]))


def _controls(instance: CircuitInstance, parasitics: Parasitics) -> np.ndarray:
    """Return the settled controls (m,) of the circuit with these parasitics."""
    level = instance.level
    parts = replace(level.datasheet, parasitics=parasitics)
    built = replace(instance, level=replace(level, datasheet=parts))
    return built.emulation.controls(built.settled)
