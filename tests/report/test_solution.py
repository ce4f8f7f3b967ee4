"""What is said of a solution, and the files that are written."""

import json
from dataclasses import replace

import pytest
from rich.console import Console

import ann_dc
from ann_dc.decomposition.form import switch
from ann_dc.optimality.complementarity import Complementarity
from ann_dc.report.solution import solution_report, write_solution


@pytest.fixture(scope="module")
def solution():
    return ann_dc.solve(ann_dc.plants.double_integrator(N=5))


def test_the_report_names_what_decides(solution):
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(solution_report(solution, ann_dc.OdeBackend()))
    text = capture.get()
    assert "x (m), v (m/s), a (m/s^2), time (s)" in text
    assert "tau_min: fastest time constant" in text
    for row in ("certified", "KKT residual", "settling time", "predicted", "rho", "preconditioner"):
        assert row in text
    assert "recurrence" not in text
    assert "relative in natural scales (feasibility" in " ".join(text.split())
    assert "in the problem's units" not in text


def text_of(solution):
    console = Console(width=200, color_system=None)
    with console.capture() as capture:
        console.print(solution_report(solution))
    return capture.get()


@pytest.mark.parametrize(("factor", "remarks"), [(1, 0), (2, 0), (4, 1), (0.2, 1)])
def test_settling_time_far_from_its_prediction_has_a_remark(solution, factor, remarks):
    time = factor * solution.predicted_settling
    text = text_of(replace(solution, run=replace(solution.run, settling_time=time)))
    assert text.count("; the prediction holds near the optimum)") == remarks


def test_preset_names_the_next_step(solution):
    assert "--preconditioner multilevel" not in text_of(solution)
    start = "6 stages of the known trajectory"
    text = text_of(replace(solution, design=replace(solution.design, start=start)))
    assert f"{start} (preset), not the given initial guess; to settle from the guess, try" in text
    assert "neighbourhood" in text


def test_values_of_an_infeasible_problem_are_no_solution(solution):
    remark = "values are the last state of the network, not a solution"
    weak = ann_dc.solve(replace(solution.problem, bounds={"a": (-0.5, 0.5)}))
    text = " ".join(text_of(weak).split())
    assert text.count(remark) == 2
    assert f"infeasible: no controls reach the target ({remark})" in text
    assert remark not in text_of(solution)


def test_a_misprint_has_no_predicted_settling(solution):
    """Gains are designed for the corrected equations, whose spectrum says nothing of others."""
    assert solution.predicted_settling == solution.design.predicted_settling()
    printed = ann_dc.solve(solution.problem, form=switch("S4"))
    assert printed.design.settled
    assert printed.predicted_settling is None
    console = Console(width=120, color_system=None)
    with console.capture() as capture:
        console.print(solution_report(printed))
    assert "predicted" not in capture.get()


def test_inequalities_are_told_where_there_are_any(solution, tmp_path):
    kept = Complementarity(
        violation=1e-9, wrong_sign=0.0, product=2e-8, strong=3, weak=1, inactive=6
    )
    reported = replace(solution, certificate=replace(solution.certificate, complementarity=kept))
    for one, words in ((solution, None), (reported, "3 strongly active, 1 weakly, 6 inactive")):
        console = Console(width=200, color_system=None)
        with console.capture() as capture:
            console.print(solution_report(one))
        assert ("inequalities" in capture.get()) == (words is not None)
        assert (words or "second order") in capture.get()
        assert ("inequalities" in one.as_dict()) == (words is not None)
    assert reported.as_dict()["inequalities"]["product"] == 2e-8
    reported.save(tmp_path / "reported")
    again = ann_dc.load_solution(tmp_path / "reported").certificate.complementarity
    assert vars(again) == vars(kept)
    solution.save(tmp_path / "plain")
    manifest = (tmp_path / "plain" / "manifest.json").read_text()
    assert "complementarity" not in manifest
    assert ann_dc.load_solution(tmp_path / "plain").certificate.complementarity is None


def test_only_what_was_asked_for_is_written(solution, tmp_path):
    assert write_solution(solution) == []
    files = {
        "json_file": tmp_path / "a.json",
        "trajectory": tmp_path / "c.csv",
        "weights": tmp_path / "b.npz",
        "folder": tmp_path / "d",
    }
    assert write_solution(solution, **files) == [*files.values()]
    written = json.loads(files["json_file"].read_text())
    assert written["certified"] is True
    assert written["units"] == {"x": "m", "v": "m/s", "a": "m/s^2", "time": "s"}
    assert ann_dc.load(files["weights"]).stages == 5
    assert ann_dc.load_solution(files["folder"]).certified
    assert files["trajectory"].read_text().startswith("time (unit time constants),q.x[1] (m)")
    assert {*tmp_path.iterdir()} == {*files.values()}
