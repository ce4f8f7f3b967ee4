"""TODO: the idea."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ann_dc.errors import UnknownNameError
from ann_dc.hardware.parts.datasheet import Datasheet, Tolerances
from ann_dc.hardware.parts.levels import MACRO_PARAMETERS, Level
from ann_dc.resources import circuits_path

_SPREAD = {
    "resistor_tolerance": "resistor",
    "opamp_vos": "offset",
    "mul_ge": "gain",
    "mul_offset": "product_offset",
}


_POWER = {"opamp_power": "amplifier_power", "mul_power": "multiplier_power"}


_PARAM = re.compile(r"^\.param (\w+)=(\S+)$", re.MULTILINE)


def presets() -> Mapping[str, Level]:
    """Macro levels with the figures of real parts, from ``circuits/models/presets``."""
    folder = circuits_path() / "models" / "presets"
    return {file.stem: _preset(file.stem, file) for file in sorted(folder.glob("*.lib"))}


def preset(name: str) -> Level:
    """One of `presets`.

    Raises
    ------
    UnknownNameError
        If there is none of that name; the message lists those that there are.
    """
    known = presets()
    if name not in known:
        raise UnknownNameError.of("preset", name, known)
    return known[name]


def _preset(name: str, file) -> Level:
    values = {key: float(value) for key, value in _PARAM.findall(file.read_text(encoding="utf-8"))}
    datasheet = {
        attribute: values[key]
        for key, (attribute, _, _) in MACRO_PARAMETERS.items()
        if key in values
    }
    datasheet |= {a: values[key] for key, a in _POWER.items() if key in values}
    tolerances = Tolerances(
        **{field: values[key] for key, field in _SPREAD.items() if key in values}
    )
    return Level(
        name=name,
        models="macro",
        datasheet=Datasheet(**datasheet, tolerances=tolerances),
        full_scale=values.get("full_scale", 1.0),
    )
