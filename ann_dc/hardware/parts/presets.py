"""Macro levels with the data of real parts from ``circuits/models/presets``.

A preset is a file of ``.param`` lines that ngspice reads directly. This module reads the same file,
so emulation and netlist cannot differ.

>>> names()[0], get("tl072_ad633").full_scale
('ad8065_ad835', 10.0)
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ann_dc.errors import UnknownNameError
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.levels import MACRO_PARAMETERS, Level
from ann_dc.hardware.parts.parasitics import Parasitics
from ann_dc.resources import circuits_path
from ann_dc.validation import checked

TOLERANCES = {
    "resistor_tolerance": "resistor",
    "opamp_vos": "offset",
    "mul_ge": "gain",
    "mul_offset": "product_offset",
    "resistor_drift": "resistor_drift",
    "opamp_drift": "offset_drift",
}
"""Figures of a file that give the tolerances of parts, by the field of `Tolerances`."""

POWER = {"opamp_power": "amplifier_power", "mul_power": "multiplier_power"}
"""Figures of a file that give the power of parts, by the attribute of `Datasheet`."""

PARASITICS = {
    "input_capacitance": "input_capacitance",
    "stray_capacitance": "stray_capacitance",
    "opamp_ib": "bias_current",
    "opamp_ib_doubling": "bias_doubling",
    "opamp_imax": "output_current",
    "opamp_noise": "amplifier_noise",
    "mul_nonlinearity": "multiplier_nonlinearity",
    "mul_feedthrough": "multiplier_feedthrough",
    "mul_capacitance": "multiplier_capacitance",
    "mul_noise": "multiplier_noise",
}
"""Figures of a file that give the parasitics of parts, by the attribute of `Parasitics`."""

PARAM = re.compile(r"^\.param (\w+)=(\S+)$", re.MULTILINE)


@checked
def names() -> tuple[str, ...]:
    """Return the sorted names of all part sets.

    Examples
    --------
    >>> "tl072_ad633" in names()
    True
    """
    return tuple(file.stem for file in _files())


@checked
def get(name: str) -> Level:
    """Return a macro level with the data of real parts.

    Raises `UnknownNameError` if the name is unknown; the message lists the valid names.

    Parameters
    ----------
    name : str
        Name of a part set, see `names`.

    Examples
    --------
    >>> get("tl072_ad633").full_scale
    10.0
    """
    found = {file.stem: file for file in _files()}
    if name not in found:
        raise UnknownNameError.of("preset", name, found)
    return _level(name, found[name].read_text(encoding="utf-8"))


def _files() -> list[Path]:
    return sorted((circuits_path() / "models" / "presets").glob("*.lib"))


def _level(name: str, text: str) -> Level:
    figures = {key: float(value) for key, value in PARAM.findall(text)}
    attributes = {key: attribute for key, (attribute, *_) in MACRO_PARAMETERS.items()} | POWER
    tolerances = Tolerances(**_given(figures, TOLERANCES))
    parasitics = Parasitics(**_given(figures, PARASITICS))
    return Level(
        name=name,
        models="macro",
        datasheet=Datasheet(
            **_given(figures, attributes), tolerances=tolerances, parasitics=parasitics
        ),
        smallest_capacitor=figures.get("smallest_capacitor", 0.0),
        full_scale=figures.get("full_scale", 1.0),
    )


def _given(figures: dict[str, float], fields: dict[str, str]) -> dict[str, Any]:
    """Return the figures that a file contains, under the field names of a record."""
    return {field: figures[key] for key, field in fields.items() if key in figures}
