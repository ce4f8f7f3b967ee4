"""The paper's example from the command line."""

import re

import pytest
from command_line import run, strict


def test_paper_certifies_both_cars_and_shows_the_slips(tmp_path):
    pytest.importorskip("ann_dc.plotting")
    code, text = run("paper", "--out", tmp_path)
    assert code == 0
    data = strict(tmp_path / "result.json")
    assert data["corrected D=1"]["objective"] == pytest.approx(398.6315, abs=1e-3)
    assert data["corrected D=0.5"]["objective"] == pytest.approx(368.1893, abs=1e-3)
    assert data["printed D=1"]["status"] in ("diverged", "left_domain")
    assert data["plain D=1"]["status"] == "left_domain"
    assert re.search(r"neuron\s+\w+\[\d\]\.\w+\s+reached|left the domain of", text)
    assert "started 1% off the optimum" in text
    assert "398.6315" in text
    assert "368.1893" in text
    assert list(tmp_path.rglob("*.png"))


def test_a_file_is_no_output_folder(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("kept")
    code, text = run("paper", "--out", blocked)
    assert (code, "cannot be written" in text) == (2, True)
