"""Circuits at other places, from the command line."""

import pytest
from command_line import QUICK, refused, run, strict

UNSIMULATED = [*QUICK, "--no-simulate"]


def test_corners_are_a_table_and_a_file(tmp_path):
    file = tmp_path / "corners.json"
    code, text = run(*QUICK, "--corners", "--temperature", "27,85", "--json", file)
    assert code == 0
    assert "supply" in text
    assert "the drift of these parts is unknown" in text
    found = strict(file)["corners"]
    assert [corner["conditions"]["temperature"] for corner in found] == [27.0] * 3 + [85.0] * 3
    assert all(corner["within_tolerance"] for corner in found)


@pytest.mark.slow
def test_presets_drift(tmp_path):
    file = tmp_path / "corners.json"
    level = ["--level", "opa192_ad734"]
    code, text = run(*QUICK, *level, "--corners", "--temperature=27,-40,125", "--json", file)
    assert code == 0
    assert "of multipliers is unknown" in text
    room, cold, hot = (corner["spread"] for corner in strict(file)["corners"][1::3])
    assert room < cold < hot


def test_one_circuit_stands_where_it_is_put():
    code, text = run(*UNSIMULATED, "--temperature", "85", "--supply", "0.9", "--seed", "1")
    assert code in (0, 1)
    assert "predicted" in text


@pytest.mark.parametrize(
    ("words", "meaning"),
    [
        (["--temperature", "300"], "-55 to 150 C"),
        (["--temperature", "warm"], "--temperature: expected a finite number"),
        (["--temperature", "20,30"], "expected one value without --corners"),
        (["--supply", "3"], "supply: expected 0.5 to 1.5"),
        (["--process", "xx"], "expected one of tt, ss, ff, sf, fs"),
        (["--process", "ss"], "no process corners"),
    ],
)
def test_places_that_do_not_exist_are_refused(words, meaning):
    refused([*UNSIMULATED, *words], meaning)


@pytest.mark.parametrize(
    ("words", "meaning"),
    [
        (["--samples", "3"], "--samples: applies to the construction"),
        (["--loops", "3"], "--loops: applies to the construction"),
        (["--no-simulate"], "--no-simulate: applies to the construction"),
        (["--process", "xx"], "expected one of tt, ss, ff, sf, fs"),
    ],
)
def test_corners_without_an_answer_are_refused(words, meaning):
    refused([*QUICK, "--corners", *words], meaning)


def test_corners_of_drawn_parts_have_the_errors_of_the_seed(tmp_path):
    found = []
    for seed in ("1", "2"):
        file = tmp_path / f"{seed}.json"
        run(*QUICK, "--corners", "--temperature", "27", "--seed", seed, "--json", file)
        found.append(strict(file)["corners"][0]["control_error"])
    assert found[0] != found[1]


def test_corners_in_ngspice_need_one_before_the_design(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("ann_dc.cli.arguments.building.design", None)
    refused([*QUICK, "--corners", "--level", "transistor"], "ngspice")
