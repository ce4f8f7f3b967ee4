"""Packages of parts: case, pads and supplies, for levels with real parts.

Pads are those of the makers' datasheets for the named case. They have not been checked here; verify
them before making a board.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

GROUND, POSITIVE, NEGATIVE = "GND", "V+", "V-"
"""Nets of every board."""


@dataclass(frozen=True, kw_only=True)
class Package:
    """Component as purchased.

    Attributes
    ----------
    part : str
        Part number, or function if no real part is named.
    library : str
        KiCad symbol library.
    units : tuple of mapping of pin to pad
        One mapping for each of the identical parts in the component.
    case, footprint : str
        Empty if no real part is named.
    unused : tuple of str
        Pads that remain open.
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
    """Return a package without a maker.

    Its pads have the names of the pins in `PINS`, and it has no footprint.
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
"""Parts common to all levels with real parts."""


def _single(part: str) -> Package:
    """Return the package of a single op amp in an 8-pad case with the usual pinout."""
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
"""Multiplier pad that is tied to the output: the input that is subtracted in its comparison."""

REAL = {
    "tl072_ad633": {"opamp": TL072, "mul4q": AD633},
    "opa192_ad734": {"opamp": OPA192, "mul4q": AD734},
    "opa828_ad734": {"opamp": OPA828, "mul4q": AD734},
    "ad8065_ad835": {"opamp": AD8065, "mul4q": AD835},
}
"""Packages of the part sets that name real parts."""
