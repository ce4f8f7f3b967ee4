"""Packs: they run in an empty folder, and say what they settled to."""

import csv
import io
import re
import subprocess
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from netlist_problems import CASES, PROBLEMS
from simulator import needs_ngspice

import ann_dc
from ann_dc.errors import ExportError, UnknownNameError
from ann_dc.export.netlists.pack import pack_files, stated_in_pack
from ann_dc.export.reference.vector import reference_vector
from ann_dc.hardware.parts.e_series import E96

KINDS = [ann_dc.PreconditionerKind.DIAGONAL]


def table(file: Path) -> list[dict[str, str]]:
    return [*csv.DictReader(io.StringIO(file.read_text()))]


def settled(files: dict[str, bytes], folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """Controls that a pack settled to when it was run, and those that it expects."""
    with zipfile.ZipFile(io.BytesIO(files["pack.zip"])) as archive:
        archive.extractall(folder)
    command = ["ngspice", "-n", "-b", "deck.cir"]
    subprocess.run(command, cwd=folder, capture_output=True, timeout=300, check=True)
    rows = table(folder / "controls.csv")
    expected = table(folder / "expected_controls.csv")
    assert [row["node"] for row in rows] == [row["node"] for row in expected]
    assert [float(row["expected"]) for row in rows] == [float(row["expected"]) for row in expected]
    waveforms = np.loadtxt(folder / "waveforms.txt", skiprows=1)
    volts = [float(row["volts"]) for row in expected]
    assert waveforms.shape[1] == 1 + len(rows)
    np.testing.assert_allclose(waveforms[-1, 1:], volts, atol=1e-2 * np.abs(volts).max())
    return (
        np.array([float(row["settled"]) for row in rows]),
        np.array([float(row["expected"]) for row in rows]),
    )


def off(files: dict[str, bytes], folder: Path) -> float:
    found, expected = settled(files, folder)
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize(
    ("level", "most"),
    [
        ("behavioural", 2e-6),
        ("macro", 1e-4),
        ("tl072_ad633", 6e-3),  # multipliers 0.4 % off a straight line
        pytest.param("opa192_ad734", 1e-3, marks=pytest.mark.slow),
        pytest.param("differential", 1e-4, marks=pytest.mark.slow),
        pytest.param("ota-c", 1e-3, marks=pytest.mark.slow),
        pytest.param("transistor", 5e-3, marks=pytest.mark.slow),
    ],
)
def test_the_car_settles_in_an_empty_folder(level, most, car, tmp_path):
    """What it settles to is the optimum, as far as the parts of the level allow."""
    assert off(pack_files(*car, level=level, zipped=True), tmp_path) < most


@pytest.mark.sampled(2)
@needs_ngspice
@pytest.mark.parametrize("name", CASES)
def test_several_plants_settle(name, tmp_path):
    network = ann_dc.design(PROBLEMS[name](), preconditioner=KINDS).network
    files = pack_files(network, reference_vector(network), level="behavioural", zipped=True)
    assert off(files, tmp_path) < 1e-4


def test_the_library_is_what_the_deck_needs(car, small):
    """No file is missing, and none could be left out."""
    for network in (car, small):
        files = pack_files(*network, level="behavioural")
        library = [name for name in files if name.startswith("library/")]
        assert len(library) >= 5
        included = re.findall(r"^\.include (\S+)$", files["deck.cir"].decode(), re.MULTILINE)
        assert sorted(included) == sorted(library)
    assert "library/func.lib" not in library
    own = {name: text for name, text in files.items() if name.startswith(("library/", "deck"))}
    words = {name: set(re.findall(rb"[a-z_]\w*", text.lower())) for name, text in own.items()}
    for name in library:
        declared = re.findall(rb"^\.(?:subckt|model) (\w+)", own[name], re.MULTILINE)
        others = set().union(*(found for other, found in words.items() if other != name))
        assert {word.lower() for word in declared} & others, name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:level .*its controls are predicted:UserWarning")
def test_the_bill_counts_what_the_deck_has(car):
    files = pack_files(*car, level="tl072_ad633", series="E96")
    rows = [*csv.DictReader(io.StringIO(files["bill.csv"].decode()))]
    count = {}
    for row in rows:
        assert len(row["reference"].split()) == int(row["quantity"])
        count[row["part class"]] = count.get(row["part class"], 0) + int(row["quantity"])
    assert count["op amp"] == 108  # 215 of them, two in a package
    assert (count["multiplier"], count["function generator"]) == (90, 27)
    assert (count["resistor"], count["capacitor"]) == (584, 150)
    resistors = [row for row in rows if row["part class"] == "resistor"]
    for row in resistors:
        assert float(row["to buy"]) == pytest.approx(E96.nearest(float(row["value"])), rel=1e-6)
        assert (row["series"], row["tolerance"], row["package"]) == ("E96", "1 %", "0603")
    assert {row["part"] for row in rows} == {"TL072", "AD633", "R", "C", ""}


def test_the_scaling_sheet_takes_volts_back(car):
    """Expected volts and user's values agree through it."""
    files = pack_files(*car, level="macro")
    sheet = {r["quantity"]: r for r in csv.DictReader(io.StringIO(files["scaling.csv"].decode()))}
    for row in csv.DictReader(io.StringIO(files["expected_controls.csv"].decode())):
        scale = sheet[row["control"]]
        value = float(scale["offset"]) + float(scale["user unit per volt"]) * float(row["volts"])
        assert value == pytest.approx(float(row["expected"]), rel=1e-7)
        product = float(scale["user unit per volt"]) * float(scale["volts per user unit"])
        assert product == pytest.approx(1.0)


def test_expected_waveforms_end_at_the_expected_controls(car):
    files = pack_files(*car, level="macro")
    rows = [*csv.DictReader(io.StringIO(files["expected_waveforms.csv"].decode()))]
    for row in csv.DictReader(io.StringIO(files["expected_controls.csv"].decode())):
        assert float(rows[-1][f"v({row['node']})"]) == pytest.approx(float(row["volts"]), abs=1e-6)


def test_same_input_same_bytes(small):
    packed = pack_files(*small, zipped=True)
    network, vector = small
    assert packed == pack_files(replace(network), vector, zipped=True)
    with zipfile.ZipFile(io.BytesIO(packed["pack.zip"])) as archive:
        assert {n: archive.read(n) for n in archive.namelist()} == pack_files(*small)


@pytest.mark.parametrize("zipped", [False, True])
def test_accuracy_is_stated_zipped_or_not(zipped, small):
    said = stated_in_pack(pack_files(*small, level="behavioural", zipped=zipped))
    assert re.fullmatch(r"A circuit whose controls are .* \(nominal parts\)\. Not run\.", said)


@pytest.mark.filterwarnings("ignore:level .*its controls are predicted:UserWarning")
def test_a_deck_has_the_resistors_of_its_series(small):
    exact, pairs, coarse = (
        pack_files(*small, level="macro", series=series)["deck.cir"]
        for series in ("exact", "E96-pairs", "E12")
    )
    assert len({exact, pairs, coarse}) == 3


def test_what_cannot_be_built_is_refused_by_name(car, small):
    with pytest.raises(UnknownNameError, match="level 'wood' does not exist; choose one of: behav"):
        pack_files(*small, level="wood")
    with pytest.raises(UnknownNameError, match="series 'E7'"):
        pack_files(*small, series="E7")
    with pytest.raises(ExportError, match="have no resistors"):
        pack_files(*small, level="ota-c", series="E24")
    with pytest.raises(ExportError, match="another network than"):
        pack_files(small[0], car[1])
    grid = ann_dc.design(
        ann_dc.plants.double_integrator(N=5),
        preconditioner=ann_dc.PreconditionerKind.RESISTIVE_GRID,
    ).network
    with pytest.raises(ExportError, match="behavioural circuits cannot build a resistive grid"):
        pack_files(grid, reference_vector(grid), level="behavioural")
