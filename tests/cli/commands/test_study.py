"""``ann-dc study``: a file in, rows in a folder, one point again, what can be varied."""

import csv

import numpy as np
import pytest
from command_line import printed_json, refused, run

from ann_dc.report.study_summary import summary
from ann_dc.study import Table, load_study

STUDY = """
title = "chips"
subject = "double_integrator"
metrics = ["settling_time", "control_error"]
samples = 4
[vary]
nonideal.mismatch = [0.0, 0.02]
[fixed]
problem.N = 5
[spec]
control_error = 1e-4
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "chips.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def test_a_study_is_run_summed_up_and_exported(file, tmp_path):
    out, table = tmp_path / "out", tmp_path / "chips.csv"
    code, said = run("study", file, "--output", out, "--workers", "0", "--csv", table)
    assert code == 0
    assert "chips: 8 of 8 points" in said
    assert "settled 8 100.0%" in said
    pooled = "yield, all listed settings together: 50.0 % (6.8 to 93.2 %, 4 of 8 from 4 draws)"
    assert said.index("0.02 0.0 % (") < said.index(pooled)
    assert "0.0 100.0 % (4 of 4, no random settings: no interval)" in said
    assert "0.02 0.0 % (0.0 to 60.2 %, 0 of 4)" in said
    with table.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["point"] for row in rows] == [str(n) for n in range(8)]
    code, said = run("study", file, "--output", out, "--workers", "0")
    assert (code, "8 of 8" in said) == (0, True)
    code, said = run("study", out, "--point", "5")
    assert code == 0
    assert all(f"{name} {rows[5][name]}" in said for name in ("seed", "settling_time", "outcome"))


def test_summary_without_records_has_no_figures(file):
    study = load_study(file)
    nothing = Table(columns=dict.fromkeys(study.columns, np.empty(0)), spec=study.spec)
    assert summary(study, nothing) == ["chips: 0 of 8 points", "no records yet"]


def test_points_that_fail_are_told_by_the_code(file, tmp_path):
    negative = "[0.02]\nnonideal.time_constants = [0.0, 3.0]"  # some are drawn below zero
    file.write_text(STUDY.replace("[0.0, 0.02]", negative), encoding="utf-8")
    code, said = run("study", file, "--output", tmp_path / "out", "--workers", "0")
    assert code == 1
    assert "failed 4 50.0%" in said


def test_samples_of_nothing_random_are_refused(file, tmp_path):
    file.write_text(STUDY.replace("[0.0, 0.02]", "[0.0]"), encoding="utf-8")
    said = "samples: the study has no random settings, so 4 samples would be 4 equal records"
    refused(("study", file, "--output", tmp_path / "out"), said)


def test_what_can_be_varied_and_measured():
    code, said = run("study", "double_integrator", "--list-settings")
    assert code == 0
    for word in ("input.", "q_d.x", "nonideal.", "mismatch", "predicted_settling_time"):
        assert word in said


def test_bad_input_is_told(file, tmp_path):
    refused(["study", file], "--output: expected a folder for the records")
    refused(["study", tmp_path / "none.toml", "--output", tmp_path], "none.toml")
    refused(["study", file, "--point", "8"], "there are 8 cases")
    refused(["study", tmp_path, "--point", "1"], "study.sqlite")
    refused(["study", file, "--point", "1", "--csv", tmp_path / "a.csv"], "omit --point")
    refused(["study", "kar", "--list-settings"], "did you mean car")
    run("study", file, "--output", tmp_path / "out", "--workers", "0")
    file.write_text(STUDY.replace("0.02", "0.03"), encoding="utf-8")
    refused(["study", file, "--output", tmp_path / "out", "--workers", "0"], "another study")
    file.write_text(STUDY + "settling_time = [3, 2]\n", encoding="utf-8")
    refused(["study", file, "--output", tmp_path / "new"], "is empty")


def test_a_scheduler_that_does_not_answer(file, tmp_path, monkeypatch):
    import distributed

    def client(address, timeout):
        raise OSError(f"timed out trying to connect to {address} for {timeout}")

    monkeypatch.setattr(distributed, "Client", client)
    words = ["study", file, "--output", tmp_path / "out", "--scheduler", "tcp://127.0.0.1:1"]
    refused(words, "no response from tcp://127.0.0.1:1")


def test_study_json_dash_prints_only_json(file, tmp_path):
    code, data = printed_json("study", file, "--output", tmp_path / "out", "--workers", "0")
    assert code == 0
    assert data["outcomes"] == {"settled": 8}
    assert (data["yield"]["share"], data["yield"]["passed"], data["cases"]) == (0.5, 4, 8)
    assert data["metrics"]["settling_time"]["nan"] == 0
    code, record = printed_json("study", file, "--point", 5)
    assert (code, record["point"]) == (0, 5)
    code, known = printed_json("study", "car", "--list-settings")
    assert code == 0
    assert "settling_time" in known["metrics"]
