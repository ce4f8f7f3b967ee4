"""A result's folder is complete or refused: damaged, half written, of another version, hostile."""

import hashlib
import io
import json
import os
import pickle
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from network_files import entry, rewritten

import ann_dc
from ann_dc import plants
from ann_dc.errors import FileFormatError, OutputError
from ann_dc.solution.saved_result import opened_result, save_result


@pytest.fixture(scope="module")
def solution():
    problem = plants.double_integrator(N=3)
    gains = ann_dc.manual_gains(ann_dc.synthesize(problem), rho=1.0, tau=0.5)
    return ann_dc.solve(problem, gains=gains, backend=ann_dc.OdeBackend(verify=False))


@pytest.fixture
def folder(solution, tmp_path):
    solution.save(tmp_path / "saved")
    return tmp_path / "saved"


def summed(folder):
    """The folder with sums that fit its files: what somebody who means harm would write."""
    names = sorted(file.name for file in folder.iterdir() if file.name != "SHA256SUMS")
    digest = lambda name: hashlib.sha256((folder / name).read_bytes()).hexdigest()  # noqa: E731
    (folder / "SHA256SUMS").write_text("".join(f"{digest(name)}  {name}\n" for name in names))


def with_manifest(folder, change):
    file = folder / "manifest.json"
    table = json.loads(file.read_text(encoding="utf-8"))
    change(table)
    file.write_text(json.dumps(table), encoding="utf-8")
    summed(folder)


def refused(folder, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        ann_dc.load_solution(folder)
    assert str(caught.value).startswith(str(folder))


def test_the_sums_are_those_of_coreutils(folder):
    lines = (folder / "SHA256SUMS").read_text().splitlines()
    assert lines
    for line in lines:
        digest, name = line.split("  ")
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest


def test_the_manifest_can_be_read_by_a_person(folder, solution):
    table = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert table["records"]["problem"]["cost"] == ["(1/2)*a**2"]
    assert table["records"]["run"]["status"]["message"] == solution.status.message


def test_another_version_is_refused_with_what_to_do(folder):
    with_manifest(folder, lambda table: table.update(schema=3))
    refused(folder, "schema: expected 2, got 3; load the file with the version")


@pytest.mark.parametrize("name", ["manifest.json", "arrays.npz", "network.npz", "SHA256SUMS"])
def test_a_file_that_is_damaged_missing_or_cut_off_is_refused(folder, name):
    file = folder / name
    content = file.read_bytes()
    rng = np.random.default_rng(3)
    for place in rng.integers(0, len(content), 5):
        damaged = bytearray(content)
        damaged[place] ^= 0x01
        file.write_bytes(damaged)
        with pytest.raises(FileFormatError):
            ann_dc.load_solution(folder)
    file.write_bytes(content[: len(content) // 2])
    refused(folder, "changed after it was saved|is not a valid line|does not name")
    file.unlink()
    refused(folder, f"{name}|SHA256SUMS")


@pytest.mark.parametrize("size", [0, 1, 21, 300])
def test_arrays_that_are_no_archive_are_refused(folder, size):
    (folder / "arrays.npz").write_bytes((folder / "arrays.npz").read_bytes()[:size])
    summed(folder)
    refused(folder, "not a complete result")


LINES = {
    "a path": "{digest}  ../network.npz",
    "an absolute path": "{digest}  /etc/passwd",
    "a path with a backslash": "{digest}  ..\\network.npz",
    "a short digest": "abc  network.npz",
    "a file twice": "{digest}  network.npz",
    "a hidden file": "{digest}  .npz",
}


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_no_sum_leads_out_of_the_folder(folder, line):
    digest = hashlib.sha256((folder / "network.npz").read_bytes()).hexdigest()
    with (folder / "SHA256SUMS").open("a") as sums:
        sums.write(line.format(digest=digest) + "\n")
    refused(folder, "SHA256SUMS: .* is not a valid line")


@pytest.mark.parametrize("name", ["../network", "/etc/passwd", "", "nothing", "arrays", "a\x00b"])
def test_no_network_leads_out_of_the_folder(folder, name):
    with_manifest(folder, lambda table: table.update(networks=[name]))
    refused(folder, "SHA256SUMS: does not name")


def test_a_file_that_no_network_needs_is_refused(folder):
    (folder / "more.npz").write_bytes((folder / "network.npz").read_bytes())
    summed(folder)
    refused(folder, "names more.npz, which the manifest does not")


CHANGES = {
    "no table": (lambda t: t.clear(), "does not contain 'ann_dc solution'"),
    "a network's": (lambda t: t.update(format="ann_dc network"), "save the solution again"),
    "unknown key": (lambda t: t.update(code="import os"), "unknown key code"),
    "unknown record": (lambda t: t["records"].update(more={}), "unknown more"),
    "no records": (lambda t: t.update(records=[]), "records: expected dict"),
    "run is a word": (lambda t: t["records"].update(run="x"), "run: expected a table, got 'x'"),
    "unknown field": (lambda t: t["records"]["run"].update(x=1), "run: unknown key x"),
    "missing field": (lambda t: t["records"]["run"].pop("steps"), "run/steps: missing"),
    "a word for a number": (
        lambda t: t["records"]["run"].update(tolerance="1e-6; import os"),
        "run/tolerance: expected float",
    ),
    "a bool for a number": (
        lambda t: t["records"]["run"].update(steps=True),
        "run/steps: expected int, got True",
    ),
    "a number beyond any": (
        lambda t: t["records"]["run"].update(tolerance=10**400),
        "run/tolerance: expected float",
    ),
    "unknown outcome": (
        lambda t: t["records"]["run"]["status"].update(outcome="__class__"),
        "run/status/outcome: '__class__' does not exist; choose one of: SETTLED",
    ),
    "an array by another name": (
        lambda t: t["records"]["run"]["trajectory"].update(states="../network.npz"),
        "run/trajectory/states: '../network.npz' does not exist; choose one of: float, complex",
    ),
    "a formula that is code": (
        lambda t: t["records"]["problem"].update(cost=["__import__('os').system('true')"]),
        "cost: .*is not allowed",
    ),
    "another horizon": (
        lambda t: t["records"]["problem"].update(horizon=4),
        "not belong to the problem",
    ),
    "deep": (lambda t: t["records"].update(run=json.loads("[" * 900 + "]" * 900)), "a table"),
}


@pytest.mark.parametrize(("change", "message"), CHANGES.values(), ids=CHANGES)
def test_a_manifest_that_was_changed_is_refused_by_the_place(folder, change, message):
    with_manifest(folder, change)
    refused(folder, message)


def test_a_manifest_that_nests_beyond_measure_is_refused(folder):
    (folder / "manifest.json").write_text("[" * 200_000 + "]" * 200_000)
    summed(folder)
    refused(folder, "not JSON")


def test_objects_are_never_unpickled(folder):
    class Trap:
        def __reduce__(self):
            return os.system, (f"touch {folder}/sprung",)

    trap = entry(np.array([Trap()], dtype=object), allow_pickle=True)
    rewritten(folder / "arrays.npz", lambda e: e.update({"run/trajectory/states": trap}))
    summed(folder)
    refused(folder, "objects are never unpickled")
    (folder / "arrays.npz").write_bytes(pickle.dumps(Trap()))
    summed(folder)
    refused(folder, "not a complete result")
    assert not (folder / "sprung").exists()


ARRAYS = {
    "missing": (lambda e: e.pop("run/trajectory/states"), "states' is missing"),
    "more": (lambda e: e.update({"../../evil": entry(np.zeros(2))}), "unknown entries"),
    "integers": (lambda e: e.update({"run/trajectory/time": entry(np.zeros(2, int))}), "int64"),
    "another shape": (
        lambda e: e.update({"run/trajectory/states": entry(np.zeros((4, 2)))}),
        r"'run/trajectory/states' has shape \(4, 2\), expected \(T n\)",
    ),
    "empty": (lambda e: e.update({"run/trajectory/time": entry(np.zeros(0))}), r"shape \(0,\)"),
    "too few residuals": (
        lambda e: e.update({"run/trajectory/residuals": entry(np.zeros((2, 2)))}),
        "residuals' has shape",
    ),
    "roll-out": (lambda e: e.update({"certificate/rollout": entry(np.zeros((2, 9)))}), "rollout"),
}


@pytest.mark.parametrize(("change", "message"), ARRAYS.values(), ids=ARRAYS)
def test_arrays_that_were_changed_are_refused_by_their_names(folder, change, message):
    rewritten(folder / "arrays.npz", change)
    summed(folder)
    refused(folder, message)


def test_arrays_that_claim_more_than_the_file_has_are_refused(folder):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("run/trajectory/time.npy", bytes(10_000_000))
    (folder / "arrays.npz").write_bytes(stream.getvalue())
    summed(folder)
    refused(folder, "claim to be larger")


@pytest.mark.parametrize("place", ["nothing", "file", "\x00"])
def test_what_is_no_folder_is_refused(tmp_path, place):
    (tmp_path / "file").write_text("kept")
    with pytest.raises(FileFormatError, match=r"use the path of a folder"):
        ann_dc.load_solution(tmp_path / place)


def test_a_folder_of_something_else_is_refused(tmp_path):
    refused(tmp_path, "SHA256SUMS' does not exist")


def test_what_nobody_takes_is_refused(folder):
    with pytest.raises(FileFormatError, match="unknown"), opened_result(folder) as saved:
        assert saved.network("network").stages == 3
    with pytest.raises(FileFormatError, match="'other' is missing"), opened_result(folder) as saved:
        saved.network("other")


def test_what_cannot_be_saved_leaves_nothing(tmp_path, solution):
    for thing in (object(), {"x": np.array([1, 2])}, {"x": 1j}):
        with pytest.raises(OutputError, match=r"thing.* cannot be saved"):
            save_result(tmp_path / "new", {}, {"thing": thing})
    with pytest.raises(OutputError, match="in an existing, writable folder"):
        solution.save(tmp_path / "no" / "folder")
    assert list(tmp_path.iterdir()) == []


SAVER = """
import os, pickle, random, signal, sys, time
solution = pickle.load(sys.stdin.buffer)
chance = random.Random(7)
solution.save(f"{sys.argv[1]}/warm")
for number in range(20):
    child = os.fork()
    if child == 0:
        for turn in range(1000):
            solution.save(f"{sys.argv[1]}/{number}-{turn:03}")
    time.sleep(chance.uniform(0.0, 0.06))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="kills a process that was forked")
def test_killed_at_twenty_moments_a_folder_is_complete_or_refused(tmp_path, solution):
    """SIGKILL while folders are being written: no name stands for half a result."""
    subprocess.run(
        [sys.executable, "-c", SAVER, tmp_path],
        input=pickle.dumps(solution), check=True, timeout=120,
        cwd=Path(ann_dc.__file__).parents[1],
    )  # fmt: skip
    saved = sorted(folder for folder in tmp_path.iterdir() if not folder.name.startswith("."))
    halves = [folder for folder in tmp_path.iterdir() if folder.name.startswith(".")]
    assert halves, "no kill met a folder that was being written"
    for number in range(20):  # the last of every process: those before it are like it
        for folder in [f for f in saved if f.name.startswith(f"{number}-")][-1:]:
            assert ann_dc.load_solution(folder).verdict == solution.verdict
    for folder in halves:
        try:
            assert ann_dc.load_solution(folder).verdict == solution.verdict
        except FileFormatError as error:
            assert str(folder) in str(error)  # noqa: PT017
