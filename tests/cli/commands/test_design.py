"""Designing from the command line: what was compared, why it is slow, files, exit codes."""

import sys

import pytest
from command_line import refused, run, strict

import ann_dc
from ann_dc import solver

WORDS = ["design", "double_integrator", "-N", "5"]


def test_a_design_tells_its_candidates():
    code, text = run(*WORDS)
    assert code == 0
    for word in ("first run", "frozen with", "predicted", "preconditioner", "(frozen)"):
        assert word in text
    assert "why:" not in text


def test_why_is_told_and_written(tmp_path):
    out = tmp_path / "new"
    code, text = run(*WORDS, "--why", "--out", out)
    assert code == 0
    for word in ("times the limit of 2", "why: ", "what would help", "so: "):
        assert word in text
    assert sorted(file.name for file in out.iterdir()) == ["design.json", "network.npz", "why.png"]
    data = strict(out / "design.json")
    assert data["settled"] is True
    assert data["why"]["ratio"] == data["ratio"] >= 2
    assert [row["neuron"] for row in data["why"]["rows"]] == ["mu.x", "mu.v", "beta.x", "beta.v"]
    assert set(data["why"]["modes"][0]["shares"]) == set(data["rho"])
    assert data["why"]["remedies"][-1]["ratio"] == pytest.approx(2.0)
    assert ann_dc.load(out / "network.npz").stages == 5


def test_without_why_nothing_is_drawn(tmp_path):
    code, text = run(*WORDS, "--quiet", "--out", tmp_path)
    assert (code, text) == (0, "")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["design.json", "network.npz"]
    assert "why" not in strict(tmp_path / "design.json")


def test_the_same_command_writes_the_same_bytes(tmp_path):
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        run(*WORDS, "--why", "--out", folder)
    for name in ("design.json", "why.png"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_a_first_run_that_does_not_settle_ends_with_code_1(monkeypatch):
    designed = solver.design
    monkeypatch.setattr(
        solver, "design", lambda network, **options: designed(network, limit=25, **options)
    )
    code, text = run(*WORDS, "--why")
    assert code == 1
    assert "did not settle in 25 recurrent steps" in text
    assert "why:" not in text


def test_an_unwritable_folder_is_told_before_the_design(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.solver.design", lambda *_, **__: pytest.fail("ran all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run(*WORDS, "--out", blocked / "out")
    assert code == 2
    assert "cannot be written" in text or "cannot be created" in text
    assert blocked.read_text() == "kept"


FAMILY = [*WORDS, "--over", "q_d.x=0.5:2", "--over", "q_0.v=-0.5:0.5", "--held-out", "20"]


@pytest.mark.slow
def test_a_family_tells_its_share_and_writes_three_files(tmp_path):
    out = tmp_path / "new"
    code, text = run(*FAMILY, "--out", out)
    assert code == 0
    for word in ("q_d.x from 0.5 to 2", "16 settled points", "20 of 20 settle", "99 of 100 within"):
        assert word in text
    names = ["design.json", "family.png", "network.npz"]
    assert sorted(file.name for file in out.iterdir()) == names
    data = strict(out / "design.json")
    assert data["ranges"] == {"q_d.x": [0.5, 2.0], "q_0.v": [-0.5, 0.5]}
    assert (data["held_out"], data["certified"], data["share"]) == (20, 20, 1.0)
    assert data["interval"][0] < data["share"] <= data["interval"][1]
    assert data["settling"]["median"] <= data["settling"]["99 of 100"] <= data["settling"]["worst"]
    assert data["failures"] == []
    assert ann_dc.load(out / "network.npz").ranges == {"q_d.x": (0.5, 2.0), "q_0.v": (-0.5, 0.5)}


@pytest.mark.slow
def test_the_same_family_writes_the_same_bytes_and_another_seed_others(tmp_path):
    folders = {name: tmp_path / name for name in ("one", "two", "other")}
    for name, folder in folders.items():
        run(*FAMILY, "--quiet", "--seed", 7 if name == "other" else 0, "--out", folder)
    for name in ("design.json", "family.png"):
        assert (folders["one"] / name).read_bytes() == (folders["two"] / name).read_bytes()
    # a linear problem has the same gains and settling for any samples: the picture shows them
    pictures = [(folders[name] / "family.png").read_bytes() for name in ("one", "other")]
    assert pictures[0] != pictures[1]


@pytest.mark.slow
def test_a_family_with_too_many_failures_ends_with_code_1(monkeypatch):
    monkeypatch.setattr(sys.modules["ann_dc.cli.commands.design"], "ENOUGH", 1.01)
    code, text = run(*FAMILY, "--kinds", "multilevel")
    assert code == 1
    assert "20 of 20 settle" in text
    assert "multilevel from" in text


BAD = {
    "no range": (["--over", "q_d.x"], "--over: expected INPUT=LOW:HIGH"),
    "one end": (["--over", "q_d.x=3"], "--over: expected INPUT=LOW:HIGH"),
    "words": (["--over", "q_d.x=near:far"], "got 'q_d.x=near:far'"),
    "backwards": (["--over", "q_d.x=7:3"], "the range from 7 to 3 is empty"),
    "no input": (["--over", "q_d.z=3:7"], "input 'q_d.z' does not exist"),
    "twice": (["--over", "q_d.x=1:2", "--over", "q_d.x=2:3"], "q_d.x is given twice"),
    "not finite": (["--over", "q_d.x=1:inf"], "not finite"),
    "none held out": (["--over", "q_d.x=1:2", "--held-out", "0"], "--held-out"),
    "refined": (["--over", "q_d.x=1:2", "--refine"], "goes with neither --refine nor --why"),
    "why": (["--over", "q_d.x=1:2", "--why"], "goes with neither --refine nor --why"),
    "started": (["--over", "q_d.x=1:2", "--start", "random"], "nor a start"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_a_family_that_is_none_is_told_in_a_sentence_with_code_2(words, meaning):
    refused([*WORDS, *words], meaning)
