"""List of parts and BOM: every element of a flat deck as a part with a reference.

In a deck, the preset of an integrator is a current source with a parallel resistor, because
simulators handle this form better. On a board the preset is one voltage source.

Packages of parts: case, pads and supplies, for levels with real parts.

Pads are those of the makers' datasheets for the named case. They have not been checked here; verify
them before making a board.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from ann_dc.backends.spice.ngspice.expressions import value_of
from ann_dc.export.netlists.build import Build
from ann_dc.export.netlists.flat_reader import Element
from ann_dc.export.reference.contents import csv_text
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.e_series import Series
from ann_dc.hardware.parts.levels import Level
from ann_dc.si_prefixes import PREFIXES

GROUND, POSITIVE, NEGATIVE = "GND", "V+", "V-"
"""Nets of every board."""

FEEDBACK = {"AD734": "11"}
"""Multiplier pad that is tied to the output: the input that is subtracted in its comparison."""
PRESET_OHMS = 0.1
"""Resistor in ohms across the current source of a preset."""
BILL = (
    *("reference", "value", "unit", "to buy", "series", "tolerance"),
    *("part class", "part", "package", "quantity"),
)
"""Columns of the BOM."""
LISTED = ("reference", "unit", "kind", "name in the deck", "value", "pins and nets")
"""Columns of the list of parts."""


@dataclass(frozen=True, kw_only=True)
class Package:
    """Component as purchased: its part number, or its function if no real part is named.

    ``library`` is KiCad's symbol library. ``units`` are mappings of pin to pad, one for each of the
    identical parts in the component. Pads in ``unused`` remain open.
    """

    part: str
    library: str
    units: tuple[Mapping[str, str], ...]
    case: str = ""
    footprint: str = ""
    supplies: Mapping[str, str] = field(default_factory=dict)
    unused: tuple[str, ...] = ()


def _passive(part: str, case: str, footprint: str, pads: Mapping[str, str]) -> Package:
    return Package(part=part, library="Device", case=case, footprint=footprint, units=(pads,))


PASSIVE = {
    "r": _passive("R", "0603", "Resistor_SMD:R_0603_1608Metric", {"1": "1", "2": "2"}),
    "c": _passive("C", "0603", "Capacitor_SMD:C_0603_1608Metric", {"1": "1", "2": "2"}),
    "d": _passive("D", "SOD-123", "Diode_SMD:D_SOD-123", {"K": "1", "A": "2"}),
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

REAL = {
    "tl072_ad633": {"opamp": TL072, "mul4q": AD633},
    "opa192_ad734": {"opamp": OPA192, "mul4q": AD734},
    "opa828_ad734": {"opamp": OPA828, "mul4q": AD734},
    "ad8065_ad835": {"opamp": AD8065, "mul4q": AD835},
}
"""Packages of the part sets that name real parts."""


class PartClass(NamedTuple):
    """Reference letters, description, unit of the value, and pins in the order of a netlist."""

    letters: str
    description: str
    unit: str
    pins: str


CLASSES = {
    "r": PartClass("R", "resistor", "ohm", "1 2"),
    "c": PartClass("C", "capacitor", "F", "1 2"),
    "d": PartClass("D", "diode", "", "A K"),
    "s": PartClass("SW", "analog switch", "", "1 2 C R"),
    "v": PartClass("V", "voltage source", "V", "+ -"),
    "i": PartClass("I", "current source", "A", "+ -"),
    "b": PartClass("B", "behavioural source", "", "+ -"),
    "e": PartClass("E", "inverted copy", "", "+ - C+ C-"),
    "g": PartClass("G", "controlled source", "", "+ - C+ C-"),
    "m": PartClass("Q", "MOS transistor", "", "D G S B"),
    "q": PartClass("Q", "bipolar transistor", "", "C B E"),
    "preset": PartClass("V", "preset", "V", "+ -"),
    "opamp": PartClass("U", "op amp", "", "+ - OUT"),
    "opamp_fd": PartClass("U", "differential op amp", "", "+ - OUT+ OUT-"),
    "mul4q": PartClass("U", "multiplier", "", "X1 X2 Y1 Y2 Z OUT"),
    "ota": PartClass("U", "transconductor", "S", "IN OUT"),
    "ota_diff": PartClass("U", "transconductor", "S", "IN+ IN- OUT"),
    "clk2": PartClass("U", "two-phase clock", "", "P1 P2"),
    "function": PartClass("U", "function generator", "", "X OUT"),
}
"""Classes of parts, by kind."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Part of a circuit, with the name of its element in the deck and a net for each pin.

    ``reference`` is that of its component, such as ``U7``, and ``unit`` the index among the
    identical parts in it. ``kind`` is a key of `CLASSES`. ``value`` has six digits in the unit of
    the kind, or is the expression of a function generator.
    """

    reference: str
    unit: int
    kind: str
    name: str
    value: str
    nets: tuple[str, ...]

    @property
    def pins(self) -> dict[str, str]:
        """Nets by pin name."""
        return dict(zip(CLASSES[self.kind].pins.split(), self.nets))


def package_of(kind: str, level: str) -> Package:
    """Return the package of a kind of part at a level; one without a maker has its pins as pads."""
    named = REAL.get(level, {}).get(kind) or PASSIVE.get(kind)
    pads = {pin: pin for pin in CLASSES[kind].pins.split()}
    return named or Package(part=CLASSES[kind].description, library="ann_dc", units=(pads,))


def parts_of(elements: Iterable[Element], level: str) -> tuple[Part, ...]:
    """Return the parts of a flat deck in its order; the level gives the parts per component."""
    count: Counter[str] = Counter()
    waiting: dict[str, tuple[str, int]] = {}
    found = []
    for kind, element, value in _soldered(list(elements)):
        package = package_of(kind, level)
        if kind in waiting:
            reference, unit = waiting.pop(kind)
        else:
            letters = CLASSES[kind].letters
            count[letters] += 1
            reference, unit = f"{letters}{count[letters]}", 0
        if unit + 1 < len(package.units):
            waiting[kind] = reference, unit + 1
        nets = tuple(GROUND if node == "0" else node for node in element.nodes)
        found.append(
            Part(
                reference=reference, unit=unit, kind=kind, name=element.name, value=value, nets=nets
            )
        )
    return tuple(found)


def _soldered(elements: list[Element]) -> Iterator[tuple[str, Element, str]]:
    """Yield kind, element and value of every part; a preset is one part."""
    across = {
        (element.name.rpartition(".")[0], frozenset(element.nodes)): element
        for element in elements
        if element.kind == "i" and "." in element.name
    }
    for element in elements:
        where = element.name.rpartition(".")[0], frozenset(element.nodes)
        source = across.get(where)
        if source is None:
            is_function = element.kind.startswith("func_")
            yield "function" if is_function else element.kind, element, _value(element)
        elif element is source:
            preset = Element(name=element.name, kind="preset", nodes=element.nodes[::-1])
            yield "preset", preset, f"{PRESET_OHMS * (element.value or 0.0) + 0.0:.6g}"


def _value(element: Element) -> str:
    if element.kind.startswith("func_"):
        return element.kind.removeprefix("func_")
    if element.kind in ("ota", "ota_diff"):
        return f"{element.given['gm']:.6g}"
    if element.value is not None:
        return f"{element.value:.6g}"
    return " ".join(element.words) if element.kind in "vib" else ""


def bill_text(build: Build, parts: Iterable[Part]) -> str:
    """Return the BOM as CSV text, with one line for all identical components."""
    groups: dict[tuple[str, str], dict[str, None]] = {}
    for part in parts:
        value = "" if part.kind == "v" and not _is_number(part.value) else part.value
        groups.setdefault((part.kind, value), {})[part.reference] = None
    rows, tolerances = [], tolerances_of(build.level)
    for (kind, value), references in groups.items():
        package = package_of(kind, build.level.name)
        bought, series = _bought(kind, value, build.series)
        known = CLASSES[kind]
        row = (value, known.unit, bought, series, tolerances.get(kind, ""), known.description)
        name = package.part if package.library != "ann_dc" else ""
        rows.append((" ".join(references), *row, name, package.case, len(references)))
    return csv_text(BILL, rows)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def engineering(value: str) -> str:
    """Format the value of a part with an SI prefix."""
    number = value_of(value, {})
    for size, prefix in PREFIXES:
        if abs(number) >= size * (1 - 1e-9):
            return f"{number / size:.6g}{prefix}"
    return value


def series_of(kind: str, series: Series) -> Series | None:
    """Return the series from which parts of a kind are purchased; resistors have the given one."""
    return {"r": series, "c": series.capacitors}.get(kind)


def _bought(kind: str, value: str, series: Series) -> tuple[str, str]:
    taken = series_of(kind, series)
    if taken is None:
        return "", ""
    return " + ".join(f"{each:.6g}" for each in taken.parts(float(value))), taken.name


def tolerances_of(level: Level) -> Mapping[str, str]:
    """Return the tolerances of a level's parts as text, by kind; none for ideal parts."""
    if level.models == "ideal":
        return {}
    sizes = level.tolerances
    product = f"gain {sizes.gain:.2g}, offset {sizes.product_offset:.2g} V"
    return {
        "r": f"{100 * sizes.size(Kind.RESISTOR):.2g} %",
        "c": f"{100 * sizes.capacitor:.2g} %" if sizes.capacitor else "",
        "opamp": f"offset {sizes.size(Kind.OFFSET):.2g} V",
        "opamp_fd": f"offset {sizes.size(Kind.OFFSET):.2g} V",
        "mul4q": product,
        "function": product,
    }


def parts_text(parts: Iterable[Part]) -> str:
    """Return all parts as CSV text: reference, unit, kind, deck name, value and nets."""
    rows = (
        (
            part.reference,
            part.unit + 1,
            part.kind,
            part.name,
            part.value,
            " ".join(f"{pin}={net}" for pin, net in part.pins.items()),
        )
        for part in parts
    )
    return csv_text(LISTED, rows)
