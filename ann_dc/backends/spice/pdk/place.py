"""Where the parts of a netlist stand: temperature, supplies, process, and models of a PDK."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ann_dc.backends.spice.pdk.devices import devices_in
from ann_dc.backends.spice.pdk.excerpt import excerpt
from ann_dc.backends.spice.pdk.files import PACKAGE, installed
from ann_dc.hardware.parts.conditions import ROOM
from ann_dc.hardware.parts.levels import Level
from ann_dc.validation.checked import checked

INSTEAD = {
    "models/switch.lib": f"models/{PACKAGE}/switch.lib",
    "cells/integ.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_cell.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_diode.cir": f"models/{PACKAGE}/pi_diode.lib",
}
"""Files of ``circuits`` that the level has models of its own for."""

SLOW = {"s": 1.0, "t": 0.0, "f": -1.0}
"""What the generic transistors are told of a letter of a corner."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Place:
    """Where the parts of a netlist stand, as cards and options.

    Attributes
    ----------
    before, behind : tuple of str
        Cards before the library's models and cells, and behind them: what is said last counts.
    options : str
        Of the simulator.
    """

    before: tuple[str, ...] = ()
    behind: tuple[str, ...] = ()
    options: str = ""


@checked
def place_of(level: Level, library: Mapping[str, str], seed: int | None = None) -> Place:
    """Temperature, supplies and process of a level; for devices of a PDK, their models.

    The generic transistors read ``supply``, ``slow_n`` and ``slow_p``; rails of macro models are
    among their own figures.

    Parameters
    ----------
    level : Level
        With its conditions.
    library : mapping of str to str
        Text of the files that the netlist takes from ``circuits``, by their names.
    seed : int, optional
        Draws the mismatch of all devices of a PDK; there is none without.

    Returns
    -------
    Place

    Raises
    ------
    PdkMissing
        If the level's package is not installed.
    FileFormatError
        If one of its files is missing or broken.
    NetworkError
        If temperature or supplies are outside what its models are made for.

    Examples
    --------
    >>> from ann_dc.hardware.parts import TRANSISTOR, Conditions
    >>> place_of(TRANSISTOR.at(Conditions(temperature=85.0, process="sf")), {}).behind
    ('.param slow_n=1', '.param slow_p=-1', '.temp 85')
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
