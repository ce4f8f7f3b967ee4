r"""Operating conditions of a netlist: temperature, supplies, process, PDK models.

A transistor of the PDK is a subcircuit with 88 models, one per range of widths and lengths, and
every instance would copy them all. An excerpt contains the models in use, two or three. Quantities
that differ from device to device remain expressions, drawn anew for every instance,

.. math:: t_{ox} (1 + m\, \xi\, a / \sqrt{W L}), \qquad \xi \sim N(0, 1),

with the switch m = 0 or 1 of mismatch.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ann_dc.backends.spice.pdk.devices import NUMBER, PREFIX, Device, devices_in
from ann_dc.backends.spice.pdk.files import PACKAGE, PdkFiles, installed
from ann_dc.errors import FileFormatError, NetworkError
from ann_dc.hardware.parts.conditions import NOMINAL, ROOM, Conditions
from ann_dc.hardware.parts.levels import Level

MADE_FOR = -40.0, 125.0
"""Temperature range of the models in degrees Celsius."""

SUPPLIES = (0.9, 1.1)
"""Supply range relative to the nominal 5 V: gates withstand 5.5 V, circuits are tested down to 4.5
V.
"""

BIPOLAR = {"tt": "t", "ss": "s", "ff": "f", "sf": "t", "fs": "t"}
"""Corners of bipolar transistors, by those of the other transistors."""

NOTICE = (
    "* ---- of SKY130's models: copyright 2020 The SkyWater PDK Authors, Apache License 2.0",
    "* https://www.apache.org/licenses/LICENSE-2.0; changed: cut to the geometries in use",
)
"""Copyright notice at the top of an excerpt."""

LIMITS = re.compile(r"\b([lw]m(?:in|ax))\s*=\s*(\S+)", re.IGNORECASE)
ASSIGNED = re.compile(r"(\w+)\s*=\s*('[^']*'|\{[^}]*\}|[^\s=]+)")
NAME = re.compile(r"\b[a-z]\w*\b", re.IGNORECASE)


def excerpt(
    devices: list[Device],
    files: PdkFiles,
    *,
    conditions: Conditions = NOMINAL,
    mismatch: bool = False,
) -> tuple[str, ...]:
    """Return the models of some devices at a process corner, as netlist lines.

    The lengths are in micrometres: ``.options scale=1u``. ``mismatch`` is True for separate errors
    of every device. Raises `NetworkError` if temperature or supplies are outside the range of
    models and devices, or if a geometry has no model. Raises `FileFormatError` if a file is missing
    or malformed.
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
    """Raise an error for temperatures and supplies outside the range of the models."""
    coldest, hottest = MADE_FOR
    if not coldest <= conditions.temperature <= hottest:
        raise NetworkError(
            f"temperature: models of {PACKAGE} are valid for {coldest:g} to {hottest:g} C, got "
            f"{conditions.temperature:g} C"
        )
    low, high = SUPPLIES
    if not low <= conditions.supply <= high:
        raise NetworkError(
            f"supply: circuits of {PACKAGE} are valid for {low:g} to {high:g} times the nominal "
            f"voltage, got {conditions.supply:g}"
        )


def _model(files: PdkFiles, devices: Sequence[Device], corner: str) -> list[str]:
    """Return the subcircuit of a device with the models of its geometries."""
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
    """Return the smallest and largest sizes of a model in micrometres."""
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
    """Return the values of the parameters that models may name."""
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
    """Return definitions of the parameters named by models, directly or indirectly."""
    found: dict[str, str] = {}
    waiting = [name.lower() for card in models for name in NAME.findall(card)]
    while waiting:
        name = waiting.pop()
        if name in known and name not in found:
            found[name] = known[name]
            waiting += [inner.lower() for inner in NAME.findall(known[name])]
    return [f".param {name}={value}" for name, value in sorted(found.items())]


INSTEAD = {
    "models/switch.lib": f"models/{PACKAGE}/switch.lib",
    "cells/integ.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_cell.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_diode.cir": f"models/{PACKAGE}/pi_diode.lib",
}
"""Files of ``circuits`` that the level replaces by its models."""

SLOW = {"s": 1.0, "t": 0.0, "f": -1.0}
"""Slowness parameter of the generic transistors for each letter of a corner."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """Operating conditions of a netlist as cards and simulator options.

    The cards are placed before and behind the library's models and cells; the last definition
    applies.
    """

    before: tuple[str, ...] = ()
    behind: tuple[str, ...] = ()
    options: str = ""


def place_of(level: Level, library: Mapping[str, str], seed: int | None = None) -> Place:
    """Return temperature, supplies and process of a level, and models of PDK devices.

    The generic transistors read ``supply``, ``slow_n`` and ``slow_p``. Rails of macro models are
    among the figures of these models. ``library`` maps the names of the netlist's ``circuits``
    files to their text. ``seed`` draws the mismatch of all PDK devices.

    Raises `PdkMissing` if the level's package is not installed, and `FileFormatError` or
    `NetworkError` as `excerpt`.
    """
    conditions = level.conditions
    if level.models == PACKAGE:
        devices = devices_in("\n".join(library.values()))
        models = excerpt(devices, installed(), conditions=conditions, mismatch=seed is not None)
        drawn = "" if seed is None else f" seed={seed + 1}"
        return Place(
            before=(f".param supply={conditions.supply:.9g}", *models),
            options=f"scale=1u temp={conditions.temperature:.9g}{drawn}",
        )
    given: dict[str, float] = {}
    if level.models == "transistor":
        given = {name: SLOW[of] for name, of in zip(("slow_n", "slow_p"), conditions.process)}
        if conditions.supply != 1.0:
            given["supply"] = conditions.supply
    cards = [f".param {name}={value:.9g}" for name, value in given.items() if value]
    if conditions.temperature != ROOM:
        cards.append(f".temp {conditions.temperature:.9g}")
    return Place(behind=tuple(cards))
