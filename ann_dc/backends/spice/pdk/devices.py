"""Devices of the PDK that a netlist uses, by their geometry."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ann_dc.errors import FileFormatError, UnknownNameError

PREFIX = "sky130_fd_pr__"
"""Prefix of the PDK's subcircuit names."""

KNOWN = ("nfet_g5v0d10v5", "pfet_g5v0d10v5", "npn_05v5_W1p00L1p00")
"""Devices in use: 5 V transistors, and the smallest bipolar transistor."""

CARD = re.compile(
    rf"^X\S*[ \t].*?\b{PREFIX}(?P<name>\w+)(?P<given>.*)$", re.MULTILINE | re.IGNORECASE
)
GIVEN = re.compile(r"(\w+)[ \t]*=[ \t]*(\S+)")
NUMBER = re.compile(r"(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True, order=True)
class Device:
    """Device of `KNOWN` with its width and length in micrometres, one each if fixed."""

    name: str
    width: float = 1.0
    length: float = 1.0

    def __post_init__(self) -> None:
        if self.name not in KNOWN:
            raise UnknownNameError.of("device", self.name, KNOWN)

    @property
    def subcircuit(self) -> str:
        """Subcircuit name in the PDK."""
        return PREFIX + self.name

    @property
    def binned(self) -> bool:
        """True if the device has a model for each range of widths and lengths."""
        return self.name.endswith("10v5")


def devices_in(cards: str) -> list[Device]:
    """Return every distinct device and geometry in the lines of a netlist.

    >>> devices_in("X1 d g s b sky130_fd_pr__nfet_g5v0d10v5 w=20 l=1")
    [Device(name='nfet_g5v0d10v5', width=20.0, length=1.0)]
    """
    return sorted({device for device, _ in device_cards(cards)})


def device_cards(cards: str) -> Iterator[tuple[Device, int]]:
    """Yield the device of every card and its number in parallel.

    Widths and lengths are plain numbers of micrometres; others raise `FileFormatError`, and a
    device that is not in `KNOWN` raises `UnknownNameError`.
    """
    for card in CARD.finditer(cards):
        given = dict(GIVEN.findall(card["given"].lower()))
        numbers = {key: given.get(key, "1") for key in ("w", "l", "m")}
        whole = not GIVEN.sub("", card["given"]).strip() and numbers["m"].isdecimal()
        if not (whole and all(NUMBER.fullmatch(number) for number in numbers.values())):
            raise FileFormatError(
                f"{card[0].strip()!r}: expected sizes as plain numbers of micrometres (w=20) "
                "and their count as m=2"
            )
        size = {"width": float(numbers["w"]), "length": float(numbers["l"])}
        yield Device(name=card["name"], **size), int(numbers["m"])
