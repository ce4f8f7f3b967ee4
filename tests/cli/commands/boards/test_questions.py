"""Questions about a circuit away from the bench, from the command line."""

import pytest
from command_line import QUICK, refused, run, strict

UNSIMULATED = [*QUICK, "--no-simulate"]


def test_a_yield_has_an_interval(tmp_path):
    file = tmp_path / "yield.json"
    code, text = run(*QUICK, "--yield", "error<20%", "--samples", "5", "--json", file)
    assert code == 0
    assert "5 of 5" in text
    found = strict(file)["yield"]
    assert found["share"] == 1.0
    assert found["interval"][0] == pytest.approx(0.025**0.2)  # Clopper and Pearson's, by hand


def test_a_spec_that_no_circuit_keeps_tells_the_closest():
    code, text = run(*QUICK, "--yield", "error<1e-9", "--samples", "3")
    assert code == 1
    assert "no circuit keeps the spec; seed" in text


def test_trims_are_steps_with_readings(tmp_path):
    file = tmp_path / "trim.json"
    words = "--level", "zero_drift_trimmed", "--trim", "error<50%", "--json", file
    code, text = run(*QUICK, *words)
    assert code == 0
    assert "0 trims bring 95%" in text
    assert strict(file)["trimming"]["steps"] == []
    code, text = run(*QUICK, "--trim", "error<0.01%", "--samples", "2")
    assert code == 1
    assert "buy better resistors" in text


def test_converters_have_a_cost(tmp_path):
    file = tmp_path / "interface.json"
    code, text = run(*QUICK, "--dac", "12", "--adc", "10", "--json", file)
    assert code == 0
    assert "no source presets them" in text
    found = strict(file)["interface"]
    assert found["interface"]["dac_bits"] == 12
    assert found["solve_time"] == pytest.approx(found["settling_time"] + 2e-6)


def test_several_questions_are_answered_together():
    code, text = run(*QUICK, "--corners", "--temperature", "27", "--supply", "1", "--adc", "3")
    assert code == 1  # of three bits
    assert "cold start" in text
    assert "supply" in text


@pytest.mark.parametrize(
    ("words", "meaning"),
    [
        (["--yield", "errr<1%"], "spec: expected terms"),
        (["--yield", "error<1%", "--budget", "3"], "--budget: belongs to one circuit"),
        (["--yield", "error<1%", "--level", "behavioural"], "not emulated"),
        (["--trim", "settle<5us"], "--trim: makes controls right, not quick"),
        (["--trim", "everything"], "spec: expected terms"),
        (["--dac", "0"], "--dac"),
        (["--spot", "3"], "--spot: is about drawn circuits"),
    ],
)
def test_questions_without_an_answer_are_refused(words, meaning):
    refused([*UNSIMULATED, *words], meaning)
