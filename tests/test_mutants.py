"""Thousands of changed files: each is the one that it was, or is refused by an error of ours.

None crashes, hangs, or takes more memory than its size allows. Of a file whose hashes were made
anew it cannot be said that it was changed: those may load, as what they say.
"""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import mutants
import pytest
from designs import coordinated, designed, small
from minimax import CASES, car

import ann_dc
from ann_dc.export.reference.vector import reference_vector
from ann_dc.network.cell import Cell, Connection, Neuron
from ann_dc.network.network import Network
from ann_dc.problem import plants
from ann_dc.weights.entries import packed_tensors
from ann_dc.weights.network_file import save, written

OLD = Path(__file__).parent / "weights" / "double_integrator.npz"


@pytest.fixture(scope="module")
def originals(tmp_path_factory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("originals")
    networks = {
        "plain": small("double_integrator"),
        "grid": designed("car").network,
        "pyramid": coordinated("car"),
        "shared": ann_dc.synthesize(car(CASES["two by range"][0])),
    }
    for name, network in networks.items():
        save(network, folder / f"{name}.npz")
        save(network, folder / f"{name}.safetensors")
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    files["stored.npz"] = OLD.read_bytes()
    files["vector.json"] = reference_vector(designed("double_integrator").network).as_json()
    ann_dc.solve(plants.double_integrator(N=3)).save(folder / "solution")
    files["solution.folder"] = mutants.folder_as_bytes(folder / "solution")
    return files


def what_became_of(folder: Path) -> dict[str, dict]:
    """By the name of the file; they are opened by another process, under a limit each."""
    run = subprocess.run(
        [sys.executable, mutants.__file__, folder], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    return {found["file"]: found for found in map(json.loads, run.stdout.splitlines())}


def judged(originals: dict[str, bytes], count: int, seed: int, folder: Path) -> dict[str, int]:
    """How many of the changed files were opened and refused; fails with those that should not."""
    place = folder / "mutants"
    place.mkdir()
    made = list(mutants.mutants(originals, count, seed))
    for mutant in made:
        mutants.written(place, mutant.name, mutant.content)
    whole = {
        name: mutants.opened(mutants.written(folder, name, content))
        for name, content in originals.items()
    }
    found = what_became_of(place)
    wrong = [found[m.name] for m in made if is_wrong(found[m.name], m, whole)]
    assert not wrong, (len(wrong), wrong[:3])
    return Counter(word for line in found.values() for word in line)


def is_wrong(found: dict, mutant: mutants.Mutant, whole: dict[str, str]) -> bool:
    if "broken" in found or found["seconds"] > mutants.LONGEST:
        return True
    if "holds" in found:
        return not mutant.other and found["holds"] != whole[mutant.name.partition("_")[2]]
    return "memory" in found["refused"]


def test_a_hundred_changed_files(originals, tmp_path):
    counts = judged(originals, count=100, seed=1, folder=tmp_path)
    assert counts["refused"] > 65
    assert counts["holds"] > 1


@pytest.mark.slow
def test_thousands_of_changed_files(originals, tmp_path):
    counts = judged(originals, count=5000, seed=2, folder=tmp_path)
    assert counts["refused"] > 4000


def of_manifest(change) -> bytes:
    """The file of two neurons, its manifest changed and its hashes made anew."""
    decay = Connection(source="x", target="x", weight=-1.0)
    cell = Cell(neurons=(Neuron(name="x"), Neuron(name="y")), connections=(decay,))
    text, arrays = written(Network(cell=cell, stages=3))
    table = json.loads(text)
    change(table)
    return packed_tensors(mutants.sealed_anew(json.dumps(table), arrays), arrays)


def as_header(text: bytes) -> bytes:
    return len(text).to_bytes(8, "little") + text


GREEDY = {
    "a long row": of_manifest(lambda table: table.update(stages=10**6)),
    "absent everywhere": of_manifest(
        lambda table: table.update(
            stages=30_000, omitted=[{"neuron": "y", "stage": k} for k in range(30_000)]
        )
    ),
    "absent twice": of_manifest(
        lambda table: table.update(omitted=[{"neuron": "y", "stage": 1}] * 50_000)
    ),
    "empty tables": of_manifest(lambda table: table.update(omitted=[{}] * 90_000)),
    "keys": of_manifest(
        lambda table: table.update(left_boundary={f"{k:x}": 0 for k in range(90_000)})
    ),
    "names": of_manifest(lambda table: table.update(inputs=[f"{k:x}" for k in range(150_000)])),
    "a header of keys": as_header(json.dumps({f"{k:x}": 0 for k in range(330_000)}).encode()),
    "a header of numbers": as_header(b"[" + b"257," * 900_000 + b"1]"),
    "a header of tables": as_header(b"[" + b"{}," * 190_000 + b"1]"),
    "a header of wide letters": as_header(
        ('["' + "\N{MUSICAL SYMBOL G CLEF}" * 900_000 + '"]').encode()
    ),
}


@pytest.mark.slow
def test_greedy_files(tmp_path):
    """A small file that says much takes at most what its size allows."""
    for name, content in GREEDY.items():
        (tmp_path / f"{name}.safetensors").write_bytes(content)
    found = what_became_of(tmp_path)
    assert len(found) == len(GREEDY)
    for line in found.values():
        assert "broken" not in line, line
        assert "memory" not in line.get("refused", ""), line
        assert line["seconds"] < mutants.LONGEST, line
    held = {name.partition(".")[0] for name, line in found.items() if "holds" in line}
    assert held == {"a long row", "absent everywhere", "absent twice"}
