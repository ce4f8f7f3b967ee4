"""KiCad netlist of a circuit: components with footprints and nets with pads.

The netlist is for Pcbnew. It also contains elements that a simulator does not need: supplies, the
second op amp of a package, and the multiplier pad that is tied to its output.
"""

from __future__ import annotations

import itertools
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeAlias

from ann_dc.errors import ExportError
from ann_dc.export.netlists.build import Build, LevelOrName, build, name_of
from ann_dc.export.netlists.flat_reader import flattened
from ann_dc.export.netlists.pack import (
    PARTS,
    accuracy_text,
    claims_of,
    deck_text,
    library_of,
    plain,
)
from ann_dc.export.netlists.parts import (
    CLASSES,
    FEEDBACK,
    GROUND,
    Part,
    engineering,
    package_of,
    parts_of,
    parts_text,
    series_of,
    tolerances_of,
)
from ann_dc.export.reference.contents import README
from ann_dc.export.reference.sidecar import check_vector
from ann_dc.export.reference.vector import VECTOR, ReferenceVector
from ann_dc.hardware.parts.e_series import Series
from ann_dc.hardware.parts.technologies import DifferentialPairs, OpAmps
from ann_dc.network.network import Network
from ann_dc.validation import checked

Tree: TypeAlias = "str | list[Tree]"
"""S-expression: a text, or a list that begins with a word."""

NETLIST = "circuit.net"
ENGINEERING = "rc"
"""Kinds of parts whose values have an SI prefix."""


@checked
def kicad_files(
    network: Network,
    vector: ReferenceVector,
    *,
    level: LevelOrName = "macro",
    series: str = "exact",
) -> dict[str, bytes]:
    """Export a netlist for KiCad's board editor, with one entry per component.

    The level is ``macro``, ``differential``, a `Level` of macro models, or a part set by name,
    whose parts have footprints. In the series ``E24-pairs`` and ``E96-pairs`` both resistors of a
    pair are components. The files are 'circuit.net', 'parts.csv' with the deck element of each
    part, 'README.md' and 'reference_vector.json'.

    Raises `ExportError` if the network cannot be built at the level or the level has no purchasable
    parts, and `UnknownNameError` for an unknown level or series.
    """
    check_vector(network, vector)
    made = build(network, level, series, vector.duration)
    named = isinstance(made.level.technology, (OpAmps, DifferentialPairs))
    if made.level.models != "macro" or not named:
        raise ExportError(
            f"level {name_of(level)}: has no commercial parts; use macro, differential, or parts "
            "by name such as tl072_ad633"
        )
    elements = flattened(deck_text(made), library_of(made))
    soldered = (*_in_series(parts_of(elements, made.level.name), made.series),)
    tree = _netlist(made, soldered)
    return {
        NETLIST: (_text(tree) + "\n").encode(),
        PARTS: parts_text(soldered).encode(),
        README: _readme(made, soldered).encode(),
        VECTOR: vector.as_json(),
    }


def _in_series(parts: tuple[Part, ...], series: Series) -> Iterator[Part]:
    """Yield resistors and capacitors as purchased: two in series for series of pairs."""
    numbers = itertools.count(1 + sum(part.kind == "r" for part in parts))
    for part in parts:
        taken = series_of(part.kind, series)
        if taken is None or not taken.mantissas:
            yield part
            continue
        values, (begin, end) = [f"{each:.6g}" for each in taken.parts(float(part.value))], part.nets
        middle = f"{part.name}.m" if len(values) > 1 else end
        yield replace(part, value=values[0], nets=(begin, middle))
        for value in values[1:]:
            other = replace(part, reference=f"R{next(numbers)}", name=f"{part.name}.2")
            yield replace(other, value=value, nets=(middle, end))


def _netlist(build: Build, parts: Iterable[Part]) -> Tree:
    level, groups = build.level.name, _components(parts)
    tolerances = tolerances_of(build.level)
    title = plain(build.network.title)
    comments = (f"level {level}", *claims_of(build))
    block = _tree("title_block", title=title, source="circuit.net")
    block += [_tree("comment", number=str(i + 1), value=c) for i, c in enumerate(comments)]
    sheet = [*_tree("sheet", number="1", name="/", tstamps="/"), block]
    kinds = dict.fromkeys(group[0].kind for group in groups.values())
    return [
        "export",
        ["version", "E"],
        [*_tree("design", source=title, tool="ann_dc"), sheet],
        ["components", *(_component(group, level, tolerances) for group in groups.values())],
        ["libparts", *(_library_part(kind, level) for kind in kinds)],
        ["nets", *_nets(groups, level)],
    ]


def _tree(head: str, **named: Tree) -> list[Tree]:
    """Return a list of named texts."""
    return [head, *([name, text] for name, text in named.items())]


def _components(parts: Iterable[Part]) -> dict[str, list[Part]]:
    groups: dict[str, list[Part]] = {}
    for part in parts:
        groups.setdefault(part.reference, []).append(part)
    return groups


def _component(group: list[Part], level: str, tolerances: Mapping[str, str]) -> Tree:
    first, package = group[0], package_of(group[0].kind, level)
    fields = {"Deck": " ".join(part.name for part in group)}
    if tolerances.get(first.kind):
        fields["Tolerance"] = tolerances[first.kind]
    tree = _tree("comp", ref=first.reference, value=_value(first, package.part))
    if package.footprint:
        tree.append(["footprint", package.footprint])
    description = CLASSES[first.kind].description
    return [
        *tree,
        ["fields", *([*_tree("field", name=name), text] for name, text in fields.items())],
        _tree("libsource", lib=package.library, part=package.part, description=description),
        _tree("sheetpath", names="/", tstamps="/"),
        ["tstamps", str(uuid.uuid5(uuid.NAMESPACE_OID, first.reference))],
    ]


def _value(part: Part, name: str) -> str:
    if part.kind in ENGINEERING:
        return engineering(part.value)
    return f"{part.value} V" if part.kind == "preset" else part.value or name


def _library_part(kind: str, level: str) -> Tree:
    package = package_of(kind, level)
    pads = {pad: pin for unit in package.units for pin, pad in unit.items()}
    pads |= dict(package.supplies)
    pads |= dict.fromkeys(package.unused, "NC")
    if package.part in FEEDBACK:
        pads[FEEDBACK[package.part]] = "Z1"
    pins = (_tree("pin", num=pad, name=pads[pad], type="passive") for pad in sorted(pads))
    return [*_tree("libpart", lib=package.library, part=package.part), ["pins", *pins]]


def _nets(groups: Mapping[str, list[Part]], level: str) -> Iterator[Tree]:
    nodes: dict[str, list[Tree]] = {GROUND: []}
    for reference, group in groups.items():
        for pad, name, net in _pads(reference, group, level):
            node = _tree("node", ref=reference, pin=pad, pinfunction=name, pintype="passive")
            nodes.setdefault(net, []).append(node)
    for code, (net, pads) in enumerate(nodes.items(), start=1):
        yield [*_tree("net", code=str(code), name=net), *pads]


def _pads(reference: str, group: list[Part], level: str) -> Iterator[tuple[str, str, str]]:
    """Yield pad, pin and net of every connected pad of a component."""
    package = package_of(group[0].kind, level)
    for part in group:
        unit = package.units[part.unit]
        for pin, net in part.pins.items():
            yield unit[pin], pin, net
        if package.part in FEEDBACK:
            yield FEEDBACK[package.part], "Z1", part.pins["OUT"]
    for unit in package.units[len(group) :]:  # an op amp that nobody needs follows ground
        idle = f"idle_{reference}"
        for pin, net in {"+": GROUND, "-": idle, "OUT": idle}.items():
            yield unit[pin], pin, net
    for pad, net in package.supplies.items():
        yield pad, net, net


def _readme(build: Build, parts: Sequence[Part]) -> str:
    groups = _components(parts)
    level = build.level.name
    known = {package_of(group[0].kind, level).part: group[0].kind for group in groups.values()}
    rows = []
    for name, kind in known.items():
        package = package_of(kind, level)
        pads = "; ".join(" ".join(f"{p}={n}" for p, n in unit.items()) for unit in package.units)
        supplies = " ".join(f"{pad}={net}" for pad, net in package.supplies.items())
        unused = " ".join(package.unused)
        rows.append(f"| {name} | {package.footprint or 'none'} | {pads} | {supplies} | {unused} |")
    return f"""# {plain(build.network.title)}: {len(groups)} components for KiCad

{accuracy_text(build, parts)}

In the board editor (Pcbnew): File, Import, Netlist, `{NETLIST}`. Level: {level}. `parts.csv` lists
the name of every part in the netlist of the pack. Choose the components without a footprint:
switches of the reset, presets and constants (voltages), function generators.

Nets `{GROUND}`, `V+`, `V-` are ground and the supplies; add decoupling capacitors and connectors.
Pads are those of the makers' cases; **check them with the datasheets before a board is made**.

| part | footprint | pads of its pins | supplies and ground | left open |
|---|---|---|---|---|
{chr(10).join(rows)}
"""


def _text(tree: Tree, depth: int = 0) -> str:
    r"""Format a tree as text: lists of words on one line, lists of lists on several.

    The first item of a list is a word and the following items are quoted. The indentation is
    ``depth`` levels.
    """
    if isinstance(tree, str):
        return '"' + tree.replace("\\", "\\\\").replace('"', '\\"') + '"'
    inner = [_text(each, depth + 1) for each in tree[1:]]
    line = " ".join([f"({tree[0]}", *inner]) + ")"
    if len(line) <= 90 and "\n" not in line:
        return line
    indent = "\n" + "  " * (depth + 1)
    beside = all(isinstance(each, str) for each in tree[1])  # as KiCad has it: its name or number
    return f"({tree[0]}{' ' if beside else indent}" + indent.join(inner) + ")"
