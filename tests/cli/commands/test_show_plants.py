"""The list of plants, and the page of one."""

import pytest
from command_line import refused, run, terminal

from ann_dc.cli.arguments.problem import as_typed, defaults_of, value_of
from ann_dc.problem import plants


def test_plants_lists_every_plant():
    code, text = run("plants")
    assert code == 0
    assert all(name in text for name in plants.names())
    assert ":math:" not in text


@pytest.mark.parametrize("name", plants.names())
def test_a_plant_shows_its_parameters_and_they_can_be_typed_back(name):
    code, text = run("plants", name)
    assert code == 0
    for parameter, default in defaults_of(plants.get(name)).items():
        assert parameter in text
        typed = value_of(parameter, as_typed(default), default)
        assert typed == pytest.approx(default)


@pytest.mark.parametrize("name", plants.names())
def test_a_plant_shows_its_units(name):
    text = " ".join(run("plants", name)[1].split())
    problem = plants.get(name)()
    for symbol in (*problem.states, *problem.controls):
        assert f"{symbol} ({problem.unit(str(symbol))})" in text
    assert f"time ({problem.time_unit})" in text


BAD = {
    "unknown plant to list": (["plants", "pendulun"], "did you mean pendulum"),
}


@pytest.mark.parametrize(("words", "meaning"), BAD.values(), ids=BAD)
def test_bad_input_is_told_in_a_sentence_with_code_2(words, meaning):
    refused(words, meaning)


@pytest.mark.slow
def test_a_terminal_without_utf8_shows_plain_letters():
    plain = {"PYTHONIOENCODING": "ascii", "NO_COLOR": "1", "COLUMNS": "80"}
    code, out, err = terminal("plants", **plain)
    assert (code, err, out.isascii()) == (0, b"", True)
