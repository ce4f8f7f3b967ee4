r"""What a deck takes of the PDK: the models of its geometries, and the parameters they name.

A transistor of the PDK is a subcircuit with 88 models, one for a range of widths and lengths, and
every instance would copy them all. An excerpt keeps those in use, two or three. What differs from
device to device stays an expression, drawn anew for every instance,

.. math:: t_{ox} (1 + m\, \xi\, a / \sqrt{W L}), \qquad \xi \sim N(0, 1),

with the switch m = 0 or 1 of mismatch.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from ann_dc.backends.spice.pdk.devices import NUMBER, PREFIX, Device
from ann_dc.backends.spice.pdk.files import PACKAGE, PdkFiles
from ann_dc.errors import FileFormatError, NetworkError
from ann_dc.hardware.parts.conditions import NOMINAL, Conditions
from ann_dc.validation.checked import checked

MADE_FOR = -40.0, 125.0
"""Degrees Celsius that the models are made for."""

SUPPLIES = (0.9, 1.1)
"""Supplies over their nominal value of 5 V: gates stand 5.5 V, circuits are tried to 4.5 V."""

BIPOLAR = {"tt": "t", "ss": "s", "ff": "f", "sf": "t", "fs": "t"}
"""Corners of bipolar transistors, by those of the others."""

NOTICE = (
    "* ---- of SKY130's models: copyright 2020 The SkyWater PDK Authors, Apache License 2.0",
    "* https://www.apache.org/licenses/LICENSE-2.0; changed: cut to the geometries in use",
)
"""What stands above an excerpt."""

LIMITS = re.compile(r"\b([lw]m(?:in|ax))\s*=\s*(\S+)", re.IGNORECASE)
ASSIGNED = re.compile(r"(\w+)\s*=\s*('[^']*'|\{[^}]*\}|[^\s=]+)")
NAME = re.compile(r"\b[a-z]\w*\b", re.IGNORECASE)


@checked
def excerpt(
    devices: list[Device],
    files: PdkFiles,
    *,
    conditions: Conditions = NOMINAL,
    mismatch: bool = False,
) -> tuple[str, ...]:
    """The models of some devices at a process corner.

    Parameters
    ----------
    devices : list of Device
    files : PdkFiles
    conditions : Conditions
    mismatch : bool
        Whether every device has errors of its own.

    Returns
    -------
    tuple of str
        Lines of a netlist whose lengths are in micrometres: ``.options scale=1u``.

    Raises
    ------
    NetworkError
        If temperature or supplies are outside what models and devices are made for, or a geometry
        has no model.
    FileFormatError
        If a file is missing or is not what it should be.
    """
    _check(conditions)
    corner = conditions.process
    models: list[str] = []
    for name in sorted({device.name for device in devices}):
        models += _model(files, [each for each in devices if each.name == name], corner)
    known = _parameters(files, devices, corner)
    switches = f".param mc_mm_switch={int(mismatch)} mc_pr_switch=0"
    return (*NOTICE, switches, *_needed(models, known), *models)


def _check(conditions: Conditions) -> None:
    """Refuse temperatures and supplies that models and devices are not made for."""
    coldest, hottest = MADE_FOR
    if not coldest <= conditions.temperature <= hottest:
        raise NetworkError(
            f"temperature: models of {PACKAGE} are made for {coldest:g} to {hottest:g} C, got "
            f"{conditions.temperature:g} C"
        )
    low, high = SUPPLIES
    if not low <= conditions.supply <= high:
        raise NetworkError(
            f"supply: circuits of {PACKAGE} are made for {low:g} to {high:g} times the nominal "
            f"one, got {conditions.supply:g}"
        )


def _model(files: PdkFiles, devices: Sequence[Device], corner: str) -> list[str]:
    """The subcircuit of a device, with the models of its geometries."""
    device = devices[0]
    if not device.binned:
        return list(files.cards(f"cells/{_family(device)}/{device.subcircuit}.model.spice"))
    name = f"{_folder(device)}__{corner}.pm3.spice"
    cards = files.cards(name)
    sizes = {(each.width, each.length) for each in devices}
    bins = {card: _bin(card, name) for card in cards if card.lower().startswith(".model")}
    for width, length in sizes:
        if not any(_inside(limits, width, length) for limits in bins.values()):
            raise NetworkError(f"{device.name}: no model of width {width:g}, length {length:g} um")
    return [
        card
        for card in cards
        if card not in bins or any(_inside(bins[card], *size) for size in sizes)
    ]


def _bin(card: str, name: str) -> dict[str, float]:
    """Smallest and largest sizes of a model, in micrometres."""
    limits = {key.lower(): value for key, value in LIMITS.findall(card)}
    whole = set(limits) == {"lmin", "lmax", "wmin", "wmax"}
    if not whole or not all(NUMBER.fullmatch(value) for value in limits.values()):
        raise FileFormatError(f"{name}: a model without range of widths and lengths: {card[:60]}")
    return {key: 1e6 * float(value) for key, value in limits.items()}


def _inside(limits: dict[str, float], width: float, length: float) -> bool:
    return (
        limits["wmin"] <= width < limits["wmax"] - 1e-9
        and limits["lmin"] <= length < limits["lmax"] - 1e-9
    )


def _folder(device: Device) -> str:
    return f"cells/{device.name}/{device.subcircuit}"


def _family(device: Device) -> str:
    return device.name.partition("_W")[0]


def _parameters(files: PdkFiles, devices: Iterable[Device], corner: str) -> dict[str, str]:
    """Values of the parameters that models may name."""
    names = ["models/parameters/lod.spice", f"models/corners/{corner}/nonfet.spice"]
    for device in devices:
        if device.binned:
            names += [f"{_folder(device)}__{kind}.corner.spice" for kind in (corner, "mismatch")]
        else:
            family = _family(device)
            names += [f"cells/{family}/{PREFIX}{family}__{BIPOLAR[corner]}.corner.spice"]
    return {
        key.lower(): value
        for name in dict.fromkeys(names)
        for card in files.cards(name)
        if card.lower().startswith(".param")
        for key, value in ASSIGNED.findall(card)
    }


def _needed(models: Iterable[str], known: dict[str, str]) -> list[str]:
    """Definitions of the parameters that models name, and of those that these name."""
    found: dict[str, str] = {}
    waiting = [name.lower() for card in models for name in NAME.findall(card)]
    while waiting:
        name = waiting.pop()
        if name in known and name not in found:
            found[name] = known[name]
            waiting += [inner.lower() for inner in NAME.findall(known[name])]
    return [f".param {name}={value}" for name, value in sorted(found.items())]
