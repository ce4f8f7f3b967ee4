"""Questions about a circuit away from the bench, from the command line."""

import numpy as np
import pytest
from command_line import QUICK, refused, run, strict
from simulator import needs_ngspice

UNSTABLE = [*QUICK, "--bandwidth-margin", "2.5"]
CLOCKED = [*QUICK, "--level", "switched-capacitor"]


def test_a_yield_has_an_interval(tmp_path):
    file = tmp_path / "yield.json"
    code, text = run(*QUICK, "--yield", "error<20%", "--samples", "5", "--json", file)
    assert code == 0
    assert "5 of 5" in text
    found = strict(file)["yield"]
    assert found["share"] == 1.0
    assert found["interval"][0] == pytest.approx(0.025**0.2)  # Clopper and Pearson's, by hand


@pytest.mark.slow
def test_a_yield_may_be_of_resistors_that_exist(tmp_path):
    medians = []
    for series in ("exact", "E96-pairs", "E12"):
        file = tmp_path / f"{series}.json"
        words = "--level", "opa192_ad734", "--yield", "error<50%", "--samples", "5"
        code, text = run(*QUICK, *words, "--series", series, "--json", file)
        assert code == 0
        assert (series == "E12") == ("E12, with their tolerances in addition" in text)
        medians.append(np.median(strict(file)["yield"]["errors"]))
    assert medians[2] > 5 * medians[0]
    assert medians[1] == pytest.approx(medians[0], rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("question", "figure"),
    [
        (["--dac", "16"], lambda found: found["interface"]["circuit_error"]),
        (["--trim", "error<5%", "--samples", "2"], lambda found: found["trimming"]["untrimmed"]),
        (
            ["--corners", "--temperature", "27", "--supply", "1"],
            lambda found: found["corners"][0]["control_error"],
        ),
    ],
    ids=["converters", "trims", "corners"],
)
def test_every_question_may_be_of_resistors_that_exist(question, figure, tmp_path):
    """Resistors of E12 are up to 10 % off."""
    found = {}
    for series in ("exact", "E12"):
        file = tmp_path / "found.json"
        words = "--level", "opa192_ad734", "--series", series, "--json", file
        _, text = run(*QUICK, *question, *words)
        assert (series == "E12") == ("E12" in text)
        found[series] = figure(strict(file))
        assert strict(file)["resistors"] == series
    assert found["E12"] > 3 * found["exact"]


def test_converters_of_one_circuit_of_drawn_parts(tmp_path):
    errors = []
    for seed in ("1", "2"):
        file = tmp_path / f"{seed}.json"
        _, text = run(*QUICK, "--dac", "16", "--seed", seed, "--json", file)
        assert f"parts drawn with seed {seed}" in text
        errors.append(strict(file)["interface"]["circuit_error"])
    assert errors[0] != errors[1]


def test_a_spec_that_no_circuit_keeps_tells_the_closest():
    code, text = run(*QUICK, "--yield", "error<1e-9", "--samples", "3")
    assert code == 1
    assert "no circuit meets the specification; seed" in text


@pytest.mark.slow
def test_trims_are_steps_with_readings(tmp_path):
    file = tmp_path / "trim.json"
    words = "--level", "zero_drift_trimmed", "--trim", "error<50%", "--json", file
    code, text = run(*QUICK, *words)
    assert code == 0
    assert "0 trims bring 95% of 20 emulated circuits" in " ".join(text.split())
    assert strict(file)["trimming"]["steps"] == []
    code, text = run(*QUICK, "--trim", "error<0.01%", "--samples", "2")
    assert code == 1
    assert "use better resistors" in text


def test_converters_have_a_cost(tmp_path):
    file = tmp_path / "interface.json"
    code, text = run(*QUICK, "--dac", "12", "--adc", "10", "--json", file)
    assert code == 0
    assert "without preset sources" in text
    found = strict(file)["interface"]
    assert found["interface"]["dac_bits"] == 12
    assert found["solve_time"] == pytest.approx(found["settling_time"] + 2e-6)


def test_corners_tell_what_tolerances_add_to_their_verdict():
    """5e-5 with nominal parts, and a standard deviation of 2 % with tolerances of 1 %."""
    code, text = run(*QUICK, "--corners", "--temperature", "27", "--supply", "1")
    assert code == 0
    assert "at 1 of 1 corners nominal parts are within 1%, and 3 spreads exceed it" in text
    place = "--corners", "--temperature", "27", "--supply", "1"
    _, text = run(*QUICK, *place, "--seed", "1")
    assert "of parts drawn with seed 1" in text
    assert "nominal" not in text


@needs_ngspice
def test_corners_without_a_spread_recommend_only_what_there_is():
    place = "--corners", "--temperature", "27", "--supply", "1"
    _, text = run(*QUICK, "--level", "behavioural", *place)
    assert "the spread is unknown" in text
    assert "--yield" not in text


def test_several_questions_are_answered_together():
    code, text = run(*QUICK, "--corners", "--temperature", "27", "--supply", "1", "--adc", "3")
    assert code == 1  # of three bits
    assert "cold start" in text
    assert "supply" in text


@pytest.mark.parametrize(
    ("words", "meaning"),
    [
        (["--yield", "errr<1%"], "--yield: expected terms"),
        (
            ["--yield", "error<1%", "--error-budget", "3"],
            "--error-budget: applies to the construction",
        ),
        (["--yield", "error<1%", "--seed", "0"], "--seed: --yield and --trim use the seeds"),
        (["--trim", "error<5%", "--seed", "1"], "--seed: --yield and --trim use the seeds"),
        (["--trim", "error<1%", "--loops", "1"], "--loops: applies to the construction"),
        (["--adc", "8", "--no-simulate"], "--no-simulate: applies to the construction"),
        (["--yield", "error<1%", "--level", "behavioural"], "not emulated"),
        (["--trim", "settle<5us"], "--trim: expected an error limit"),
        (["--trim", "everything"], "--trim: expected terms"),
        (["--dac", "0"], "--dac"),
        (["--yield", "error<1%", "--samples", "0"], "--samples"),
        (["--simulate-samples", "3"], "--simulate-samples: needs --yield"),
    ],
)
def test_questions_without_an_answer_are_refused(words, meaning):
    refused([*QUICK, *words], meaning)


def test_drawn_circuits_in_ngspice_need_one_before_the_design(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("ann_dc.cli.arguments.building.design", None)
    refused([*QUICK, "--yield", "stable", "--simulate-samples", "1"], "ngspice")


# ---- circuits that do not settle -----------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["--corners", "--temperature", "27", "--supply", "1"], "its equilibrium is unstable"),
        (["--yield", "error<20%", "--samples", "2"], "none of the circuits settles"),
        (["--yield", "stable", "--samples", "2"], "none of the circuits settles"),
        (["--dac", "12", "--adc", "12"], "the circuit oscillates"),
    ],
)
def test_no_question_about_a_circuit_that_oscillates_is_answered_with_yes(words, reported):
    code, text = run(*UNSTABLE, *words)
    assert code == 1
    assert reported in " ".join(text.split())


def test_a_circuit_that_oscillates_is_not_trimmed():
    refused([*UNSTABLE, "--trim", "error<5%"], "the pole model is unstable")


def test_clocked_circuits_are_not_taken_for_op_amps():
    code, text = run(*CLOCKED, "--yield", "error<20%", "--samples", "2")
    assert code == 0
    assert "2 of 2" in text
    refused([*CLOCKED, "--yield", "settle<1s"], "the settling time of")
    refused([*CLOCKED, "--dac", "12"], "no settling time is known")
