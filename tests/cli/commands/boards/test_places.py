"""Circuits at other places, from the command line."""

import pytest
from command_line import QUICK, refused, run, strict

UNSIMULATED = [*QUICK, "--no-simulate"]


def test_corners_are_a_table_and_a_file(tmp_path):
    file = tmp_path / "corners.json"
    code, text = run(*QUICK, "--corners", "--temperature", "27,85", "--json", file)
    assert code == 0
    assert "supply" in text
    assert "no drift of these parts is known" in text
    found = strict(file)["corners"]
    assert [corner["conditions"]["temperature"] for corner in found] == [27.0] * 3 + [85.0] * 3
    assert all(corner["near"] for corner in found)


def test_presets_drift(tmp_path):
    file = tmp_path / "corners.json"
    level = ["--level", "opa192_ad734"]
    code, text = run(*QUICK, *level, "--corners", "--temperature=27,-40,125", "--json", file)
    assert code == 0
    assert "of multipliers no drift is known" in text
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
        (["--temperature", "20,30"], "stands at one place"),
        (["--supply", "3"], "supply: expected 0.5 to 1.5"),
        (["--process", "xx"], "expected one of tt, ss, ff, sf, fs"),
        (["--process", "ss"], "know no corner"),
        (["--corners", "--samples", "3"], "--samples: belongs to one circuit"),
        (["--corners", "--process", "xx"], "expected one of tt, ss, ff, sf, fs"),
    ],
)
def test_places_that_do_not_exist_are_refused(words, meaning):
    refused([*UNSIMULATED, *words], meaning)
