"""Inspection of unchanged files, and of changed, missing and foreign ones."""

import hashlib
import json
import shutil
import sys
from functools import cache
from pathlib import Path

import pytest
from designs import designed

import ann_dc
from ann_dc.errors import FileFormatError
from ann_dc.export.catalogue import inspect_export
from ann_dc.export.exporting import export_network
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network

FORMAT = "conductances"


@pytest.fixture
def exported(tmp_path):
    export_network(designed("double_integrator").network, FORMAT, tmp_path)
    return tmp_path / FORMAT


@pytest.mark.parametrize("ending", ["npz", "safetensors"])
def test_a_weight_file_is_counted_and_let_settle(tmp_path, ending):
    network = designed("double_integrator").network
    ann_dc.save(network, tmp_path / f"network.{ending}")
    [found] = inspect_export(tmp_path / f"network.{ending}")
    assert found.good
    assert found.facts["neurons"] == f"{network.size} in {network.stages} cells"
    assert found.facts["settles"].startswith("settled")


def test_a_network_that_does_not_settle_is_not_well(tmp_path):
    wire = Connection(source="x", target="x")
    cell = Cell(neurons=(Neuron(name="x"),), connections=(wire,))
    network = Network(cell=cell, stages=2, start={"x": 1.0})
    ann_dc.save(network, tmp_path / "network.npz")
    [found] = inspect_export(tmp_path / "network.npz")
    assert not found.good
    assert "does not settle" in found.wrong


FOLDERS = ["weights", "csv", "conductances", "diagram", "latex", "kicad", "pack", "c99"]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Exports of a network to files of every sort: numbers, pictures, text, netlists, code."""
    network = designed_with_time_constants()
    place = tmp_path_factory.mktemp("folders")
    assert not any(done.why_not for done in export_network(network, FOLDERS, place))
    return place


@cache
def designed_with_time_constants():
    kind = ann_dc.PreconditionerKind.DIAGONAL
    return ann_dc.design(ann_dc.plants.double_integrator(N=3), preconditioner=kind).network


def files_in(folder):
    return [file for file in sorted(folder.rglob("*")) if file.is_file()]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", FOLDERS)
def test_a_changed_bit_of_any_file_is_found(name, folders, tmp_path):
    """A missing file and one of another network are refused too."""
    folder = Path(shutil.copytree(folders / name, tmp_path / name))
    other = designed_with_time_constants().with_inputs({"q_d.x": 2.0})
    export_network(other, name, tmp_path / "other")
    for file in files_in(folder):
        content = file.read_bytes()
        flipped = bytearray(content)
        flipped[len(content) // 2] ^= 1
        foreign = tmp_path / "other" / name / file.relative_to(folder)
        for changed in (bytes(flipped), content[:-1], foreign.read_bytes(), None):
            if changed == content:
                continue
            file.unlink() if changed is None else file.write_bytes(changed)
            if changed is None and file.name == "export.json":
                with pytest.raises(FileFormatError, match="no folder that ann-dc export wrote"):
                    inspect_export(folder)
                continue
            [found] = inspect_export(folder)
            assert not found.good
            assert file.name in found.wrong or file.name == "export.json"
        file.write_bytes(content)
    assert inspect_export(folder)[0].good


def listed_anew(folder, **changes):
    """Write files and an index that has their hashes; None takes a file away."""
    index = folder / "export.json"
    table = json.loads(index.read_text())
    for name, content in changes.items():
        table["files"].pop(name, None)
        (folder / name).unlink(missing_ok=True)
        if content is not None:
            (folder / name).write_bytes(content)
            table["files"][name] = hashlib.sha256(content).hexdigest()
    del table["sha256"]
    table["sha256"] = hashlib.sha256(json.dumps(table).encode()).hexdigest()
    index.write_text(json.dumps(table, indent=1) + "\n")


@pytest.mark.parametrize("name", FOLDERS)
def test_a_file_of_no_format_is_found_behind_good_hashes(name, folders, tmp_path):
    folder = Path(shutil.copytree(folders / name, tmp_path / name))
    listed_anew(folder, **{"evil.exe": b"MZ"})
    [found] = inspect_export(folder)
    assert not found.good
    assert "evil.exe" in found.wrong


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("diagram", "cell.svg"),
        ("latex", "reference_vector.json"),
        ("kicad", "circuit.net"),
        ("pack", "deck.cir"),
        ("weights", "network.safetensors"),
    ],
)
def test_a_missing_file_is_found_behind_good_hashes(name, file, folders, tmp_path):
    folder = Path(shutil.copytree(folders / name, tmp_path / name))
    listed_anew(folder, **{file: None})
    [found] = inspect_export(folder)
    assert found.wrong == f"{file}: missing; export the network again"


def test_numbers_of_another_network_are_found_behind_good_hashes(folders, tmp_path):
    """Files that are run do not take the steps of the vector."""
    folder = Path(shutil.copytree(folders / "conductances", tmp_path / "conductances"))
    notes = json.loads((folder / "conductances.json").read_text())
    notes["scales_S"] = {node: f"{float(k) * 1.01!r}" for node, k in notes["scales_S"].items()}
    listed_anew(folder, **{"conductances.json": json.dumps(notes).encode()})
    said = "conductances.json.weight_error: 0, but the weights of the table are 0.0099 off"
    assert said in inspect_export(folder)[0].wrong
    listed_anew(folder, **{"conductances.json": b"{}"})
    assert "conductances.json" in inspect_export(folder)[0].wrong


def test_a_program_is_not_loaded_from_a_folder(tmp_path, monkeypatch):
    """Loading may execute what somebody has put into the file, whoever has hashed it."""
    torch = pytest.importorskip("torch", reason="the package torch is not installed")
    [done] = export_network(designed_with_time_constants(), "torch_program", tmp_path)
    assert "50 steps" in done.worth
    loads = []
    monkeypatch.setattr(torch.export, "load", loads.append)
    [found] = inspect_export(tmp_path)
    assert found.good
    assert found.facts["checked"].startswith("hashes alone; not run")
    assert loads == []


def test_a_zipped_pack_is_checked_by_its_hash(tmp_path):
    network = designed_with_time_constants()
    [done] = export_network(network, "pack", tmp_path, level="behavioural", zipped=True)
    [found] = inspect_export(tmp_path)
    assert found.good
    assert found.facts["checked"] == done.worth
    assert "controls are predicted to be off by" in done.worth
    listed_anew(tmp_path / "pack", **{"pack.zip": b"PK"})
    assert "BadZipFile" in inspect_export(tmp_path)[0].wrong


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"schema": 2}, "schema"),
        ({"schema": True}, "schema"),
        ({"to": "nix"}, "'nix' is none"),
        ({"files": {"../secret": "0"}}, "not the name of a file"),
        ({"files": {"/etc/passwd": "0"}}, "not the name of a file"),
        ({"files": {".lock": "0"}}, "not the name of a file"),
        ({"files": {"gone.csv": "0"}}, "gone.csv"),
        ({"more": 1}, "unknown key more"),
        ({"title": 3}, "title"),
    ],
)
def test_an_index_is_read_with_distrust(exported, change, named):
    index = exported / "export.json"
    index.write_text(json.dumps(json.loads(index.read_text()) | change))
    [found] = inspect_export(exported)
    assert not found.good
    assert named in found.wrong


@pytest.mark.parametrize("key", ["wiring", "content", "title", "version", "sha256"])
def test_one_letter_of_the_index_is_found(exported, key):
    index = exported / "export.json"
    given = json.loads(index.read_text())[key]
    other = ("2" if given[0] == "1" else "1") + given[1:]
    index.write_text(index.read_text().replace(f'"{key}": "{given}"', f'"{key}": "{other}"'))
    [found] = inspect_export(exported)
    assert not found.good
    assert "export.json: changed after it was written" in found.wrong


@pytest.mark.parametrize("key", ["wiring", "content"])
def test_an_index_of_another_network_is_found(exported, key):
    """Also where somebody has written its hash anew."""
    index = exported / "export.json"
    table = json.loads(index.read_text()) | {key: "0" * 64}
    del table["sha256"]
    table["sha256"] = hashlib.sha256(json.dumps(table).encode()).hexdigest()
    index.write_text(json.dumps(table, indent=1) + "\n")
    [found] = inspect_export(exported)
    assert "another network than reference_vector.json" in found.wrong


def test_a_missing_package_is_not_wrong(tmp_path, monkeypatch):
    pytest.importorskip("nir", reason="the package nir is not installed")
    export_network(designed("double_integrator").network, "nir", tmp_path)
    monkeypatch.setitem(sys.modules, "nir", None)
    [found] = inspect_export(tmp_path)
    assert found.good
    assert found.facts["checked"].startswith("hashes alone; not run: nir is not installed")


def test_several_are_looked_into(exported):
    export_network(designed("double_integrator").network, "diagram", exported.parent)
    assert [found.kind for found in inspect_export(exported.parent)] == [FORMAT, "diagram"]


def test_what_is_nothing_of_the_kind_is_refused(tmp_path):
    for place in (tmp_path, tmp_path / "gone", tmp_path / "gone.npz"):
        with pytest.raises(FileFormatError, match=r"no weight file .* and no folder"):
            inspect_export(place)


def test_a_file_with_inputs_over_time_is_run_at_time_zero(tmp_path):
    network = ann_dc.design(ann_dc.plants.double_integrator(N=3)).network
    target = ann_dc.Waveform(times=[0.0, 9.0], values=[1.0, 2.0])
    ann_dc.save(network.with_inputs({"q_d.x": target}), tmp_path / "moving.npz")
    [found] = inspect_export(tmp_path / "moving.npz")
    assert found.good
    assert found.facts["inputs over time"].startswith("q_d.x")
