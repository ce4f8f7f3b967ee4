"""Designing from the command line: what was compared, why it is slow, files, exit codes."""

import sys

import pytest
from command_line import printed_json, refused, run, strict

import ann_dc
from ann_dc import solver

WORDS = ["design", "double_integrator", "-N", "5"]


def test_a_design_tells_its_candidates():
    code, text = run(*WORDS)
    assert code == 0
    for word in (
        "scheduled run",
        "predicted",
        "preconditioner",
        "selected",
        "(tau_min)",
    ):
        assert word in text
    assert "why:" not in text


def test_why_is_told_and_written(tmp_path):
    out = tmp_path / "new"
    code, text = run(*WORDS, "--diagnose", "--output", out)
    assert code == 0
    for word in ("times the limit of 2", "cause:", "remedy", "advice: "):
        assert word in text
    assert sorted(file.name for file in out.iterdir()) == [
        "design.json",
        "diagnosis.png",
        "network.npz",
    ]
    data = strict(out / "design.json")
    assert data["settled"] is True
    assert data["diagnosis"]["ratio"] == data["ratio"] >= 2
    assert [row["neuron"] for row in data["diagnosis"]["rows"]] == [
        "mu.x",
        "mu.v",
        "beta.x",
        "beta.v",
    ]
    assert set(data["diagnosis"]["modes"][0]["shares"]) == set(data["rho"])
    assert data["diagnosis"]["remedies"][-1]["ratio"] == pytest.approx(2.0)
    assert ann_dc.load(out / "network.npz").stages == 5


def test_without_why_nothing_is_drawn(tmp_path):
    code, text = run(*WORDS, "--quiet", "--output", tmp_path)
    assert (code, text) == (0, "")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["design.json", "network.npz"]
    assert "diagnosis" not in strict(tmp_path / "design.json")


def test_the_same_command_writes_the_same_bytes(tmp_path):
    folders = [tmp_path / name for name in ("one", "two")]
    for folder in folders:
        run(*WORDS, "--diagnose", "--output", folder)
    for name in ("design.json", "diagnosis.png"):
        assert (folders[0] / name).read_bytes() == (folders[1] / name).read_bytes()


def test_a_first_run_that_does_not_settle_ends_with_code_1(monkeypatch):
    designed = solver.design
    monkeypatch.setattr(
        solver, "design", lambda network, **options: designed(network, limit=25, **options)
    )
    code, text = run(*WORDS, "--diagnose")
    assert code == 1
    assert "did not settle in 25 recurrent steps" in text
    assert "why:" not in text


def test_an_unwritable_folder_is_told_before_the_design(tmp_path, monkeypatch):
    monkeypatch.setattr("ann_dc.solver.design", lambda *_, **__: pytest.fail("ran all the same"))
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run(*WORDS, "--output", blocked / "out")
    assert code == 2
    assert "cannot be written" in text or "cannot be created" in text
    assert blocked.read_text() == "kept"


FAMILY = [*WORDS, "--range", "q_d.x=0.5:2", "--range", "q_0.v=-0.5:0.5", "--held-out", "20"]


@pytest.mark.slow
def test_a_family_tells_its_share_and_writes_three_files(tmp_path):
    out = tmp_path / "new"
    code, text = run(*FAMILY, "--output", out)
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
        run(*FAMILY, "--quiet", "--seed", 7 if name == "other" else 0, "--output", folder)
    for name in ("design.json", "family.png"):
        assert (folders["one"] / name).read_bytes() == (folders["two"] / name).read_bytes()
    # a linear problem has the same gains and settling for any samples: the picture shows them
    pictures = [(folders[name] / "family.png").read_bytes() for name in ("one", "other")]
    assert pictures[0] != pictures[1]


@pytest.mark.slow
def test_a_family_with_too_many_failures_ends_with_code_1(monkeypatch):
    monkeypatch.setattr(sys.modules["ann_dc.cli.commands.design"], "ENOUGH", 1.01)
    code, text = run(*FAMILY, "--preconditioner", "multilevel")
    assert code == 1
    assert "20 of 20 settle" in text
    assert "multilevel from" in text


BAD = {
    "no range": (["--range", "q_d.x"], "--range: expected INPUT=LOW:HIGH"),
    "one end": (["--range", "q_d.x=3"], "--range: expected INPUT=LOW:HIGH"),
    "words": (["--range", "q_d.x=near:far"], "got 'q_d.x=near:far'"),
    "backwards": (["--range", "q_d.x=7:3"], "the range from 7 to 3 is empty"),
    "no input": (["--range", "q_d.z=3:7"], "input 'q_d.z' does not exist"),
    "twice": (["--range", "q_d.x=1:2", "--range", "q_d.x=2:3"], "q_d.x is specified twice"),
    "not finite": (["--range", "q_d.x=1:inf"], "not finite"),
    "none held out": (["--range", "q_d.x=1:2", "--held-out", "0"], "--held-out"),
    "refined": (["--range", "q_d.x=1:2", "--refine"], "--range: cannot be combined with"),
    "diagnosis": (["--range", "q_d.x=1:2", "--diagnose"], "--range: cannot be combined with"),
    "started": (
        ["--range", "q_d.x=1:2", "--initial-guess", "random"],
        "--initial-guess or --starts",
    ),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_a_family_that_is_none_is_told_in_a_sentence_with_code_2(words, meaning):
    refused([*WORDS, *words], meaning)


def test_design_json_dash_prints_only_json(tmp_path):
    code, data = printed_json(*WORDS, "--diagnose", "--output", tmp_path)
    assert code == 0
    assert data == strict(tmp_path / "design.json")
    assert data["diagnosis"]["advice"]
