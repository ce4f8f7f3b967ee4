"""Thousands of changed files: each is the one that it was, or is refused by an error of ours.

None crashes, hangs, or takes more memory than its size allows. Of a file whose hashes were made
anew it cannot be said that it was changed: those may load, as what they say.
"""

import json
import subprocess
import sys
from pathlib import Path

import mutants
import pytest
from designs import coordinated, designed, small
from minimax import CASES, car

import ann_dc
from ann_dc.export.reference import reference_vector
from ann_dc.export.weights import save

OLD = Path(__file__).parent / "double_integrator.npz"


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
    files["schema_1.npz"] = OLD.read_bytes()
    files["vector.json"] = reference_vector(designed("double_integrator").network).as_json()
    return files


def judged(originals: dict[str, bytes], count: int, seed: int, folder: Path) -> dict[str, int]:
    """How many of the changed files were opened and refused; fails with those that should not."""
    place = folder / "mutants"
    place.mkdir()
    made = {mutant.name: mutant for mutant in mutants.mutants(originals, count, seed)}
    for mutant in made.values():
        (place / mutant.name).write_bytes(mutant.content)
    whole = {}
    for name, content in originals.items():
        (folder / name).write_bytes(content)
        whole[name] = mutants.opened(folder / name)
    run = subprocess.run(
        [sys.executable, mutants.__file__, place], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    found = [json.loads(line) for line in run.stdout.splitlines()]
    assert len(found) == count
    wrong = [line for line in found if is_wrong(line, made[line["file"]], whole)]
    assert not wrong, (len(wrong), wrong[:3])
    return {"held": sum("holds" in f for f in found), "refused": sum("refused" in f for f in found)}


def is_wrong(found: dict, mutant: mutants.Mutant, whole: dict[str, str]) -> bool:
    if "broken" in found or found["seconds"] > mutants.LONGEST:
        return True
    if "holds" in found:
        return not mutant.other and found["holds"] != whole[mutant.name.partition("_")[2]]
    return "memory" in found["refused"]


def test_hundreds_of_changed_files(originals, tmp_path):
    counts = judged(originals, count=300, seed=1, folder=tmp_path)
    assert counts["refused"] > 200
    assert counts["held"] > 5


@pytest.mark.slow
def test_thousands_of_changed_files(originals, tmp_path):
    counts = judged(originals, count=5000, seed=2, folder=tmp_path)
    assert counts["refused"] > 4000
