"""What is said of a solution, and the files that are written."""

import json

import pytest
from rich.console import Console

import ann_dc
from ann_dc.report import report_table, write_solution


@pytest.fixture(scope="module")
def solution():
    return ann_dc.solve(ann_dc.plants.double_integrator(N=5))


def test_the_report_names_what_decides(solution):
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(report_table(solution, ann_dc.OdeBackend()))
    text = capture.get()
    for row in ("certified", "KKT residual", "settling time", "predicted", "rho", "metric"):
        assert row in text
    assert "recurrence" not in text


def test_only_what_was_asked_for_is_written(solution, tmp_path):
    assert write_solution(solution) == []
    files = {"json_file": tmp_path / "a.json", "save": tmp_path / "b.npz"}
    assert write_solution(solution, **files) == [*files.values()]
    assert json.loads(files["json_file"].read_text())["certified"] is True
    assert ann_dc.load(files["save"]).stages == 5
    assert {*tmp_path.iterdir()} == {*files.values()}
