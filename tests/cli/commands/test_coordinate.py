"""The two-level algorithm from the command line."""

import numpy as np
import pytest
from command_line import COORDINATE, ROOT, printed_json, refused, run, strict

from ann_dc.backends.settling import Settling


def test_help_tells_where_the_run_ends():
    _, text = run("coordinate", "--help")
    assert f"{Settling().confirm:g} of it" in text


@pytest.mark.parametrize(
    ("coordinator", "lower"),
    [("gradient", "closed"), ("newton", "linearised"), ("newton", "closed")],
)
def test_coordinate_settles_to_the_optimum(tmp_path, coordinator, lower):
    file = tmp_path / "result.json"
    chosen = [] if lower == "linearised" else ["--lower", lower]
    code, text = run(*COORDINATE, "--coordinator", coordinator, *chosen, "--json", file)
    assert code == 0
    for row in ("the hypothesis of Theorem IV.2", "outer iterations", "inner steps", "Theta"):
        assert row in text
    data = strict(file)
    assert (data["coordinator"], data["lower_level"]) == (coordinator, lower)
    assert (data["status"], data["certified"]) == ("settled", True)
    assert data["objective"] == pytest.approx(500, rel=1e-6)
    assert data["values"]["a"] == pytest.approx([20, 10, 0, -10, -20], abs=1e-3)
    assert [data["values"][name][-1] for name in ("x", "v")] == pytest.approx([1, 0])
    assert len(data["theta"]) == data["outer_iterations_in_all"] + 1 == len(data["residuals"])
    assert data["theta"][-1] < 1e-9 * data["theta"][0]


def test_a_step_length_that_is_chosen_is_told(tmp_path):
    """Every stage can be solved by itself, the first one with the q_0 that it leaves free too."""
    file = tmp_path / "result.json"
    words = ["pendulum_free_time", "-N", "6", "--set", "high=0.6", "--coordinator", "newton"]
    code, _ = run("coordinate", *words, "--json", file)
    assert code == 0
    data = strict(file)
    assert data["certified"]
    assert 0.02 < data["dt"] < 0.6
    assert np.ptp(data["values"]["h_free"]) < 1e-5


@pytest.mark.slow
def test_coordinate_predicts_what_the_gradient_coordinator_needs(tmp_path):
    """The slowest mode alone: what else starts makes the count another one, not by much."""
    file = tmp_path / "result.json"
    code, text = run("coordinate", "car", "--json", file)
    assert code == 0
    data = strict(file)
    assert data["objective"] == pytest.approx(398.6315, abs=1e-3)
    assert data["predicted_outer_iterations"] == pytest.approx(data["outer_iterations"], rel=0.2)
    assert f"{data['predicted_outer_iterations']:.0f}, from the spectral radius" in text
    assert f"{data['outer_iterations']} until the residual stays below 1e-06" in text
    assert f"lambda_t = {data['lambda_t']:.4g}, lambda_beta = {data['lambda_beta']:.4g}" in text
    assert data["theorem_IV_2_holds"] is False
    assert data["theta_fell_monotonically"] is True
    assert "fell in all" in text


@pytest.mark.parametrize(
    "options", [["--coordinator", "oracle"], ["--lower", "iterated"], ["--tolerance", "1e-8"]]
)
def test_coordinate_that_is_not_done_is_told_with_code_1(tmp_path, options):
    file = tmp_path / "result.json"
    code, text = run(*COORDINATE, *options, "--max-iterations", 9, "--json", file)
    assert code == 1
    assert "not settled after 9 outer iterations" in text
    assert "not certified: the two levels did not settle" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("not_settled", False)
    assert data["outer_iterations"] is None
    assert len(data["theta"]) == 10


@pytest.mark.slow
def test_coordinate_needs_a_design_that_settled(tmp_path):
    """One stage cannot bring a mass to rest anywhere."""
    file = tmp_path / "result.json"
    code, text = run("coordinate", "double_integrator", "-N", 1, "--json", file)
    assert code == 1
    assert "the design did not settle" in text
    data = strict(file)
    assert (data["status"], data["certified"]) == ("design_not_settled", False)


BAD = {
    "unknown plant to coordinate": (["coordinate", "cra"], "did you mean car"),
    "unknown coordinator": ([*COORDINATE, "--coordinator", "x"], "gradient, newton, oracle"),
    "unknown lower level": ([*COORDINATE, "--lower", "x"], "closed, iterated"),
    "no outer iterations": ([*COORDINATE, "--max-iterations", "0"], "--max-iterations"),
    "no tolerance": ([*COORDINATE, "--tolerance", "0"], "--tolerance: expected a number below 1"),
    "tolerance nan": ([*COORDINATE, "--tolerance", "nan"], "--tolerance: expected a number"),
    "folder to coordinate into": ([*COORDINATE, "--json", str(ROOT)], "is a folder"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)


def test_coordinate_json_dash_prints_only_json():
    code, data = printed_json(*COORDINATE, "--coordinator", "newton")
    assert (code, data["certified"]) == (0, True)
