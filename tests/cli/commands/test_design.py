"""Designing from the command line: what was compared, why it is slow, files, exit codes."""

import pytest
from command_line import run, strict

import ann_dc
from ann_dc import solver

WORDS = ["design", "double_integrator", "-N", "5"]


def test_a_design_tells_its_candidates():
    code, text = run(*WORDS)
    assert code == 0
    for word in ("first run", "frozen with", "predicted", "metric", "(frozen)"):
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
