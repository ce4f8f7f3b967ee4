"""What a part is bought as: package, pads, supplies, where the level names real parts.

Pads are those of the makers' datasheets for the case that is named. Nothing here can check them:
whoever makes a board has to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

GROUND, POSITIVE, NEGATIVE = "GND", "V+", "V-"
"""Nets that every board has."""


@dataclass(frozen=True, kw_only=True)
class Package:
    """A component as it lies in a drawer.

    Attributes
    ----------
    part : str
        Its name; what it does, where no real part is named.
    library : str
        Of the symbol, in KiCad.
    units : tuple of mapping of pin to pad
        One for each of the same parts that are in it.
    case, footprint : str
        Empty where no real part is named.
    supplies : mapping of pad to net
    unused : tuple of str
        Pads that stay open.
    """

    part: str
    library: str
    units: tuple[Mapping[str, str], ...]
    case: str = ""
    footprint: str = ""
    supplies: Mapping[str, str] = field(default_factory=dict)
    unused: tuple[str, ...] = ()


PINS = {
    "r": ("1", "2"),
    "c": ("1", "2"),
    "d": ("A", "K"),
    "s": ("1", "2", "C", "R"),
    "v": ("+", "-"),
    "i": ("+", "-"),
    "b": ("+", "-"),
    "e": ("+", "-", "C+", "C-"),
    "g": ("+", "-", "C+", "C-"),
    "m": ("D", "G", "S", "B"),
    "q": ("C", "B", "E"),
    "preset": ("+", "-"),
    "opamp": ("+", "-", "OUT"),
    "opamp_fd": ("+", "-", "OUT+", "OUT-"),
    "mul4q": ("X1", "X2", "Y1", "Y2", "Z", "OUT"),
    "ota": ("IN", "OUT"),
    "ota_diff": ("IN+", "IN-", "OUT"),
    "clk2": ("P1", "P2"),
    "function": ("X", "OUT"),
}
"""Pins of every kind of part, in the order of a netlist's nodes."""


def generic(kind: str, part: str) -> Package:
    """A part that no maker is named for: pads are called like the pins, and it has no footprint.

    Parameters
    ----------
    kind : str
        One of `PINS`.
    part : str
        What it is called.

    Returns
    -------
    Package
    """
    return Package(part=part, library="ann_dc", units=({pin: pin for pin in PINS[kind]},))


PASSIVE = {
    "r": Package(
        part="R",
        library="Device",
        case="0603",
        footprint="Resistor_SMD:R_0603_1608Metric",
        units=({"1": "1", "2": "2"},),
    ),
    "c": Package(
        part="C",
        library="Device",
        case="0603",
        footprint="Capacitor_SMD:C_0603_1608Metric",
        units=({"1": "1", "2": "2"},),
    ),
    "d": Package(
        part="D",
        library="Device",
        case="SOD-123",
        footprint="Diode_SMD:D_SOD-123",
        units=({"K": "1", "A": "2"},),
    ),
}
"""Parts that every level of real parts buys alike."""


def _single(part: str) -> Package:
    """An op amp alone in a case of eight pads, as most have it."""
    return Package(
        part=part,
        library="Amplifier_Operational",
        case="SOIC-8",
        footprint="Package_SO:SOIC-8_3.9x4.9mm_P1.27mm",
        units=({"-": "2", "+": "3", "OUT": "6"},),
        supplies={"4": NEGATIVE, "7": POSITIVE},
        unused=("1", "5", "8"),
    )


TL072 = Package(
    part="TL072",
    library="Amplifier_Operational",
    case="DIP-8",
    footprint="Package_DIP:DIP-8_W7.62mm",
    units=({"OUT": "1", "-": "2", "+": "3"}, {"OUT": "7", "-": "6", "+": "5"}),
    supplies={"4": NEGATIVE, "8": POSITIVE},
)
AD633 = Package(
    part="AD633",
    library="Analog",
    case="DIP-8",
    footprint="Package_DIP:DIP-8_W7.62mm",
    units=({"X1": "1", "X2": "2", "Y1": "3", "Y2": "4", "Z": "6", "OUT": "7"},),
    supplies={"5": NEGATIVE, "8": POSITIVE},
)
AD734 = Package(
    part="AD734",
    library="Analog",
    case="DIP-14",
    footprint="Package_DIP:DIP-14_W7.62mm",
    units=({"X1": "1", "X2": "2", "Y1": "6", "Y2": "7", "Z": "10", "OUT": "12"},),
    supplies={"8": NEGATIVE, "14": POSITIVE, "3": GROUND, "4": GROUND, "5": GROUND},
    unused=("9", "13"),
)
AD835 = Package(
    part="AD835",
    library="Analog",
    case="DIP-8",
    footprint="Package_DIP:DIP-8_W7.62mm",
    units=({"Y1": "1", "Y2": "2", "Z": "4", "OUT": "5", "X2": "7", "X1": "8"},),
    supplies={"3": NEGATIVE, "6": POSITIVE},
)
OPA192, OPA828, AD8065 = _single("OPA192"), _single("OPA828"), _single("AD8065")

FEEDBACK = {"AD734": "11"}
"""Pad of a multiplier that is tied to its output: it subtracts there what it compares with."""

REAL = {
    "tl072_ad633": {"opamp": TL072, "mul4q": AD633},
    "opa192_ad734": {"opamp": OPA192, "mul4q": AD734},
    "opa828_ad734": {"opamp": OPA828, "mul4q": AD734},
    "ad8065_ad835": {"opamp": AD8065, "mul4q": AD835},
}
"""Packages of the presets that name real parts."""
