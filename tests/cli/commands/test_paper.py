"""The paper's example from the command line."""

import re

import pytest
from command_line import run, strict
from torch_free import forget_torch


@pytest.mark.slow
def test_paper_certifies_both_cars_and_shows_the_slips(tmp_path, monkeypatch):
    pytest.importorskip("ann_dc.plotting")
    forget_torch(monkeypatch)
    file = tmp_path / "new" / "paper.json"
    code, text = run("paper", "--output", tmp_path, "--json", file)
    assert code == 0
    assert file.read_bytes() == (tmp_path / "result.json").read_bytes()
    data = strict(tmp_path / "result.json")
    assert data["corrected D=1"]["objective"] == pytest.approx(398.6315, abs=1e-3)
    assert data["corrected D=0.5"]["objective"] == pytest.approx(368.1893, abs=1e-3)
    assert data["printed D=1"]["status"] in ("diverged", "left_domain")
    assert data["printed, designed gains"]["status"] in ("diverged", "left_domain")
    assert data["without dB/dq"]["status"] == "not_settled"
    assert data["plain D=1"]["status"] == "left_domain"
    reported = data["two levels"]
    assert not reported["theorem_IV_2_holds"]
    assert reported["theorem_IV_2_holds_as_printed"]
    assert [len(reported[case]["lambda"]) for case in reported if "obstacles" in case] == [5, 4]
    assert reported["(28)-(30), (33) printed"]["theta"][0][-1] > 1e6
    assert re.search(r"neuron\s+\w+\[\d\]\.\w+\s+reached|left the domain of", text)
    assert "started 1% from the optimum" in text
    assert "398.6315" in text
    assert "368.1893" in text
    assert "rho = 0" in text
    drawn = {path.name for path in tmp_path.glob("*.png")}
    numbered = {f"figure_{number}.png" for number in range(1, 7)}
    free = {"without_obstacles_paths.png", "without_obstacles_controls.png"}
    assert drawn == numbered | free | {"equation_21.png", "theorem_IV_1.png"}
    assert len(list(tmp_path.rglob("*.png"))) == 18
    for case in data["around"].values():
        assert case["discs_certified"]
        assert all(case["legs_certified"])
        for way in ("with segments", "discs"):
            assert case[way]["room"] > 0
            assert case[way]["rollout_error"] < 1e-6


def test_a_file_is_no_output_folder(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run("paper", "--output", blocked)
    assert (code, "cannot be written" in text) == (2, True)
