"""What `inspect_export` says of files that are what they were, and of those that are not."""

import hashlib
import json
import sys

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


def test_one_bit_is_found(exported):
    file = exported / "conductances.csv"
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    [found] = inspect_export(exported)
    assert not found.good
    assert "conductances.csv" in found.wrong
    assert "SHA-256" in found.wrong


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"schema": 2}, "schema"),
        ({"schema": True}, "schema"),
        ({"to": "nix"}, "'nix' is none"),
        ({"files": {"../secret": "0"}}, "no name of a file"),
        ({"files": {"/etc/passwd": "0"}}, "no name of a file"),
        ({"files": {".lock": "0"}}, "no name of a file"),
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
    assert "export.json: not what was written" in found.wrong


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
