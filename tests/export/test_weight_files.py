"""Weight files beside their manifest and a reference vector: as exported, or refused."""

import json

import numpy as np
import pytest
from designs import coordinated, designed, small

import ann_dc
from ann_dc.errors import ExportError, FileFormatError, UnknownNameError
from ann_dc.export.catalogue import FORMATS
from ann_dc.export.reference.vector import reference_vector
from ann_dc.export.weight_files import csv_files, weights_files

WAYS = {
    "safetensors": (weights_files, FORMATS["weights"].check, "network.safetensors"),
    "npz": (
        lambda *given: weights_files(*given, form="npz"),
        FORMATS["weights"].check,
        "network.npz",
    ),
    "tables": (csv_files, FORMATS["csv"].check, "tensors.csv"),
}
NETWORKS = {
    "grid": lambda: designed("car").network,
    "pyramid": lambda: coordinated("double_integrator"),
    "two stages": lambda: ann_dc.design(ann_dc.plants.double_integrator(N=2)).network,
}


@pytest.fixture(scope="module", params=WAYS)
def exported(request):
    network = designed("double_integrator").network
    files, check, main = WAYS[request.param]
    return files(network, reference_vector(network)), check, main


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", NETWORKS)
def test_what_was_exported_walks_as_its_vector(name, way):
    network, (files, check, _) = NETWORKS[name](), WAYS[way]
    found = check(files(network, reference_vector(network)))
    assert found.endswith("50 steps within 0.0e+00 of the reference vector")


def test_equal_networks_give_equal_files(exported):
    network = designed("double_integrator").network
    files, _, main = exported
    again = weights_files(network, reference_vector(network))
    assert files.get(main) == again.get(main, files[main])
    assert files["manifest.json"] == again["manifest.json"]


def test_every_file_is_needed(exported):
    files, check, _ = exported
    for name in files:
        with pytest.raises(FileFormatError, match=r"missing|expected one of"):
            check({other: content for other, content in files.items() if other != name})


def test_one_bit_of_any_file_counts(exported):
    files, check, _ = exported
    for name, content in files.items():
        if name in ("reference_vector.json", "weights.csv", "tensors.csv"):
            continue  # of tables the index has the hash
        for place in range(0, len(content), max(1, len(content) // 25)):
            changed = content[:place] + bytes([content[place] ^ 4]) + content[place + 1 :]
            try:
                check({**files, name: changed})
            except FileFormatError:
                continue
            # a byte that says nothing: the date of an entry, or a blank between words
            assert name.endswith(".npz") or content[place : place + 1].isspace(), (name, place)


@pytest.mark.parametrize("key", ["content", "step", "start", "steps", "residual", "end"])
def test_another_vector_is_refused(exported, key):
    files, check, _ = exported
    table = json.loads(files["reference_vector.json"])
    end = np.array(table["end"])
    table[key] = {
        "content": "0" * 64, "step": 2 * table["step"], "start": [[0.0]], "steps": 3,
        "residual": 0.0, "end": (end + 1e-4 * (end != 0)).tolist(),
    }[key]  # fmt: skip
    with pytest.raises(FileFormatError, match=r"reference.vector|manifest|does not fit"):
        check({**files, "reference_vector.json": json.dumps(table).encode()})


def test_a_vector_of_another_network_is_refused():
    vector = reference_vector(designed("double_integrator").network)
    for files, _, _ in WAYS.values():
        with pytest.raises(ExportError, match="vector: belongs to another network than 'car'"):
            files(small("car"), vector)


def test_a_form_that_there_is_not():
    network = designed("double_integrator").network
    with pytest.raises(UnknownNameError, match="form 'onnx' does not exist; choose one of: safet"):
        weights_files(network, reference_vector(network), form="onnx")


TABLES = {
    "another head": (lambda text: text.replace("value", "number", 1), "KeyError: 'value'"),
    "a line more": (lambda text: text + "weight,,,1\n", "unknown entries: weight"),
    "a line less": (lambda text: text[: text.rindex("\n", 0, -1) + 1], "cannot reshape"),
    "a word": (lambda text: text.replace(",-inf", ",none", 1), "ValueError: could not convert"),
    "another number": (lambda text: text.replace(",1.0\n", ",2.0\n", 1), "manifest.hashes.content"),
    "open quotes": (lambda text: text + '"', "export it again"),
    "a shape without end": (lambda text: text + "x,9999999999 9999999999,0 0,1.0\n", "unknown"),
    "another array": (lambda text: text + "x,,,1.0\n", "unknown entries: x"),
    "nothing": (lambda text: "", "is missing"),
}


@pytest.mark.parametrize("case", TABLES)
def test_hostile_tables(case):
    change, message = TABLES[case]
    network = designed("double_integrator").network
    files = csv_files(network, reference_vector(network))
    changed = change(files["tensors.csv"].decode()).encode()
    with pytest.raises(FileFormatError, match=message):
        FORMATS["csv"].check({**files, "tensors.csv": changed})
