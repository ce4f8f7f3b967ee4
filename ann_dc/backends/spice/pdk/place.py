"""Operating conditions of a netlist: temperature, supplies, process, PDK models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ann_dc.backends.spice.pdk.devices import devices_in
from ann_dc.backends.spice.pdk.excerpt import excerpt
from ann_dc.backends.spice.pdk.files import PACKAGE, installed
from ann_dc.hardware.parts.conditions import ROOM
from ann_dc.hardware.parts.levels import Level
from ann_dc.validation import checked

INSTEAD = {
    "models/switch.lib": f"models/{PACKAGE}/switch.lib",
    "cells/integ.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_cell.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_diode.cir": f"models/{PACKAGE}/pi_diode.lib",
}
"""Files of ``circuits`` that the level replaces by its models."""

SLOW = {"s": 1.0, "t": 0.0, "f": -1.0}
"""Slowness parameter of the generic transistors for each letter of a corner."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """Operating conditions of a netlist as cards and simulator options.

    The cards are placed before and behind the library's models and cells; the last definition
    applies.
    """

    before: tuple[str, ...] = ()
    behind: tuple[str, ...] = ()
    options: str = ""


@checked
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
