"""Model levels and part sets by name, with selected datasheet values changed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.level_words import FOR_A_NETWORK, level_words
from ann_dc.hardware.parts.levels import Level

LEVELS = {word: found for word, found in level_words().items() if word not in FOR_A_NETWORK}
"""Levels that a study can build."""
FIGURES = {f.name for f in fields(Datasheet) if f.type == "float"}


def level_of(circuit: Mapping[str, Any], tolerances: Mapping[str, float]) -> Level:
    """Return the model level that settings describe.

    The default `level` is macro. Tolerances replace those of the level. Raises `NetworkError` if a
    number is out of range.

    Examples
    --------
    >>> level_of({"level": "opa192_ad734", "gbw": 5e6}, {"resistor": 1e-3}).tolerances.resistor
    0.001
    """
    level = LEVELS[circuit.get("level", "macro")].made()
    figures = {name: value for name, value in circuit.items() if name in FIGURES}
    known = level.datasheet.tolerances
    if tolerances:
        known = replace(known or Tolerances(), **tolerances)
    return replace(level, datasheet=replace(level.datasheet, **figures, tolerances=known))
