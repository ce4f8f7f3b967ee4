"""What a deck of a foundry's transistors has beside its circuit: models, supply, options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ann_dc.backends.spice.pdk.devices import devices_in
from ann_dc.backends.spice.pdk.excerpt import excerpt
from ann_dc.backends.spice.pdk.files import PACKAGE, installed
from ann_dc.hardware.parts.conditions import Conditions
from ann_dc.hints.checked import checked

INSTEAD = {
    "models/switch.lib": f"models/{PACKAGE}/switch.lib",
    "cells/integ.cir": f"models/{PACKAGE}/neurons.lib",
    "cells/pi_cell.cir": f"models/{PACKAGE}/neurons.lib",
}
"""Files of ``circuits`` that the level has models of its own for."""


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Foundry:
    """Cards for a library of cells whose transistors are those of the PDK.

    Attributes
    ----------
    cards : tuple of str
        Parameters and models.
    options : str
        Of the simulator.
    """

    cards: tuple[str, ...]
    options: str


@checked
def foundry(library: Mapping[str, str], conditions: Conditions, seed: int | None) -> Foundry:
    """Models of the devices that files of a library use.

    Parameters
    ----------
    library : mapping of str to str
        Text of the files, by their names.
    conditions : Conditions
        Process corner, temperature, and supply over its nominal value.
    seed : int or None
        Draws the mismatch of all devices; None: there is none.

    Returns
    -------
    Foundry

    Raises
    ------
    PdkMissing
        If the package is not installed.
    FileFormatError
        If one of its files is missing or broken.
    NetworkError
        If the temperature is outside what the models are made for.
    """
    devices = devices_in("\n".join(library.values()))
    models = excerpt(devices, installed(), conditions=conditions, mismatch=seed is not None)
    drawn = "" if seed is None else f" seed={seed + 1}"
    return Foundry(
        cards=(f".param supply={conditions.supply:.9g}", *models),
        options=f"scale=1u temp={conditions.temperature:.9g}{drawn}",
    )
