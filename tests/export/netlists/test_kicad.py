"""Netlists for KiCad: read, and compared part by part with what ngspice makes of the deck."""

import csv
import io
import re

import pytest
from kicad_netlists import entries, entry, read, wiring_of
from ngspice_listing import expanded, number
from simulator import needs_ngspice

import ann_dc
from ann_dc.errors import ExportError
from ann_dc.export.netlists.kicad import kicad_files
from ann_dc.export.netlists.pack import pack_files

CASES = [
    ("tl072_ad633", "exact"),
    pytest.param("macro", "exact", marks=pytest.mark.slow),
    pytest.param("macro", "E96", marks=pytest.mark.slow),
    pytest.param("ad8065_ad835", "E24", marks=pytest.mark.slow),
]


def components(tree):
    """(Reference, value, names in the deck, footprint) of every component."""
    for group in entries(tree, "components"):
        for each in entries(group, "comp"):
            (fields,) = entries(each, "fields")
            texts = {entry(f, "name"): f[2] for f in entries(fields, "field")}
            footprint = entries(each, "footprint")
            yield entry(each, "ref"), entry(each, "value"), texts["Deck"].split(), footprint


def ngspice_parts(theirs):
    """Nets of every part by its name in the deck, from ngspice's own elements.

    Op amps, multipliers and function generators are those that have an element g2: the first read
    at g1, the others in the expression of b1, and g3 or g2 drives what they give.
    """
    models = {name.removesuffix(".g2") for name in theirs if name.endswith(".g2")}
    found = {}
    for name, words in theirs.items():
        path, _, last = name.rpartition(".")
        if path in models or (last[0] == "r" and words[2] == "0.1"):  # across a preset's source
            continue
        if last[0] in "rcdi":
            found[name] = {*words[:2]}
        elif last[0] == "s":
            found[name] = {*words[:4]}
    for path in models:
        first, own = theirs.get(path + ".g1", []), theirs.get(path + ".b1")
        read_nets = re.findall(r"v\( *(\S+?) *\)", " ".join(own)) if own else first[2:4]
        added = first[2:3] if own else []
        drivers = (".g2",) if own else (".g6", ".g3")  # an op amp on a board limits its current
        out = next(theirs[path + g][1] for g in drivers if path + g in theirs)
        found[path] = {*read_nets, *added, out}
    return found


@pytest.mark.slow
@needs_ngspice
@pytest.mark.filterwarnings("ignore:level .*its controls are predicted:UserWarning")
@pytest.mark.parametrize(("level", "series"), CASES)
def test_connectivity_is_that_of_the_deck(level, series, car, tmp_path):
    """Part by part, and values too; ngspice opens the deck of the pack."""
    pack = pack_files(*car, level=level, series=series)
    (tmp_path / "library").mkdir()
    for name, content in pack.items():
        (tmp_path / name).write_bytes(content)
    theirs = expanded(pack["deck.cir"].decode(), tmp_path)
    wanted = ngspice_parts(theirs)
    tree = read(kicad_files(*car, level=level, series=series)["circuit.net"].decode())
    wired, seen = wiring_of(tree), 0
    supplies = {"V+", "V-"}
    for reference, value, names, _ in components(tree):
        nets = {net for net in wired[reference].values() if not net.startswith("idle_")}
        known = [name for name in names if name in wanted]
        if not known:
            continue
        expected = set().union(*(wanted[name] for name in known)) - {"0"}
        assert nets - supplies - {"GND"} == expected - {"GND"}, reference
        seen += len(known)
        if reference[0] in "RC":
            word = theirs[known[0]][2]
            bought = number(value.replace("M", "meg"))
            close = 1e-5 if series == "exact" or reference[0] == "C" else 6e-2
            assert bought == pytest.approx(number(word), rel=close)
    assert seen == len(wanted) == 1375 - 9  # all but the sources of constants and of the reset


@pytest.mark.slow
def test_op_amps_share_packages_and_idle_ones_follow_ground(car):
    tree = read(kicad_files(*car, level="tl072_ad633")["circuit.net"].decode())
    wired = wiring_of(tree)
    duals = {ref: pads for ref, pads in wired.items() if len(pads) == 8 and pads.get("8") == "V+"
             and pads["4"] == "V-"}  # fmt: skip
    assert len(duals) == 108  # of 215
    idle = [pads for pads in duals.values() if any("idle" in net for net in pads.values())]
    (pads,) = idle
    assert pads["5"] == "GND"
    assert pads["6"] == pads["7"]


@pytest.mark.slow
def test_pads_are_those_of_the_library_parts(car):
    """Every pad that a net names is one that the part declares."""
    tree = read(kicad_files(*car, level="opa192_ad734")["circuit.net"].decode())
    (libraries,) = entries(tree, "libparts")
    pads = {}
    for part in entries(libraries, "libpart"):
        (pins,) = entries(part, "pins")
        pads[entry(part, "lib"), entry(part, "part")] = {entry(pin, "num") for pin in pins[1:]}
    wired = wiring_of(tree)
    (group,) = entries(tree, "components")
    for each in entries(group, "comp"):
        (source,) = entries(each, "libsource")
        known = pads[entry(source, "lib"), entry(source, "part")]
        assert set(wired[entry(each, "ref")]) <= known


def test_pairs_are_two_resistors_in_series(small):
    files = kicad_files(*small, level="macro", series="E24-pairs")
    rows = [*csv.DictReader(io.StringIO(files["parts.csv"].decode()))]
    exact = kicad_files(*small, level="macro")
    nominal = {
        row["name in the deck"]: float(row["value"])
        for row in csv.DictReader(io.StringIO(exact["parts.csv"].decode()))
        if row["kind"] == "r"
    }
    pairs = [row for row in rows if row["name in the deck"].endswith(".2")]
    assert pairs
    by_name = {row["name in the deck"]: row for row in rows}
    for second in pairs:
        name = second["name in the deck"].removesuffix(".2")
        total = float(second["value"]) + float(by_name[name]["value"])
        assert total == pytest.approx(nominal[name], rel=1e-2)
        assert f"2={name}.m" in by_name[name]["pins and nets"]
        assert f"1={name}.m" in second["pins and nets"]
    assert len({row["reference"] for row in rows}) == len(rows)
    wired = wiring_of(read(files["circuit.net"].decode()))
    for row in rows:
        wires = {
            pin: net for pin, _, net in (w.rpartition("=") for w in row["pins and nets"].split())
        }
        assert set(wires.values()) <= set(wired[row["reference"]].values())


def test_a_level_without_parts_is_refused(small):
    for level in ("behavioural", "transistor", "ota-c"):
        with pytest.raises(ExportError, match="has no commercial parts; use macro"):
            kicad_files(*small, level=level)


def test_same_input_same_bytes(small):
    network, vector = small
    again = ann_dc.design(
        ann_dc.plants.double_integrator(N=3), preconditioner=ann_dc.PreconditionerKind.DIAGONAL
    )
    assert kicad_files(again.network, vector) == kicad_files(network, vector)
