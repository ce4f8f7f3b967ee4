"""List of parts and BOM: every element of a flat deck as a part with a reference.

In a deck, the preset of an integrator is a current source with a parallel resistor, because
simulators handle this form better. On a board the preset is one voltage source.

Files next to the deck: scaling sheet, expected controls and waveforms, README.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ann_dc.backends.spice.ngspice.expressions import value_of
from ann_dc.evaluation.reference import evaluator
from ann_dc.export.netlists.build import Build
from ann_dc.export.netlists.deck_file import (
    CONTROLS,
    DECK,
    WAVEFORMS,
    accuracy_words,
    plain,
)
from ann_dc.export.netlists.flat_reader import Element
from ann_dc.export.netlists.packages import GROUND, PASSIVE, PINS, REAL, Package, generic
from ann_dc.export.reference.csv_tables import csv_text
from ann_dc.fidelity.circuit_study import NEAR
from ann_dc.hardware.parts.datasheet import Kind
from ann_dc.hardware.parts.e_series import Series
from ann_dc.hardware.parts.levels import Level
from ann_dc.si_prefixes import PREFIXES, counted

PRESET_OHMS = 0.1
"""Resistor in ohms across the current source of a preset."""

CLASSES = {
    "r": ("R", "resistor", "ohm"),
    "c": ("C", "capacitor", "F"),
    "d": ("D", "diode", ""),
    "s": ("SW", "analog switch", ""),
    "v": ("V", "voltage source", "V"),
    "i": ("I", "current source", "A"),
    "b": ("B", "behavioural source", ""),
    "e": ("E", "inverted copy", ""),
    "g": ("G", "controlled source", ""),
    "m": ("Q", "MOS transistor", ""),
    "q": ("Q", "bipolar transistor", ""),
    "preset": ("V", "preset", "V"),
    "opamp": ("U", "op amp", ""),
    "opamp_fd": ("U", "differential op amp", ""),
    "mul4q": ("U", "multiplier", ""),
    "ota": ("U", "transconductor", "S"),
    "ota_diff": ("U", "transconductor", "S"),
    "clk2": ("U", "two-phase clock", ""),
    "function": ("U", "function generator", ""),
}
"""Reference letters, description, and unit of the value of every kind."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Part of a circuit.

    Attributes
    ----------
    reference : str
        Reference of its component, such as ``U7``.
    unit : int
        Index among the identical parts in the component.
    kind : str
        Key of `CLASSES`.
    name : str
        Name of the element in the deck.
    value : str
        Value with six digits in the unit of its kind; expression of a function generator.
    nets : tuple of str
        Nets in the order of `PINS`.
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
        return dict(zip(PINS[self.kind], self.nets))


def package_of(kind: str, level: str) -> Package:
    """Return the package of a kind of part at the level with the given name."""
    return REAL.get(level, {}).get(kind) or PASSIVE.get(kind) or generic(kind, CLASSES[kind][1])


def parts_of(elements: Iterable[Element], level: str) -> tuple[Part, ...]:
    """Return the parts of a flat deck, in the order of the deck.

    The name of the level determines the number of parts per component.
    """
    count: Counter[str] = Counter()
    waiting: dict[str, tuple[str, int]] = {}
    found = []
    for kind, element, value in _soldered(list(elements)):
        package = package_of(kind, level)
        if kind in waiting:
            reference, unit = waiting.pop(kind)
        else:
            letters = CLASSES[kind][0]
            count[letters] += 1
            reference, unit = f"{letters}{count[letters]}", 0
        if unit + 1 < len(package.units):
            waiting[kind] = reference, unit + 1
        nets = tuple(GROUND if node == "0" else node for node in element.nodes)
        found.append(
            Part(
                reference=reference,
                unit=unit,
                kind=kind,
                name=element.name,
                value=value,
                nets=nets,
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
            yield _kind(element.kind), element, _value(element)
        elif element is source:
            preset = Element(name=element.name, kind="preset", nodes=element.nodes[::-1])
            yield "preset", preset, f"{PRESET_OHMS * (element.value or 0.0) + 0.0:.6g}"


def _kind(kind: str) -> str:
    return "function" if kind.startswith("func_") else kind


def _value(element: Element) -> str:
    if element.kind.startswith("func_"):
        return element.kind.removeprefix("func_")
    if element.kind in ("ota", "ota_diff"):
        return f"{element.given['gm']:.6g}"
    if element.value is not None:
        return f"{element.value:.6g}"
    return " ".join(element.words) if element.kind in "vib" else ""


def without_maker(parts: Iterable[Part], level: str) -> str:
    """Return the parts without a purchasable type at a level, with their numbers.

    The text has the form ``analog switch (2), preset (1)`` and is empty if every part has a type.
    """
    count: Counter[str] = Counter()
    for part in parts:
        count[CLASSES[part.kind][1]] += package_of(part.kind, level).library == "ann_dc"
    return ", ".join(f"{name} ({number})" for name, number in sorted(count.items()) if number)


BILL = (
    *("reference", "value", "unit", "to buy", "series", "tolerance"),
    *("part class", "part", "package", "quantity"),
)
"""Columns of the BOM."""
LISTED = ("reference", "unit", "kind", "name in the deck", "value", "pins and nets")
"""Columns of the list of parts."""


def bill_text(build: Build, parts: Iterable[Part]) -> str:
    """Return the BOM as CSV text, with one line for all identical components."""
    groups: dict[tuple[str, str], dict[str, None]] = {}
    for part in parts:
        value = "" if part.kind == "v" and not _is_number(part.value) else part.value
        groups.setdefault((part.kind, value), {})[part.reference] = None
    rows, tolerances = [], tolerances_of(build.level)
    for (kind, value), references in groups.items():
        package = package_of(kind, build.level.name)
        _, meaning, unit = CLASSES[kind]
        bought, series = _bought(kind, value, build.series)
        row = (value, unit, bought, series, tolerances.get(kind, ""), meaning)
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
    """Format the value of a part with an SI prefix.

    Examples
    --------
    >>> engineering("10101"), engineering("5.06e-11"), engineering("0")
    ('10.101k', '50.6p', '0')
    """
    number = value_of(value, {})
    for size, prefix in PREFIXES:
        if abs(number) >= size * (1 - 1e-9):
            return f"{number / size:.6g}{prefix}"
    return value


def series_of(kind: str, series: Series) -> Series | None:
    """Return the series from which parts of a kind (``r``, ``c``, ...) are purchased.

    Resistors have the given series. Returns None for kinds without a series.
    """
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


ROWS = 200
"""Maximum number of rows of a waveform table."""


def scaling_text(build: Build) -> str:
    """Return CSV text with the value of 1 V at every node of a cell."""
    rows, scaling = [], build.circuit.scaling
    for name in build.circuit.schematic.polarity:
        nodes = [node for (own, _), node in build.deck.signals.items() if own == name]
        if nodes:
            scale, alias = build.circuit.scale_of(name), build.circuit.alias[name]
            where = nodes[0] if len(nodes) == 1 else f"{alias}__<stage>"
            used = f"{scaling.used(name):.3g}" if name in scaling.peaks else ""
            ends = (f"{scale.factor:.9g}", f"{1 / scale.factor:.9g}", f"{scale.offset:.9g}")
            rows.append((where, name, *ends, used))
    head = ("node", "stands for", "user unit a volt", "volts a user unit", "offset", "used")
    return csv_text(head, rows)


def expected_text(build: Build) -> str:
    """Return CSV text with the settled controls, in the user's units and in volts."""
    rows = []
    for reading in build.controls:
        value = build.settled(reading)
        volts = reading.scale.network(value)
        place = plain(reading.name), reading.stage, reading.node
        rows.append((*place, f"{value:.9g}", f"{volts:.9g}"))
    return csv_text(("control", "stage", "node", "expected", "volts"), rows)


def waveforms_text(build: Build) -> str:
    """Return CSV text with the waveforms (V over s) of the ideal network's neurons.

    The table contains all neurons that have a node.
    """
    probe, timing, network = build.probe, build.deck.timing, build.network
    count = len(probe.time)
    at = np.unique(np.linspace(0, count - 1, min(count, ROWS)).round().astype(int))
    values = evaluator(network).values(probe.states[at])[..., 1:-1]
    seconds = timing.release + timing.unit * probe.time[at]
    columns = [
        values[:, network.node_index[r.name], r.stage] / build.circuit.value_of(r.name)
        for r in build.readings
    ]
    table = np.column_stack([seconds, *columns])
    head = ("seconds", *(f"v({reading.node})" for reading in build.readings))
    return csv_text(head, ([f"{value:.7g}" for value in row] for row in table + 0.0))


BOUGHT = """
Resistors and capacitors have exact values, of which many megohms or few femtofarads cannot be
bought or built: `series=E96-pairs` takes two resistors of that series for each, and capacitors of
E24. With `series=E96`, one for each, controls are often off by several percent.
"""


def accuracy_text(build: Build, parts: Iterable[Part] = ()) -> str:
    """Return the first lines of a README: parts without a maker, predicted accuracy.

    The parts to purchase are ``parts``.
    """
    unnamed = without_maker(parts, build.level.name)
    lines = [f"No part to buy for: {unnamed}."] if unnamed else []
    lines += [f"A circuit {accuracy_words(build.control_error, build.probe.size_in_words)}."]
    lines += [f"WARNING: {build.doubt}."] if build.doubt else []
    return "\n\n".join(lines)


def readme_text(build: Build, parts: Sequence[Part]) -> str:
    """Return the README of a folder: content, use, and results to check."""
    deck, network = build.deck, build.network
    first = build.controls[0]
    kinds = ", ".join(counted(number, name) for name, number in deck.parts.items())
    zero = f"{first.scale.offset:.6g} + " if first.scale.offset else ""
    named = parts if build.level.name in REAL else ()
    exact = build.series.name == "exact"
    bought = BOUGHT if exact else ""
    cells = counted(network.stages, "cells")
    with_them = "" if exact else f", capacitors: {build.series.capacitors.name}"
    return f"""# {plain(network.title)}: an analog neural network of {cells}

{accuracy_text(build, named)}

Level: {build.level.name}. Resistors: {build.series.name}{with_them}. {len(parts)} parts: {kinds}.
{bought}
    ngspice -b {DECK}

runs it for {deck.end:.4g} s of circuit time, and needs nothing but this folder. It writes

- `{CONTROLS}`: every control in the user's units as it settled, beside what is expected,
- `{WAVEFORMS}`: the volts of the controls over time,

and says how far the controls are off, as a share of {build.probe.size_in_words}.
Above {NEAR:.0%} it says that they are NOT where the ideal network settles, with exit code 1. The
expected values are those of the ideal
network; parts of a level are off by what their gain, bandwidth and rails cost. `ann-dc circuit` has
their noise, tolerances and settling time.

| file | what |
|---|---|
| `{DECK}` | the netlist: cells, the row, inputs, reset, the transient |
| `library/` | the models and cells that it includes |
| `bill.csv` | what to buy: one line for all components that are the same |
| `parts.csv` | every part: reference, name in the deck, value, nets |
| `scaling.csv` | what a volt at a node stands for |
| `expected_controls.csv` | what the controls settle to, in the user's units and in volts |
| `expected_waveforms.csv` | all neurons in volts over seconds, as the ideal network moves |
| `reference_vector.json` | the network's own steps, for `ann-dc inspect` |
| `SHA256SUMS` | `sha256sum -c SHA256SUMS` |

A control is read off its node: {plain(first.name)} of stage {first.stage} is
{zero}{first.scale.factor:.6g} * v({first.node}); `scaling.csv` has the others. The node `rst` holds
the reset: 5 V until {deck.timing.release:.3g} s, 0 V from then on. One unit of network time is
{deck.timing.unit:.4g} s.
"""
